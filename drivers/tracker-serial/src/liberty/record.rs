//! The layout of a record.

use crate::framing::{Fault, Framing, Reading, Verdict};
use crate::plausible::{self, floats, rotation_from_euler, rotation_from_quaternion};
use crate::units::METRES_PER_INCH;
use glam::DVec3;

/// Length of the header before the body, bytes.
pub const HEADER_LEN: usize = 8;
/// Longest body of an answer, bytes.
const ANSWER_LIMIT: usize = 200;
/// Longest body of a reading, bytes: twice a pose with a clock and a switch. A wrong bit in the
/// size must not swallow the records that follow.
const READING_LIMIT: usize = 64;
/// Receivers of the largest system.
const STATIONS: std::ops::RangeInclusive<u8> = 1..=16;

/// The configured record format.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Azimuth, elevation and roll (item 4) instead of a quaternion (item 7).
    pub euler: bool,
    /// Metres per unit of position: inches (`U0`) or centimetres (`U1`).
    pub metres_per_unit: f64,
    /// A position further than this from the transmitter is implausible, metres.
    pub envelope_metres: f64,
}

impl Default for Format {
    fn default() -> Self {
        Self {
            euler: false,
            metres_per_unit: METRES_PER_INCH,
            envelope_metres: 8.0,
        }
    }
}

/// The first eight bytes of a record.
struct Header {
    station: u8,
    command: u8,
    error: Option<u8>,
    body: usize,
}

impl Header {
    /// `None` if no record begins with these bytes.
    fn parse(bytes: &[u8; HEADER_LEN]) -> Option<Self> {
        let [first, second, station, command, error, _, low, high] = *bytes;
        let header = Self {
            station,
            command,
            error: (error != b' ' && error != 0).then_some(error),
            body: usize::from(u16::from_le_bytes([low, high])),
        };
        let limit = if header.is_reading() {
            READING_LIMIT
        } else {
            ANSWER_LIMIT
        };
        let valid = begins(&[first, second])
            && STATIONS.contains(&station)
            && command.is_ascii_graphic()
            && header.body <= limit;
        valid.then_some(header)
    }

    /// Whether it answers the command `C` or `P`.
    const fn is_reading(&self) -> bool {
        matches!(self.command, b'C' | b'P')
    }
}

/// Whether a record can begin with these bytes, at least one.
fn begins(bytes: &[u8]) -> bool {
    matches!(
        bytes,
        [b'L' | b'P'] | [b'L', b'Y' | b'U', ..] | [b'P', b'A', ..]
    )
}

impl Format {
    fn reading(&self, header: &Header, body: &[u8]) -> Result<Reading, Fault> {
        let position = floats::<3>(body)?;
        let orientation = body.get(12..).ok_or(Fault::Layout)?;
        let rotation = if self.euler {
            rotation_from_euler(floats::<3>(orientation)?)?
        } else {
            rotation_from_quaternion(floats::<4>(orientation)?, 0.01)?
        };
        let translation = DVec3::from_array(position) * self.metres_per_unit;
        Ok(Reading {
            station: header.station,
            error: header.error,
            transmitter_from_sensor: plausible::pose(rotation, translation, self.envelope_metres)?,
        })
    }
}

impl Framing for Format {
    fn classify(&self, _previous: Option<u8>, bytes: &[u8]) -> Verdict {
        if !begins(bytes) {
            return Verdict::noise(Fault::Layout);
        }
        let Some(header) = bytes.first_chunk::<HEADER_LEN>() else {
            return Verdict::Incomplete;
        };
        let Some(header) = Header::parse(header) else {
            return Verdict::noise(Fault::Layout);
        };
        let len = HEADER_LEN + header.body;
        let Some(body) = bytes.get(HEADER_LEN..len) else {
            return Verdict::Incomplete;
        };
        if !header.is_reading() {
            return Verdict::NoPose { len };
        }
        match self.reading(&header, body) {
            Ok(reading) => Verdict::Reading { len, reading },
            Err(fault) => Verdict::noise(fault),
        }
    }
}

#[cfg(test)]
mod tests;
