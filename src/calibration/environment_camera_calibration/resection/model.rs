//! Observations of known points and directions, and what is to be found from them.

use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;

/// Observations with a larger deviation are outliers, in their own standard deviations.
pub(super) const OUTLIER: f64 = 5.0;

/// A point or direction of the world that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Position, world, metres.
    Point(DVec3),
    /// Unit vector, world, of something so distant that the camera's position is irrelevant.
    Direction(DVec3),
}

/// A target observed by the environment camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Unit vector in the camera's frame.
    pub bearing: DVec3,
    /// What is observed.
    pub target: Target,
    /// Standard deviation of bearing and target together, radians.
    pub sigma: f64,
}

/// The unknowns of the resection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unknowns {
    /// The orientation; the camera's position is given (world, metres).
    Orientation(DVec3),
    /// Orientation and position.
    Pose,
    /// The orientation; a point is given in both frames.
    OrientationAbout {
        /// The point in the camera's frame, metres.
        in_camera: DVec3,
        /// The point in the world, metres.
        in_world: DVec3,
    },
}

/// Returns the direction of a target from a position, world.
pub(super) fn direction(target: Target, position: DVec3) -> DVec3 {
    match target {
        Target::Direction(d) => d,
        Target::Point(p) => (p - position).normalize_or(DVec3::Z),
    }
}

/// Returns the angle between an observation's bearing and its target, radians.
pub(super) fn deviation(seen: &Observation, pose: &RigidTransform) -> f64 {
    let world = direction(seen.target, pose.translation);
    (pose.rotation * seen.bearing).angle_between(world)
}

/// Returns the camera's position, world, if its orientation determines it.
pub(super) fn position(unknowns: Unknowns, world_from_camera: DQuat) -> Option<DVec3> {
    match unknowns {
        Unknowns::Orientation(position) => Some(position),
        Unknowns::Pose => None,
        Unknowns::OrientationAbout {
            in_camera,
            in_world,
        } => Some(in_world - world_from_camera * in_camera),
    }
}
