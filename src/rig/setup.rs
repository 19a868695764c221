//! The rig of one run: calibration, scene and pose source, with the configuration's overrides.

use crate::error::RigError;
use crate::markers::{pose_source, wanted_tags};
use crate::source::Source;
use penumbra_config::{Config, PoseSource};
use penumbra_fiducials::TagMap;
use penumbra_interface::RigidTransform;
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_rig_model::{RigCalibration, RigDocument, RigFilesError};
use penumbra_scene::Scene;
use penumbra_sync::{PoseAt, RigFrame};

/// What a session and a configuration say about the rig, made true.
#[derive(Clone)]
pub struct RigSetup {
    /// Calibration with the configuration's overrides.
    pub calibration: RigCalibration,
    /// What is drawn.
    pub scene: Scene,
    /// What tells the scene camera's pose; never [`PoseSource::Auto`].
    pub pose: PoseSource,
    /// Fiducials by which it is found, instead of a tracker or beside one.
    pub tags: Option<TagMap>,
    /// Somebody has calibrated the rig.
    pub calibrated: bool,
}

impl RigSetup {
    /// Reads calibration and scene from `source` and `config`.
    ///
    /// # Errors
    /// A missing or broken calibration, object or scene file.
    pub fn read(source: &Source, config: &Config) -> Result<Self, RigError> {
        let attachments = |name: &str| source.attachment(name);
        let mut document = source.document(config)?;
        let camera_recorded = source.has_environment();
        document
            .select_environment(config.environment.source, camera_recorded)
            .map_err(RigFilesError::from)?;
        let scene = document.chosen_scene(&config.scene, &attachments)?;
        let mut calibration = calibration(&document, config);
        let tracker = calibration.tracker.is_some();
        let pose = pose_source(&document.markers, tracker, config)?;
        let tags = wanted_tags(&document.markers, pose)?;
        if pose == PoseSource::Markers {
            // Nothing waits for a tracker that nobody asks.
            calibration.tracker = None;
        }
        Ok(Self {
            calibration,
            pose,
            tags,
            calibrated: ["rig.json", SCENE_LENS]
                .iter()
                .any(|file| source.attachment(file).is_some()),
            scene,
        })
    }

    /// The scene camera's pose for a paired frame, if the sensor's is known.
    #[must_use]
    pub fn world_from_camera(&self, frame: &RigFrame) -> Option<RigidTransform> {
        if self.pose == PoseSource::Markers {
            return None;
        }
        Some(self.camera_of(frame.pose.as_ref()?.transmitter_from_sensor))
    }

    /// The scene camera's pose, the tracker's sensor being there.
    pub(crate) fn camera_of(&self, transmitter_from_sensor: RigidTransform) -> RigidTransform {
        let tracker = self.calibration.tracker.as_ref();
        let sensor = transmitter_from_sensor;
        tracker.map_or(sensor, |t| t.world_from_scene_camera(sensor))
    }
}

/// Noise of a pose by a tracker that tells none: metres, radians.
pub(crate) const TRACKER_NOISE: [f64; 2] = [2e-4, 3e-4];

impl RigSetup {
    /// Standard deviations, along an axis, of the noise of the scene camera's pose by the
    /// tracker: metres, radians.
    pub(crate) fn tracker_noise(&self, frame: &RigFrame) -> Option<[f64; 2]> {
        let over_all = self.camera_noise(frame.pose.as_ref()?)?;
        Some(over_all.map(|all| all / 3.0_f64.sqrt()))
    }

    /// Standard deviations over all axes of the scene camera's pose by one of the tracker:
    /// metres, radians. The camera stands off the sensor, so that the sensor's turn moves it.
    pub(crate) fn camera_noise(&self, pose: &PoseAt) -> Option<[f64; 2]> {
        let [metres, radians] = pose.sigma?;
        let tracker = self.calibration.tracker.as_ref();
        let lever = tracker.map_or(0.0, |t| t.sensor_from_scene_camera.translation.length());
        Some([metres.hypot(radians * lever), radians])
    }
}

/// The session's calibration with what the configuration overrides.
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
