//! The layout of a record, and the checks that it must pass.

use super::status::{STATUS_LEN, is_status};
use crate::framing::{Fault, Framing, Reading, Verdict};
use crate::plausible::{self, floats, rotation_from_euler, rotation_from_quaternion};
use crate::units::METRES_PER_INCH;
use glam::DVec3;

/// How numbers are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Fixed columns: `Sxxx.xx`, for quaternions `Sx.xxxx` (command `F`).
    Ascii,
    /// `Sx.xxxxxESxx` and a blank for every number (items 52, 54 and 61).
    AsciiExtended,
    /// IEEE-754 single precision, little-endian (command `f`).
    Binary,
}

/// How the orientation is given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Orientation {
    /// Azimuth, elevation and roll in degrees (item 4).
    Euler,
    /// W, X, Y, Z (item 11).
    Quaternion,
}

/// How a record ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Carriage return and line feed (item 1).
    CrLf,
    /// A blank (item 0), as VRPN uses it.
    Space,
}

/// The configured record format, and the range of plausible positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Text or floats.
    pub encoding: Encoding,
    /// Euler angles or a quaternion.
    pub orientation: Orientation,
    /// Last item of the output list.
    pub ending: Ending,
    /// Metres per unit of position: [`METRES_PER_INCH`](super::METRES_PER_INCH) or
    /// [`METRES_PER_CENTIMETRE`](super::METRES_PER_CENTIMETRE).
    pub metres_per_unit: f64,
    /// A position further than this from the transmitter is implausible, metres. The device
    /// measures nothing useful at that distance.
    pub envelope_metres: f64,
}

impl Default for Format {
    /// The factory settings: text, inches, Euler angles, one line per record (47 bytes).
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

/// Length of the header, bytes: `'0'`, station, error.
const HEADER: usize = 3;
/// Stations of one system electronics unit.
const STATIONS: std::ops::RangeInclusive<u8> = b'1'..=b'4';

impl Format {
    /// The format for a protocol name, with inches: a recording does not name its units, the
    /// rig calibration does. `None` for a name of another protocol.
    #[must_use]
    pub fn for_protocol(name: &str) -> Option<Self> {
        use {Encoding::*, Orientation::*};
        let (encoding, orientation, ending) = match name {
            "fastrak" => (Ascii, Euler, Ending::CrLf),
            "fastrak-ascii-quaternion" => (Ascii, Quaternion, Ending::CrLf),
            "fastrak-ascii-extended-euler" => (AsciiExtended, Euler, Ending::CrLf),
            "fastrak-ascii-extended-quaternion" => (AsciiExtended, Quaternion, Ending::CrLf),
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

    /// Length of a record, bytes.
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
            Encoding::AsciiExtended => 13,
            Encoding::Binary => 4,
        }
    }

    const fn orientation_values(&self) -> usize {
        match self.orientation {
            Orientation::Euler => 3,
            Orientation::Quaternion => 4,
        }
    }

    /// Decodes exactly one record.
    ///
    /// # Errors
    /// [`Fault::Layout`] if the bytes are not laid out as a record, [`Fault::Implausible`] if
    /// its numbers are impossible.
    pub fn parse(&self, bytes: &[u8]) -> Result<Reading, Fault> {
        let (station, error) = self.parse_header(bytes)?;
        let body = bytes.get(HEADER..).ok_or(Fault::Layout)?;
        let (position, orientation) = body
            .split_at_checked(3 * self.value_len())
            .ok_or(Fault::Layout)?;
        let position = DVec3::from_array(self.values::<3>(position, 2)?);
        let rotation = match self.orientation {
            Orientation::Euler => rotation_from_euler(self.values::<3>(orientation, 2)?)?,
            Orientation::Quaternion => {
                rotation_from_quaternion(self.values::<4>(orientation, 4)?, 0.01)?
            }
        };
        let translation = position * self.metres_per_unit;
        Ok(Reading {
            station,
            error,
            transmitter_from_sensor: plausible::pose(rotation, translation, self.envelope_metres)?,
        })
    }

    /// Checks length and ending; the station number and the error letter.
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

    /// The first `N` numbers of `bytes`. They are found by columns, because a minus sign may
    /// follow the previous number without a blank.
    fn values<const N: usize>(&self, bytes: &[u8], decimals: usize) -> Result<[f64; N], Fault> {
        if self.encoding == Encoding::Binary {
            return floats(bytes);
        }
        let mut values = [0.0; N];
        let columns = bytes.chunks_exact(self.value_len());
        if columns.len() < N {
            return Err(Fault::Layout);
        }
        for (value, column) in values.iter_mut().zip(columns) {
            let read = match self.encoding {
                Encoding::AsciiExtended => scientific(column),
                _ => fixed_point(column, decimals),
            };
            *value = read.ok_or(Fault::Layout)?;
        }
        Ok(values)
    }
}

impl Framing for Format {
    fn classify(&self, _previous: Option<u8>, bytes: &[u8]) -> Verdict {
        match bytes {
            [b'0', ..] => {}
            [b'2', ..] => return classify_status(bytes),
            _ => return Verdict::noise(Fault::Layout),
        }
        let len = self.record_len();
        match bytes.get(..len).map(|record| self.parse(record)) {
            Some(Ok(reading)) => Verdict::Reading { len, reading },
            Some(Err(fault)) => Verdict::noise(fault),
            None => Verdict::Incomplete,
        }
    }
}

/// A status record comes between readings when it was asked for.
fn classify_status(bytes: &[u8]) -> Verdict {
    match bytes.get(..STATUS_LEN) {
        Some(status) if is_status(status) => Verdict::NoPose { len: STATUS_LEN },
        None if matches!(bytes, [_] | [_, b'1'..=b'4'] | [_, b'1'..=b'4', b'S', ..]) => {
            Verdict::Incomplete
        }
        _ => Verdict::noise(Fault::Layout),
    }
}

/// The third byte: a blank, or a letter of the built-in test.
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
    let (integer, fraction) = (column.get(..point)?, column.get(point + 1..)?);
    let unsigned = integer.trim_ascii_start();
    let (negative, digits) = match unsigned.split_first()? {
        (b'-', digits) => (true, digits),
        (b'+', digits) => (false, digits),
        _ => (false, unsigned),
    };
    let well_formed = column.get(point) == Some(&b'.')
        && !digits.is_empty()
        && digits.iter().chain(fraction).all(u8::is_ascii_digit);
    if !well_formed {
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

/// `Sx.xxxxxESxx` and a blank; a finite number.
fn scientific(column: &[u8]) -> Option<f64> {
    let (number, blank) = column.split_at_checked(column.len().checked_sub(1)?)?;
    let well_formed = blank == b" " && number.get(2) == Some(&b'.') && number.get(8) == Some(&b'E');
    let text = str::from_utf8(number).ok()?.trim_start();
    text.parse::<f64>()
        .ok()
        .filter(|v| well_formed && v.is_finite())
}

#[cfg(test)]
mod tests;
