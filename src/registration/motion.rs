//! Small motions of a camera about its own position, in world axes.

use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::rotation_vector;

/// Rotates `pose` by the rotation vector `rotation` (radians) about the camera's position, and moves
/// the camera by `translation` (metres).
pub(crate) fn moved(pose: RigidTransform, rotation: DVec3, translation: DVec3) -> RigidTransform {
    RigidTransform::new(
        (DQuat::from_scaled_axis(rotation) * pose.rotation).normalize(),
        pose.translation + translation,
    )
}

/// The rotation vector and translation with `moved(from, …) = to`.
pub(crate) fn difference(from: &RigidTransform, to: &RigidTransform) -> (DVec3, DVec3) {
    (
        rotation_vector(to.rotation * from.rotation.inverse()),
        to.translation - from.translation,
    )
}
