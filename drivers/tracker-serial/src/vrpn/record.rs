//! The layout of a `Pos_Quat` message.

use super::wire::{MESSAGE_HEADER_LEN, POS_QUAT_LEN, double_at, int_at};
use crate::framing::{Fault, Framing, Reading, Verdict};
use crate::plausible::{self, rotation_from_quaternion};
use glam::DVec3;

/// `Pos_Quat` messages as sent: header of 24 bytes, sensor, padding, position in metres,
/// quaternion x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// A position further than this from the origin is implausible, metres.
    pub envelope_metres: f64,
}

impl Default for Format {
    fn default() -> Self {
        Self {
            envelope_metres: 100.0,
        }
    }
}

impl Format {
    fn reading(&self, message: &[u8; POS_QUAT_LEN]) -> Result<Reading, Fault> {
        let sensor = int_at(message, MESSAGE_HEADER_LEN).ok_or(Fault::Layout)?;
        let station = u8::try_from(sensor.saturating_add(1)).map_err(|_| Fault::Layout)?;
        let mut values = [0.0; 7];
        for (value, place) in values.iter_mut().zip((MESSAGE_HEADER_LEN + 8..).step_by(8)) {
            *value = double_at(message, place).ok_or(Fault::Layout)?;
        }
        let [x, y, z, qx, qy, qz, qw] = values;
        let rotation = rotation_from_quaternion([qw, qx, qy, qz], 0.01)?;
        let translation = DVec3::new(x, y, z);
        if station == 0 {
            return Err(Fault::Layout);
        }
        Ok(Reading {
            station,
            error: None,
            transmitter_from_sensor: plausible::pose(rotation, translation, self.envelope_metres)?,
        })
    }
}

impl Framing for Format {
    fn classify(&self, _previous: Option<u8>, bytes: &[u8]) -> Verdict {
        const LENGTH: [u8; 4] = (POS_QUAT_LEN as u32).to_be_bytes();
        let available = bytes.len().min(LENGTH.len());
        if bytes.get(..available) != LENGTH.get(..available) {
            return Verdict::noise(Fault::Layout);
        }
        let Some(message) = bytes.first_chunk::<POS_QUAT_LEN>() else {
            return Verdict::Incomplete;
        };
        // A fraction of a second is below a million microseconds.
        let micros = int_at(message, 8).filter(|micros| (0..1_000_000).contains(micros));
        match micros
            .ok_or(Fault::Layout)
            .and_then(|_| self.reading(message))
        {
            Ok(reading) => Verdict::Reading {
                len: POS_QUAT_LEN,
                reading,
            },
            Err(fault) => Verdict::noise(fault),
        }
    }
}
