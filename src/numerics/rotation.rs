//! Rotation vectors.

use glam::{DQuat, DVec3};

/// Returns the rotation vector (axis times angle, radians) of a unit quaternion; the angle is at
/// most π.
#[must_use]
pub fn rotation_vector(rotation: DQuat) -> DVec3 {
    // q and −q are the same rotation; that with w ≥ 0 has the smaller angle.
    let shortest = if rotation.w < 0.0 {
        -rotation
    } else {
        rotation
    };
    shortest.to_scaled_axis()
}
