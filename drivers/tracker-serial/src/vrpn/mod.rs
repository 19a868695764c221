//! VRPN: poses of any tracker that a VRPN server knows, over TCP.
//!
//! Client and server exchange cookies, name their senders and message types by strings and
//! number them per connection; after that only numbers are sent. [`Client`] does this
//! without I/O and cuts out the `Pos_Quat` messages of the tracker that is wanted. Only
//! those are handed on and recorded, byte for byte, because they can be read from any
//! point of the stream, which the connection as a whole cannot. Source: VRPN's
//! `vrpn_Connection.C` and `vrpn_Tracker.C`.

mod client;
mod wire;

pub use client::{Client, VrpnError};
pub use wire::{COOKIE_LEN, MESSAGE_HEADER_LEN, POS_QUAT_LEN};

use crate::plausible::{self, rotation_from_quaternion};
use crate::{Fault, Framing, Reading, Verdict};
use glam::DVec3;

/// `Pos_Quat` messages in their wire form: header of 24 bytes, sensor, position in metres,
/// quaternion x, y, z, w.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// A position further than this from the origin is no reading, metres.
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
        let sensor = wire::int_at(message, MESSAGE_HEADER_LEN).ok_or(Fault::Layout)?;
        let station = u8::try_from(sensor.saturating_add(1)).map_err(|_| Fault::Layout)?;
        let mut values = [0.0; 7];
        for (value, place) in values.iter_mut().zip((MESSAGE_HEADER_LEN + 8..).step_by(8)) {
            *value = wire::double_at(message, place).ok_or(Fault::Layout)?;
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
    fn judge(&self, _before: Option<u8>, bytes: &[u8]) -> Verdict {
        const LENGTH: [u8; 4] = (POS_QUAT_LEN as u32).to_be_bytes();
        let shown = bytes.len().min(LENGTH.len());
        if bytes.get(..shown) != LENGTH.get(..shown) {
            return Verdict::noise(Fault::Layout);
        }
        let Some(message) = bytes.first_chunk::<POS_QUAT_LEN>() else {
            return Verdict::Incomplete;
        };
        // A second never has a million microseconds.
        let micros = wire::int_at(message, 8).filter(|micros| (0..1_000_000).contains(micros));
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

#[cfg(test)]
mod tests;
