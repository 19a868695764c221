//! Rotations as vectors.

use glam::{DQuat, DVec3};

/// The rotation vector (axis times angle, radians) of a unit quaternion, with an angle of at most π.
#[must_use]
pub fn rotation_vector(rotation: DQuat) -> DVec3 {
    // q and −q are the same rotation; the one with w ≥ 0 has the smaller angle.
    let shortest = if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    };
    shortest.to_scaled_axis()
}
