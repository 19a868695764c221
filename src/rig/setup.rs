//! The rig of one run: calibration, scene and pose source, with the configuration's overrides.

use crate::error::RigError;
use crate::markers::{pose_source, tag_map_for};
use crate::source::Source;
use penumbra_config::{Config, PoseSource};
use penumbra_fiducials::TagMap;
use penumbra_interface::RigidTransform;
use penumbra_rig_model::lens_files::{ENVIRONMENT_LENS, SCENE_LENS};
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_rig_model::{RigCalibration, RigDocument, RigFilesError};
use penumbra_scene::Scene;
use penumbra_sync::{PoseAt, RigFrame};

/// The rig as described by its files and the configuration.
#[derive(Clone)]
pub struct RigSetup {
    /// Calibration with the configuration's overrides.
    pub calibration: RigCalibration,
    /// Virtual objects and phantoms.
    pub scene: Scene,
    /// Source of the scene camera's pose; never [`PoseSource::Auto`].
    pub pose: PoseSource,
    /// `world_from_scene_camera` for [`PoseSource::Fixed`].
    pub fixed_pose: Option<RigidTransform>,
    /// Map of the fiducials; `None` if the pose comes from the tracker alone.
    pub tags: Option<TagMap>,
    /// Whether the rig has calibration files.
    pub calibrated: bool,
    /// Whether the lens calibrations of both cameras name the same product.
    pub same_product: bool,
}

/// Number of pixels that a picture may have whatever the calibration: 16 Mpixel.
const ALWAYS_ALLOWED_PIXELS: u64 = 16 << 20;

/// Returns the maximum number of pixels of a camera's pictures. A calibrated camera may have been
/// set to another mode, but not to any.
pub(crate) fn max_pixels(calibrated: (u32, u32)) -> u64 {
    let (width, height) = calibrated;
    let calibrated = u64::from(width) * u64::from(height);
    ALWAYS_ALLOWED_PIXELS.max(4 * calibrated)
}

impl RigSetup {
    /// Returns the maximum number of pixels of the scene camera's pictures.
    pub(crate) fn max_scene_pixels(&self) -> u64 {
        let camera = &self.calibration.scene_camera.camera;
        max_pixels((camera.width, camera.height))
    }

    /// Reads calibration and scene from `source` and `config`.
    ///
    /// # Errors
    /// A calibration, object or scene file is missing or invalid.
    pub fn read(source: &Source, config: &Config) -> Result<Self, RigError> {
        let attachments = |name: &str| source.attachment(name);
        let document = rig_document(source, config)?;
        let scene = document.chosen_scene(&config.scene, &attachments)?;
        let mut calibration = calibration(&document, config);
        let has_tracker = calibration.tracker.is_some();
        let pose = pose_source(&document.markers, has_tracker, config)?;
        let tags = tag_map_for(&document.markers, pose)?;
        if matches!(pose, PoseSource::Markers | PoseSource::Fixed) {
            // Pairing must not wait for a tracker that is not used.
            calibration.tracker = None;
        }
        Ok(Self {
            calibration,
            pose,
            fixed_pose: config.registration.fixed,
            tags,
            calibrated: ["rig.json", SCENE_LENS]
                .iter()
                .any(|file| source.attachment(file).is_some()),
            scene,
            same_product: name_same_product(|file| source.attachment(file)),
        })
    }

    /// Returns the scene camera's pose of a paired frame by the tracker, or as stated; `None` if the
    /// frame has no tracker pose or the tracker is not used.
    #[must_use]
    pub fn world_from_camera(&self, frame: &RigFrame) -> Option<RigidTransform> {
        match self.pose {
            PoseSource::Markers => return None,
            PoseSource::Fixed => return self.fixed_pose,
            PoseSource::Auto | PoseSource::Tracker | PoseSource::Hybrid => (),
        }
        Some(self.world_from_scene_camera(frame.pose.as_ref()?.transmitter_from_sensor))
    }

    /// Returns `world_from_scene_camera` for a pose of the tracker's sensor.
    pub(crate) fn world_from_scene_camera(
        &self,
        transmitter_from_sensor: RigidTransform,
    ) -> RigidTransform {
        let tracker = self.calibration.tracker.as_ref();
        let sensor = transmitter_from_sensor;
        tracker.map_or(sensor, |t| t.world_from_scene_camera(sensor))
    }
}

/// Whether the lens calibrations of both cameras name the same product.
fn name_same_product<'a>(attachment: impl Fn(&str) -> Option<&'a [u8]>) -> bool {
    let product = |file: &str| {
        let record = LensRecord::parse(file, attachment(file)?).ok()?;
        Some(record.device?.name)
    };
    product(SCENE_LENS).is_some_and(|scene| product(ENVIRONMENT_LENS) == Some(scene))
}

/// Reads the description of the rig, with the configured source of light.
///
/// # Errors
/// A file of the rig is invalid, or the rig lacks that source.
pub(crate) fn rig_document(source: &Source, config: &Config) -> Result<RigDocument, RigError> {
    let mut document = source.document(config)?;
    let camera_recorded = source.has_environment();
    document
        .select_environment(config.environment.source, camera_recorded)
        .map_err(RigFilesError::from)?;
    Ok(document)
}

/// Assumed pose noise of a tracker that does not report any: metres, radians (1σ).
pub(crate) const TRACKER_NOISE: [f64; 2] = [2e-4, 3e-4];

impl RigSetup {
    /// Returns the standard deviations per axis of the scene camera's pose by the tracker: metres,
    /// radians.
    pub(crate) fn tracker_noise(&self, frame: &RigFrame) -> Option<[f64; 2]> {
        let total = self.camera_noise(frame.pose.as_ref()?)?;
        Some(total.map(|sigma| sigma / 3.0_f64.sqrt()))
    }

    /// Returns the standard deviations over all axes of the scene camera's pose for a tracker pose:
    /// metres, radians. The camera is mounted at a distance from the sensor, so rotation noise of
    /// the sensor displaces it.
    pub(crate) fn camera_noise(&self, pose: &PoseAt) -> Option<[f64; 2]> {
        let [metres, radians] = pose.sigma?;
        let tracker = self.calibration.tracker.as_ref();
        let lever = tracker.map_or(0.0, |t| t.sensor_from_scene_camera.translation.length());
        Some([metres.hypot(radians * lever), radians])
    }
}

/// Returns the calibration of `document` with the configuration's overrides.
fn calibration(document: &RigDocument, config: &Config) -> RigCalibration {
    let mut rig = document.calibration.clone();
    if let Some(curve) = &config.scene_camera.response {
        rig.scene_camera.response = curve.response();
    }
    if let Some(latency) = config.sync.scene_camera_latency_nanos {
        rig.scene_camera.latency_nanos = latency;
    }
    if let (Some(tracker), Some(latency)) = (&mut rig.tracker, config.sync.tracker_latency_nanos) {
        tracker.latency_nanos = latency;
    }
    if let Some(environment) = &mut rig.environment {
        if let Some(curve) = &config.environment.response {
            environment.response = curve.response();
        }
        if let Some(brackets) = &config.environment.brackets_ev {
            environment.brackets_ev.clone_from(brackets);
        }
        if let Some(latency) = config.sync.environment_camera_latency_nanos {
            environment.latency_nanos = latency;
        }
    }
    rig
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use penumbra_camera::{Lens, LensModel};
    use penumbra_rig_model::DeviceRecord;

    fn record(name: Option<&str>) -> Vec<u8> {
        let (focal, centre) = (DVec2::splat(50.0), DVec2::new(32.0, 24.0));
        let lens = Lens::ideal(LensModel::Brown, (64, 48), focal, centre);
        let device = name.map(|name| DeviceRecord {
            name: name.to_owned(),
            serial: None,
        });
        let record = LensRecord::from_lens(&lens, "scene", String::new());
        serde_json::to_vec(&LensRecord { device, ..record }).unwrap()
    }

    #[test]
    fn lens_calibrations_tell_whether_both_cameras_are_the_same_product() {
        let told = |scene: Option<&str>, environment: Option<&str>| {
            let (scene, environment) = (record(scene), record(environment));
            name_same_product(|file| {
                Some(if file == SCENE_LENS {
                    &scene
                } else {
                    &environment
                })
            })
        };
        assert!(told(Some("HD USB Camera"), Some("HD USB Camera")));
        assert!(!told(Some("HD USB Camera"), Some("C930e")));
        assert!(!told(None, None));
        let scene = record(Some("C930e"));
        assert!(!name_same_product(
            |file| (file == SCENE_LENS).then_some(&scene)
        ));
    }
}
