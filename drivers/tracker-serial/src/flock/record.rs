//! The layout of a record.

use crate::framing::{Fault, Framing, Reading, Verdict};
use crate::plausible::{self, rotation_from_euler, rotation_from_quaternion};
use crate::units::METRES_PER_INCH;
use glam::DVec3;

/// Full scale of a position with the standard transmitter, inches.
const FULL_SCALE: f64 = 36.0;
/// Addresses of the birds on one bus.
const ADDRESSES: std::ops::RangeInclusive<u8> = 1..=126;

/// The configured record format.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Position and angles (`Y`, 12 bytes) instead of position and quaternion (`]`, 14 bytes).
    pub angles: bool,
    /// Group mode: each record ends with the bird's address.
    pub group: bool,
    /// Invert the quaternions: with some device settings they are the transmitter's rotation
    /// in the sensor's frame. VRPN has the same switch.
    pub inverted: bool,
    /// 0.0254 for the standard transmitter with its full scale of 36 inches, 4 × 0.0254 for an
    /// extended-range transmitter with 144 inches.
    pub metres_per_unit: f64,
    /// A position further than this from the transmitter is implausible, metres.
    pub envelope_metres: f64,
}

impl Default for Format {
    fn default() -> Self {
        Self {
            angles: false,
            group: false,
            inverted: false,
            metres_per_unit: METRES_PER_INCH,
            envelope_metres: 8.0,
        }
    }
}

impl Format {
    /// Length of a record, bytes.
    #[must_use]
    pub const fn record_len(&self) -> usize {
        2 * self.words() + self.group as usize
    }

    const fn words(&self) -> usize {
        if self.angles { 6 } else { 7 }
    }

    /// Decodes one record whose phasing bits have been checked.
    fn reading(&self, record: &[u8]) -> Result<Reading, Fault> {
        let mut words = [0.0; 7];
        let (pairs, address) = record.as_chunks::<2>();
        for (word, pair) in words.iter_mut().zip(pairs) {
            *word = fraction(*pair);
        }
        let [x, y, z, a, b, c, d] = words;
        let rotation = if self.angles {
            rotation_from_euler([a, b, c].map(|turn| turn * 180.0))?
        } else {
            rotation_from_quaternion([a, b, c, d], 0.01)?
        };
        let rotation = if self.inverted {
            rotation.inverse()
        } else {
            rotation
        };
        let station = address.first().copied().unwrap_or(1);
        if !ADDRESSES.contains(&station) {
            return Err(Fault::Layout);
        }
        let translation = DVec3::new(x, y, z) * (FULL_SCALE * self.metres_per_unit);
        Ok(Reading {
            station,
            error: None,
            transmitter_from_sensor: plausible::pose(rotation, translation, self.envelope_metres)?,
        })
    }
}

/// A word as a fraction of its full scale, -1 to 1.
fn fraction([low, high]: [u8; 2]) -> f64 {
    let word = (u16::from(low & 0x7f) << 1 | u16::from(high) << 8) << 1;
    f64::from(word.cast_signed()) / 32768.0
}

impl Framing for Format {
    fn classify(&self, _previous: Option<u8>, bytes: &[u8]) -> Verdict {
        let len = self.record_len();
        let Some(body) = bytes.get(1..bytes.len().min(len)) else {
            return Verdict::Incomplete;
        };
        if bytes.first().is_none_or(|first| first & 0x80 == 0) {
            return Verdict::noise(Fault::Layout);
        }
        // No record can start before the next byte with bit 7 set.
        if let Some(next) = body.iter().position(|byte| byte & 0x80 != 0) {
            return Verdict::Noise {
                skip: 1 + next,
                fault: Fault::Layout,
            };
        }
        match bytes.get(..len).map(|record| self.reading(record)) {
            Some(Ok(reading)) => Verdict::Reading { len, reading },
            Some(Err(fault)) => Verdict::noise(fault),
            None => Verdict::Incomplete,
        }
    }
}

#[cfg(test)]
mod tests;
