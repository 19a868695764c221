//! The file of a lens calibration: the lens, its uncertainty, device and date.
//!
//! `calibration/scene_camera.json` and `calibration/environment_camera.json` beside a `rig.json`
//! replace its lenses; sessions have them as attachments.

use crate::CalibrationFileError;
use crate::DeviceRecord;
use glam::DVec2;
use penumbra_camera::{Lens, LensModel, PointSpread};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of the format.
const VERSION: u32 = 1;
/// Maximum size of the file, bytes.
const MAX_FILE_BYTES: usize = 1 << 20;
/// Maximum magnitude of a parameter.
const MAX_MAGNITUDE: f64 = 1e6;
/// Maximum number of pixels along a side.
const MAX_SIDE_PIXELS: u32 = 65_536;

/// The file. Lengths are pixels, `sigma` is one standard deviation.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct LensRecord {
    /// Version of this format.
    pub penumbra_calibration: u32,
    /// "scene" or "environment".
    pub camera: String,
    /// Date, UTC, ISO 8601.
    pub date: String,
    /// Device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceRecord>,
    /// Source: a session or a folder.
    #[serde(default)]
    pub source: String,
    /// Board, as given to `--board`.
    #[serde(default)]
    pub board: String,
    /// "brown", "brown-rational" or "fisheye".
    pub model: String,
    /// Width and height.
    pub image_size: [u32; 2],
    /// fx and fy.
    pub focal: [f64; 2],
    /// cx and cy.
    pub centre: [f64; 2],
    /// Coefficients k1, ... by name.
    pub distortion: BTreeMap<String, f64>,
    /// Maximum calibrated angle of a fisheye from the axis, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_theta: Option<f64>,
    /// Standard deviations of fx, fy, cx, cy and the coefficients by name.
    #[serde(default)]
    pub sigma: BTreeMap<String, f64>,
    /// Sharpness of the pictures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sharpness: Option<SharpnessRecord>,
    /// Quality of the calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub quality: Option<QualityRecord>,
}

/// Sharpness of a camera's pictures: the spread of a pixel by lens, demosaicing and sharpening.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct SharpnessRecord {
    /// Weights of a pixel, of its left and right neighbours, and of the next ones:
    /// w0 + 2 w1 + 2 w2 = 1.
    pub across: [f64; 3],
    /// The same for its upper and lower neighbours.
    pub down: [f64; 3],
    /// Spatial frequency at which the modulation transfer is one half, across and down, cycles a
    /// pixel.
    pub mtf50: [f64; 2],
    /// Number of edges from which it was measured.
    pub edges: usize,
}

/// Quality of a lens calibration.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct QualityRecord {
    /// "good", "usable" or "refused".
    pub verdict: String,
    /// Reasons for a grade below good.
    pub findings: Vec<String>,
    /// Root mean square reprojection error, pixels.
    pub rms: f64,
    /// Number of views used, and of all.
    pub views: [usize; 2],
    /// Number of corners used, and of all.
    pub corners: [usize; 2],
    /// Share of the picture that contains corners.
    pub coverage: f64,
    /// Standard deviation of the projection of a direction, pixels: in the centre and at worst.
    pub projection_sigma: [f64; 2],
}

impl LensRecord {
    /// Creates the record of a lens that another program calibrated.
    #[must_use]
    pub fn from_lens(lens: &Lens, camera: &str, date: String) -> Self {
        let names = lens.model.coefficients();
        let pairs = names.iter().zip(lens.coefficients);
        Self {
            penumbra_calibration: VERSION,
            camera: camera.to_owned(),
            date,
            device: None,
            source: String::new(),
            board: String::new(),
            model: lens.model.name().to_owned(),
            image_size: [lens.width, lens.height],
            focal: lens.focal.to_array(),
            centre: lens.centre.to_array(),
            distortion: pairs.map(|(n, v)| ((*n).to_owned(), v)).collect(),
            max_theta: None,
            sigma: BTreeMap::new(),
            sharpness: None,
            quality: None,
        }
    }

    /// Reads the bytes of `file`.
    ///
    /// # Errors
    /// The file is larger than 1 MiB, not JSON, or has invalid values.
    pub fn parse(file: &str, bytes: &[u8]) -> Result<Self, CalibrationFileError> {
        if bytes.len() > MAX_FILE_BYTES {
            return Err(CalibrationFileError::Unusable {
                file: file.to_owned(),
                reason: "more than 1 MiB; is it the right file?".to_owned(),
            });
        }
        let record: Self =
            serde_json::from_slice(bytes).map_err(|e| CalibrationFileError::NotJson {
                file: file.to_owned(),
                line: e.line(),
                column: e.column(),
                reason: e.to_string(),
            })?;
        record.lens(file)?;
        record.spread(file)?;
        Ok(record)
    }

    /// Returns the spread of a pixel, if it was measured; `file` is used in the error.
    ///
    /// # Errors
    /// No camera has such weights.
    pub fn spread(&self, file: &str) -> Result<Option<PointSpread>, CalibrationFileError> {
        let Some(record) = &self.sharpness else {
            return Ok(None);
        };
        let spread = PointSpread {
            across: record.across,
            down: record.down,
        };
        let wrong = || CalibrationFileError::Wrong {
            file: file.to_owned(),
            key: "sharpness",
            expected: "`across` and `down`, each three weights from -1 to 2 with w0 + 2 w1 + 2 w2 = 1",
        };
        spread
            .is_possible()
            .then_some(Some(spread))
            .ok_or_else(wrong)
    }

    /// Returns the lens; `file` is used in the error.
    ///
    /// # Errors
    /// The version or model is unknown, or a number is out of range.
    pub fn lens(&self, file: &str) -> Result<Lens, CalibrationFileError> {
        let wrong = |key, expected| CalibrationFileError::Wrong {
            file: file.to_owned(),
            key,
            expected,
        };
        if self.penumbra_calibration != VERSION {
            return Err(wrong(
                "penumbra_calibration",
                "1: it is of a newer Penumbra",
            ));
        }
        let model = LensModel::from_name(&self.model)
            .ok_or_else(|| wrong("model", "\"brown\", \"brown-rational\" or \"fisheye\""))?;
        let [width, height] = self.image_size;
        if !(1..=MAX_SIDE_PIXELS).contains(&width) || !(1..=MAX_SIDE_PIXELS).contains(&height) {
            return Err(wrong("image_size", "[width, height] in pixels, 1 to 65536"));
        }
        let (focal, centre) = (DVec2::from(self.focal), DVec2::from(self.centre));
        if !(focal.min_element() >= 1.0 && focal.max_element() <= MAX_MAGNITUDE) {
            return Err(wrong("focal", "[fx, fy], 1 to 1e6 pixels"));
        }
        if !centre.is_finite() || centre.abs().max_element() > MAX_MAGNITUDE {
            return Err(wrong("centre", "[cx, cy] in pixels"));
        }
        if self
            .max_theta
            .is_some_and(|t| !(t > 0.0 && t <= std::f64::consts::PI))
        {
            return Err(wrong("max_theta", "radians, above 0 and at most pi"));
        }
        let mut lens = Lens::ideal(model, (width, height), focal, centre);
        let names = model.coefficients();
        if self.distortion.keys().any(|k| !names.contains(&k.as_str())) {
            return Err(wrong(
                "distortion",
                "an object with the model's coefficients",
            ));
        }
        for (slot, name) in lens.coefficients.iter_mut().zip(names) {
            *slot = self.distortion.get(*name).copied().unwrap_or(0.0);
        }
        if lens.coefficients.iter().any(|k| k.abs() > MAX_MAGNITUDE) {
            return Err(wrong("distortion", "an object of numbers of at most 1e6"));
        }
        Ok(lens)
    }
}

#[cfg(test)]
mod tests;
