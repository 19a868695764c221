//! One record: its layout, and what makes it a believable one.

use super::METRES_PER_INCH;
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;
use thiserror::Error;

/// How the numbers are spelt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Fixed columns: `Sxxx.xx`, for quaternions `Sx.xxxx` (command `F`).
    Ascii,
    /// IEEE-754 single precision, little-endian (command `f`).
    Binary,
}

/// How the orientation is spelt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// Azimuth, elevation and roll in degrees (item 4).
    Euler,
    /// W, X, Y, Z (item 11).
    Quaternion,
}

/// What closes a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Carriage return and line feed (item 1).
    CrLf,
    /// A blank (item 0), as VRPN asks for.
    Space,
}

/// What the device was told to send, and what of it can be believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Text or floats.
    pub encoding: Encoding,
    /// Angles or a quaternion.
    pub orientation: Orientation,
    /// Last item of the output list.
    pub ending: Ending,
    /// Metres per unit of position: [`METRES_PER_INCH`](super::METRES_PER_INCH) or
    /// [`METRES_PER_CENTIMETRE`](super::METRES_PER_CENTIMETRE).
    pub metres_per_unit: f64,
    /// A position further than this from the transmitter is no reading, metres. The
    /// device's field is useless long before.
    pub envelope_metres: f64,
}

impl Default for Format {
    /// The factory's: text, inches, angles, one line per record (47 bytes).
    fn default() -> Self {
        Self {
            encoding: Encoding::Ascii,
            orientation: Orientation::Euler,
            ending: Ending::CrLf,
            metres_per_unit: METRES_PER_INCH,
            envelope_metres: 8.0,
        }
    }
}

/// Bytes before the first number: `'0'`, station, error.
const HEADER: usize = 3;
/// Stations of one system electronics unit.
const STATIONS: std::ops::RangeInclusive<u8> = b'1'..=b'4';

impl Format {
    /// The format that a recording's protocol name stands for; units are the rig's to say.
    /// `None` for a name of another protocol.
    #[must_use]
    pub fn for_protocol(name: &str) -> Option<Self> {
        use {Encoding::*, Orientation::*};
        let (encoding, orientation, ending) = match name {
            "fastrak" => (Ascii, Euler, Ending::CrLf),
            "fastrak-ascii-quaternion" => (Ascii, Quaternion, Ending::CrLf),
            "fastrak-binary-euler" => (Binary, Euler, Ending::Space),
            "fastrak-binary-quaternion" => (Binary, Quaternion, Ending::Space),
            _ => return None,
        };
        Some(Self {
            encoding,
            orientation,
            ending,
            ..Self::default()
        })
    }

    /// Bytes of one record.
    #[must_use]
    pub const fn record_len(&self) -> usize {
        let values = 3 + self.orientation_values();
        let ending = match self.ending {
            Ending::CrLf => 2,
            Ending::Space => 1,
        };
        HEADER + values * self.value_len() + ending
    }

    const fn value_len(&self) -> usize {
        match self.encoding {
            Encoding::Ascii => 7,
            Encoding::Binary => 4,
        }
    }

    const fn orientation_values(&self) -> usize {
        match self.orientation {
            Orientation::Euler => 3,
            Orientation::Quaternion => 4,
        }
    }

    /// Reads exactly one record.
    ///
    /// # Errors
    /// [`Fault::Layout`] if the bytes are not laid out as a record, [`Fault::Implausible`]
    /// if they are but no device can have meant them.
    pub fn parse(&self, bytes: &[u8]) -> Result<Record, Fault> {
        let (station, error) = self.parse_header(bytes)?;
        let body = bytes.get(HEADER..).ok_or(Fault::Layout)?;
        let (position, orientation) = body
            .split_at_checked(3 * self.value_len())
            .ok_or(Fault::Layout)?;
        let position = DVec3::from_array(self.values::<3>(position, 2)?);
        let rotation = match self.orientation {
            Orientation::Euler => rotation_from_euler(self.values::<3>(orientation, 2)?)?,
            Orientation::Quaternion => rotation_from_quaternion(self.values::<4>(orientation, 4)?)?,
        };
        let translation = position * self.metres_per_unit;
        let pose = RigidTransform::new(rotation, translation);
        if translation.is_finite() && translation.length() <= self.envelope_metres {
            Ok(Record {
                station,
                error,
                transmitter_from_sensor: pose,
            })
        } else {
            Err(Fault::Implausible)
        }
    }

    /// Station number and error letter, with length and ending checked.
    fn parse_header(&self, bytes: &[u8]) -> Result<(u8, Option<u8>), Fault> {
        let ended = match self.ending {
            Ending::CrLf => bytes.ends_with(b"\r\n"),
            Ending::Space => bytes.ends_with(b" "),
        };
        if bytes.len() != self.record_len() || !ended {
            return Err(Fault::Layout);
        }
        match *bytes {
            [b'0', station, error, ..] if STATIONS.contains(&station) => {
                Ok((station - b'0', error_letter(error)?))
            }
            _ => Err(Fault::Layout),
        }
    }

    /// The first `N` numbers of `bytes`, by columns: a minus sign may touch the number
    /// before it, so blanks do not part them.
    fn values<const N: usize>(&self, bytes: &[u8], decimals: usize) -> Result<[f64; N], Fault> {
        let mut values = [0.0; N];
        let columns = bytes.chunks_exact(self.value_len());
        if columns.len() < N {
            return Err(Fault::Layout);
        }
        for (value, column) in values.iter_mut().zip(columns) {
            *value = match self.encoding {
                Encoding::Ascii => fixed_point(column, decimals).ok_or(Fault::Layout)?,
                Encoding::Binary => float(column).ok_or(Fault::Implausible)?,
            };
        }
        Ok(values)
    }
}

/// One reading, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Record {
    /// Receiver, from 1 to 4.
    pub station: u8,
    /// The last error that the built-in test found. It stays until cleared and says
    /// nothing about this very record.
    pub error: Option<u8>,
    /// Pose of the receiver, metres.
    pub transmitter_from_sensor: RigidTransform,
}

/// Why bytes are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Fault {
    /// Wrong byte in a fixed place.
    #[error("not laid out as a FASTRAK record")]
    Layout,
    /// Numbers that cannot be.
    #[error("a FASTRAK record with impossible numbers")]
    Implausible,
}

/// Third byte: a blank, or a letter of the built-in test.
fn error_letter(byte: u8) -> Result<Option<u8>, Fault> {
    match byte {
        b' ' => Ok(None),
        letter if letter.is_ascii_alphabetic() => Ok(Some(letter)),
        _ => Err(Fault::Layout),
    }
}

/// `Sxxx.xx`: blanks, at most one sign, digits, a point, exactly `decimals` digits.
fn fixed_point(column: &[u8], decimals: usize) -> Option<f64> {
    let point = column.len().checked_sub(decimals + 1)?;
    let (whole, fraction) = (column.get(..point)?, column.get(point + 1..)?);
    let unsigned = whole.trim_ascii_start();
    let (negative, digits) = match unsigned.split_first()? {
        (b'-', digits) => (true, digits),
        (b'+', digits) => (false, digits),
        _ => (false, unsigned),
    };
    let spelt_right = column.get(point) == Some(&b'.')
        && !digits.is_empty()
        && digits.iter().chain(fraction).all(u8::is_ascii_digit);
    if !spelt_right {
        return None;
    }
    let scaled = digits
        .iter()
        .chain(fraction)
        .fold(0_i64, |sum, digit| 10 * sum + i64::from(digit - b'0'));
    // Divided, not multiplied by 0.01, so that the value is the closest double to the text.
    let value = scaled as f64 / 10_f64.powi(i32::try_from(decimals).ok()?);
    Some(if negative { -value } else { value })
}

/// A finite little-endian single.
fn float(column: &[u8]) -> Option<f64> {
    let value = f32::from_le_bytes(column.try_into().ok()?);
    value.is_finite().then_some(f64::from(value))
}

/// The manual's R = Rz(azimuth) · Ry(elevation) · Rx(roll), degrees.
fn rotation_from_euler([azimuth, elevation, roll]: [f64; 3]) -> Result<DQuat, Fault> {
    // Rounding to two decimals may print a hair more than the range.
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

/// A quaternion whose norm is 1 within what four decimals allow.
fn rotation_from_quaternion([w, x, y, z]: [f64; 4]) -> Result<DQuat, Fault> {
    let quaternion = DQuat::from_xyzw(x, y, z, w);
    if (quaternion.length() - 1.0).abs() > 0.01 {
        return Err(Fault::Implausible);
    }
    Ok(quaternion.normalize())
}

#[cfg(test)]
mod tests;
