//! Poses of the receivers of all simulated magnetic trackers.

use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;

/// `transmitter_from_receiver` of receiver `index` (from 0): all receivers are mounted on one
/// body, 10 cm apart along its y axis.
pub(crate) fn receiver_pose(transmitter_from_body: RigidTransform, index: usize) -> RigidTransform {
    let offset = DVec3::Y * (0.1 * index as f64);
    transmitter_from_body * RigidTransform::new(DQuat::IDENTITY, offset)
}

/// The pose as a device with this hemisphere reports it. The magnetic field is the same at a
/// point and at its mirror image through the transmitter, so a receiver outside the hemisphere
/// is reported at its mirror image. A hemisphere of zeros means that the device tracks the
/// hemisphere itself.
pub(crate) fn in_hemisphere(pose: RigidTransform, hemisphere: DVec3) -> RigidTransform {
    if hemisphere.dot(pose.translation) < 0.0 {
        RigidTransform::new(pose.rotation, -pose.translation)
    } else {
        pose
    }
}
