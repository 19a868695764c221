//! D1 messages as a stream of poses.

use super::axes::Axes;
use super::message::{D1, D1_LEN, Message};
use crate::framing::{Fault, Framing, Reading, Verdict};
use crate::plausible;

/// How D1 messages are interpreted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Order and signs of the six numbers.
    pub axes: Axes,
    /// A position further than this from the origin is implausible, metres.
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
    fn classify(&self, _previous: Option<u8>, bytes: &[u8]) -> Verdict {
        if bytes.first() != Some(&D1) {
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
