//! Pictures of a colour chart that come with a calibration.

use crate::error::RigError;
use penumbra_picture::Picture;
use penumbra_rig_model::{Attachments, RigCalibration};
use penumbra_white_balance::chart::{ChartError, ChartMatch, Photograph, match_chart};

pub(crate) type ChartResult = Result<ChartMatch, ChartError>;

/// Both cameras' pictures of a colour chart.
#[derive(Debug)]
pub(crate) struct ChartPictures {
    scene: Picture,
    environment: Picture,
    /// A colour matrix is wanted, not only gains.
    matrix: bool,
}

impl ChartPictures {
    /// Reads the calibration's pictures; `None` if it lacks one of them.
    ///
    /// # Errors
    /// A picture cannot be decoded.
    pub fn read(
        rig: &RigCalibration,
        files: &Attachments,
        matrix: bool,
    ) -> Result<Option<Self>, RigError> {
        let (Some(chart), Some(_)) = (&rig.chart, &rig.environment) else {
            return Ok(None);
        };
        let load = |name: &str| -> Result<Option<Picture>, RigError> {
            let Some(bytes) = files(name) else {
                return Ok(None);
            };
            Picture::from_file_bytes(bytes)
                .map(Some)
                .map_err(|source| RigError::Picture {
                    name: name.to_owned(),
                    source,
                })
        };
        let pictures = (
            load(&chart.scene_picture)?,
            load(&chart.environment_picture)?,
        );
        let (Some(scene), Some(environment)) = pictures else {
            return Ok(None);
        };
        Ok(Some(Self {
            scene,
            environment,
            matrix,
        }))
    }

    /// Matches the two cameras with the tone curves that `rig` has now; `None` if it has no chart.
    pub fn matched(&self, rig: &RigCalibration) -> Option<ChartResult> {
        let (chart, environment) = (rig.chart.as_ref()?, rig.environment.as_ref()?);
        let scene = Photograph {
            picture: &self.scene,
            response: &rig.scene_camera.response,
        };
        let seen = Photograph {
            picture: &self.environment,
            response: &environment.response,
        };
        Some(match_chart(chart, scene, seen, self.matrix))
    }
}
