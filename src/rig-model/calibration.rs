//! The calibration of a rig.

use crate::tracker_field::TrackerField;
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_camera::Vignetting;
use penumbra_camera::{CameraNoise, PinholeCamera, PointSpread, Response};
use penumbra_fiducials::Family;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_white_balance::CalibratedGains;
use penumbra_white_balance::chart::PhotometricChart;
use std::sync::Arc;

/// Geometric and radiometric calibration of a rig. World: right-handed, metres, +Z up.
#[derive(Clone, Debug)]
pub struct RigCalibration {
    /// Free name, for status and reports.
    pub name: String,
    /// The camera whose picture is augmented.
    pub scene_camera: SceneCamera,
    /// The view of the environment; `None` if the rig has none.
    pub environment: Option<EnvironmentCamera>,
    /// The fiducial that carries the mirrored sphere; `None` if the sphere stands still.
    pub sphere_marker: Option<SphereMarker>,
    /// The 6-DOF tracker that carries the scene camera.
    pub tracker: Option<TrackerCalibration>,
    /// Pictures of the same colour chart taken by both cameras.
    pub chart: Option<PhotometricChart>,
    /// Gains between the cameras from radiometric calibration.
    pub gains: Option<CalibratedGains>,
}

/// The scene camera.
#[derive(Clone, Debug)]
pub struct SceneCamera {
    /// Intrinsics.
    pub camera: PinholeCamera,
    /// Tone curve.
    pub response: Response,
    /// How bright the picture is towards its edge; `None` for evenly bright.
    pub vignetting: Option<Vignetting>,
    /// Noise; `None` if it was not measured.
    pub noise: Option<CameraNoise>,
    /// Sharpness; `None` if it was not measured.
    pub spread: Option<PointSpread>,
    /// Time from the middle of the exposure to the driver's stamp, nanoseconds.
    pub latency_nanos: i64,
}

/// The environment camera.
#[derive(Clone, Debug)]
pub struct EnvironmentCamera {
    /// Tone curve.
    pub response: Response,
    /// How bright the picture is towards its edge; `None` for evenly bright.
    pub vignetting: Option<Vignetting>,
    /// Geometry of the view.
    pub view: EnvironmentView,
    /// Time from the middle of the exposure to the driver's stamp, nanoseconds.
    pub latency_nanos: i64,
    /// Exposures of the brackets relative to the base exposure, stops, e.g. `[-4.0, -8.0]`.
    pub brackets_ev: Vec<f64>,
}

/// A fiducial to which the mirrored sphere is fixed.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereMarker {
    /// Family of the fiducial.
    pub family: Family,
    /// Number in the family.
    pub id: u32,
    /// Edge of the black border, metres.
    pub size: f64,
    /// Centre of the sphere in the fiducial's frame (+X right, +Y down, +Z into the paper), metres.
    pub centre_in_marker: DVec3,
}

/// Mounting and timing of the tracker.
#[derive(Clone, Debug)]
pub struct TrackerCalibration {
    /// Transmitter's pose in the world.
    pub world_from_transmitter: RigidTransform,
    /// Scene camera's pose in the sensor's frame (hand–eye).
    pub sensor_from_scene_camera: RigidTransform,
    /// Arrival minus measurement, nanoseconds.
    pub latency_nanos: i64,
    /// Metres per unit of the recorded position (0.0254 for inches).
    pub metres_per_unit: f64,
    /// Correction of field distortion, if calibrated.
    pub field: Option<Arc<TrackerField>>,
}

impl TrackerCalibration {
    /// Returns `world_from_scene_camera` for a tracker reading, corrected for field distortion.
    #[must_use]
    pub fn world_from_scene_camera(
        &self,
        transmitter_from_sensor: RigidTransform,
    ) -> RigidTransform {
        let corrected = match &self.field {
            Some(field) => field.correct(transmitter_from_sensor),
            None => transmitter_from_sensor,
        };
        self.world_from_transmitter * corrected * self.sensor_from_scene_camera
    }

    /// Returns the time of measurement of a record that arrived at `arrived_at`.
    #[must_use]
    pub fn measured_at(&self, arrived_at: MonotonicTime) -> MonotonicTime {
        arrived_at.offset_nanos(-self.latency_nanos)
    }
}
