//! Checks that distinguish measured numbers from misread bytes: finite, a unit quaternion,
//! within range.

use crate::framing::Fault;
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;

/// A pose from a position in metres, which must lie within `envelope_metres` of the origin.
pub(crate) fn pose(
    rotation: DQuat,
    translation: DVec3,
    envelope_metres: f64,
) -> Result<RigidTransform, Fault> {
    // Not `>`: a comparison with NaN is false either way, and NaN must be refused.
    if translation.length() <= envelope_metres {
        Ok(RigidTransform::new(rotation, translation))
    } else {
        Err(Fault::Implausible)
    }
}

/// A rotation from a quaternion whose norm is 1 within `tolerance`: the rounding of the
/// device's digits.
pub(crate) fn rotation_from_quaternion(
    [w, x, y, z]: [f64; 4],
    tolerance: f64,
) -> Result<DQuat, Fault> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    let length = quaternion.length();
    if (length - 1.0).abs() <= tolerance {
        Ok(quaternion * (1.0 / length))
    } else {
        Err(Fault::Implausible)
    }
}

/// R = Rz(azimuth) · Ry(elevation) · Rx(roll) from degrees, as Polhemus and Ascension define
/// their angles.
pub(crate) fn rotation_from_euler([azimuth, elevation, roll]: [f64; 3]) -> Result<DQuat, Fault> {
    // Rounding to two decimals may exceed the range by half a hundredth.
    const SLACK: f64 = 0.011;
    let possible = azimuth.abs() <= 180.0 + SLACK
        && elevation.abs() <= 90.0 + SLACK
        && roll.abs() <= 180.0 + SLACK;
    if !possible {
        return Err(Fault::Implausible);
    }
    Ok(DQuat::from_euler(
        EulerRot::ZYX,
        azimuth.to_radians(),
        elevation.to_radians(),
        roll.to_radians(),
    ))
}

/// `N` little-endian single-precision numbers from the front of `bytes`, all finite.
pub(crate) fn floats<const N: usize>(bytes: &[u8]) -> Result<[f64; N], Fault> {
    let mut values = [0.0; N];
    let (columns, _) = bytes.as_chunks::<4>();
    if columns.len() < N {
        return Err(Fault::Layout);
    }
    for (value, column) in values.iter_mut().zip(columns) {
        *value = f64::from(f32::from_le_bytes(*column));
        if !value.is_finite() {
            return Err(Fault::Implausible);
        }
    }
    Ok(values)
}
