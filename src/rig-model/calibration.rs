//! What the owner of a rig knows about it, once it is true.

use crate::tracker_field::TrackerField;
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_camera::Vignetting;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_fiducials::Family;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_white_balance::CalibratedGains;
use penumbra_white_balance::chart::PhotometricChart;
use std::sync::Arc;

/// Geometry and photometry of one rig. World: right-handed, metres, +Z up.
#[derive(Clone, Debug)]
pub struct RigCalibration {
    /// Free name, for status and reports.
    pub name: String,
    /// The camera whose picture is augmented.
    pub scene_camera: SceneCamera,
    /// How the environment is seen; `None` where the rig has no view of it.
    pub environment: Option<EnvironmentCamera>,
    /// What carries the mirrored sphere about, where it does not stand still.
    pub sphere_marker: Option<SphereMarker>,
    /// The 6-DOF tracker that carries the scene camera.
    pub tracker: Option<TrackerCalibration>,
    /// Pictures of the same colour chart taken by both cameras.
    pub chart: Option<PhotometricChart>,
    /// Gains between the cameras as the radiometric step found them.
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
    /// Time from the middle of the exposure to the driver's stamp, nanoseconds.
    pub latency_nanos: i64,
}

/// The environment camera: where it is and how it looks.
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
    /// Stops of the bracketed pictures relative to the base exposure, e.g. `[-4.0, -8.0]`.
    pub brackets_ev: Vec<f64>,
}

/// A mirrored ball that is fixed to a fiducial, and moves with it.
#[derive(Clone, Debug, PartialEq)]
pub struct SphereMarker {
    /// The fiducial's family.
    pub family: Family,
    /// Its number there.
    pub id: u32,
    /// Edge of its black border, metres.
    pub size: f64,
    /// The ball's centre in the fiducial's frame (+X right, +Y down, +Z into the paper), metres.
    pub centre_in_marker: DVec3,
}

/// Tracker mounting and timing.
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
    /// How the tracker's space is bent, where that was learnt.
    pub field: Option<Arc<TrackerField>>,
}

impl TrackerCalibration {
    /// `world_from_scene_camera` for a tracker reading, its distortion corrected.
    #[must_use]
    pub fn world_from_scene_camera(
        &self,
        transmitter_from_sensor: RigidTransform,
    ) -> RigidTransform {
        let straight = match &self.field {
            Some(field) => field.correct(transmitter_from_sensor),
            None => transmitter_from_sensor,
        };
        self.world_from_transmitter * straight * self.sensor_from_scene_camera
    }

    /// When a record that arrived at `arrived_at` was measured.
    #[must_use]
    pub fn measured_at(&self, arrived_at: MonotonicTime) -> MonotonicTime {
        arrived_at.offset_nanos(-self.latency_nanos)
    }
}
