//! FreeD D1 (Vinten Radamec free-d manual V1.4.4, appendices A and B).
//!
//! 29 bytes: `D1`, the camera's number, pan, tilt, roll, X, Y, height, zoom, focus (24 bits
//! each, big-endian), two spare bytes and a checksum. Angles count 1/32768°, positions
//! 1/64 mm. On a serial line 38400 baud, 8 data bits, odd parity; today mostly one message
//! a UDP datagram.
//!
//! The frame: X right, Y forward, Z up, right-handed, metres. A camera at pan = tilt =
//! roll = 0 looks along +Y with its top towards +Z. Pan is positive to the right, tilt
//! upwards, roll clockwise as seen from behind the camera (B.4). The sensor's axes are the
//! camera's right, forward and up, so that the pose is R = Rz(−pan) · Rx(tilt) · Ry(roll).
//! Senders disagree about the order and the signs of the fields: [`Axes`] says them.

mod axes;
pub(crate) mod commands;
mod message;
mod sender;

pub use axes::Axes;
pub use message::{D1_LEN, Lens, Message};
pub use sender::{FreedSender, optical_to_studio};

use crate::plausible;
use crate::{Fault, Framing, Reading, Verdict};

/// How a D1 stream is to be read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// What the six numbers mean.
    pub axes: Axes,
    /// A position further than this from the origin is no reading, metres.
    pub envelope_metres: f64,
}

impl Default for Format {
    fn default() -> Self {
        Self {
            axes: Axes::default(),
            envelope_metres: 250.0,
        }
    }
}

impl Format {
    fn reading(&self, message: &Message) -> Result<Reading, Fault> {
        let pose = message.pose(self.axes);
        if message
            .angles_degrees
            .iter()
            .any(|angle| angle.abs() > 180.0)
        {
            return Err(Fault::Implausible);
        }
        Ok(Reading {
            station: message.camera,
            error: None,
            transmitter_from_sensor: plausible::pose(
                pose.rotation,
                pose.translation,
                self.envelope_metres,
            )?,
        })
    }
}

impl Framing for Format {
    fn judge(&self, _before: Option<u8>, bytes: &[u8]) -> Verdict {
        if bytes.first() != Some(&message::D1) {
            return Verdict::noise(Fault::Layout);
        }
        let Some(bytes) = bytes.first_chunk::<D1_LEN>() else {
            return Verdict::Incomplete;
        };
        let read = Message::decode(bytes).ok_or(Fault::Layout);
        match read.and_then(|message| self.reading(&message)) {
            Ok(reading) => Verdict::Reading {
                len: D1_LEN,
                reading,
            },
            Err(fault) => Verdict::noise(fault),
        }
    }
}

#[cfg(test)]
mod tests;
