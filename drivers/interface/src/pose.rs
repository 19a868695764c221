//! Poses.

use crate::time::MonotonicTime;
use glam::{DMat4, DQuat, DVec3};

/// A rigid transform `a_from_b`: `p_a = rotation * p_b + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidTransform {
    /// Rotation, a unit quaternion.
    pub rotation: DQuat,
    /// Translation, metres.
    pub translation: DVec3,
}

impl RigidTransform {
    /// The identity.
    pub const IDENTITY: Self = Self {
        rotation: DQuat::IDENTITY,
        translation: DVec3::ZERO,
    };

    /// From a rotation and a translation in metres.
    #[must_use]
    pub const fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self {
            rotation,
            translation,
        }
    }

    /// From a matrix whose upper 3×3 part is a rotation.
    #[must_use]
    pub fn from_matrix(matrix: DMat4) -> Self {
        let (_, rotation, translation) = matrix.to_scale_rotation_translation();
        Self {
            rotation,
            translation,
        }
    }

    /// The transform as a 4×4 matrix.
    #[must_use]
    pub fn to_matrix(self) -> DMat4 {
        DMat4::from_rotation_translation(self.rotation, self.translation)
    }

    /// The inverse: `b_from_a` of `a_from_b`.
    #[must_use]
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.inverse();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// Transforms a point from frame b to frame a.
    #[must_use]
    pub fn transform_point(self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

impl std::ops::Mul for RigidTransform {
    type Output = Self;
    /// `a_from_b * b_from_c = a_from_c`.
    fn mul(self, rhs: Self) -> Self {
        Self {
            rotation: (self.rotation * rhs.rotation).normalize(),
            translation: self.transform_point(rhs.translation),
        }
    }
}

/// One record of a tracker: the pose of a sensor in the frame of the transmitter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseSample {
    /// The tracker's number of the receiver, from 1.
    pub station: u8,
    /// `transmitter_from_sensor`, metres.
    pub transmitter_from_sensor: RigidTransform,
    /// When the last byte of the record arrived.
    pub arrived_at: MonotonicTime,
    /// The device's error letter, if it sent one. Some devices repeat the last error in every
    /// record, so it is to be displayed but no reason to discard the record.
    pub error: Option<u8>,
}
