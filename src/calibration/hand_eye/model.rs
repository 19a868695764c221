//! Input, result and the unknowns of hand–eye calibration.

use glam::DVec3;
use penumbra_interface::RigidTransform;
use penumbra_numerics::{median, rotation_vector};

/// Minimum number of pairs.
pub(super) const MIN_PAIRS: usize = 6;

/// Poses of tracker and camera at the same instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// The tracker's reading.
    pub transmitter_from_sensor: RigidTransform,
    /// The camera's pose, from markers or a board in the picture.
    pub world_from_camera: RigidTransform,
}

/// Result of hand–eye calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct HandEye {
    /// The camera's pose in the sensor's frame.
    pub sensor_from_camera: RigidTransform,
    /// The transmitter's pose in the world.
    pub world_from_transmitter: RigidTransform,
    /// 1σ of `sensor_from_camera`: rotation about the camera's axes, radians, and
    /// translation in the sensor's frame, metres.
    pub sensor_sigma: (DVec3, DVec3),
    /// 1σ of `world_from_transmitter`: rotation about the world's axes, radians, and
    /// translation in the world, metres.
    pub transmitter_sigma: (DVec3, DVec3),
    /// Root mean square of the rotation residuals, radians.
    pub rotation_rms: f64,
    /// Root mean square of the position residuals, metres.
    pub position_rms: f64,
    /// Whether each pair was used, in the order given; outliers were not.
    pub used: Vec<bool>,
    /// RMS rotation about the second principal axis of the motion, radians; 0 for motion about a
    /// single axis.
    pub second_axis: f64,
}

/// Both unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mounting {
    pub sensor_from_camera: RigidTransform,
    pub world_from_transmitter: RigidTransform,
}

impl Mounting {
    /// Returns the deviation of the picture's pose from the tracker's: rotation vector (radians,
    /// camera's axes) and translation (metres, world).
    pub fn residual(&self, pair: &PosePair) -> (DVec3, DVec3) {
        let by_tracker =
            self.world_from_transmitter * pair.transmitter_from_sensor * self.sensor_from_camera;
        let rotation = by_tracker.rotation.inverse() * pair.world_from_camera.rotation;
        (
            rotation_vector(rotation),
            pair.world_from_camera.translation - by_tracker.translation,
        )
    }
}

/// Returns the median of the vectors' lengths; infinity for no vectors.
pub(super) fn median_length(vectors: impl Iterator<Item = DVec3>) -> f64 {
    median(vectors.map(DVec3::length)).unwrap_or(f64::INFINITY)
}
