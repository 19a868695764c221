//! A plain line protocol for home-made trackers.
//!
//! One reading a line, ended by LF or CR LF, at most [`LINE_LIMIT`] bytes with its ending:
//!
//! ```text
//! station,x,y,z,qw,qx,qy,qz[,seconds][*HH]
//! 1,0.5312,-0.0207,1.2050,0.7071,0,0.7071,0,12.0083*4B
//! ```
//!
//! The station is 1 to 255. The position is in metres, in a right-handed frame of the
//! tracker's choice. The unit quaternion rotates vectors from the sensor's frame to that frame.
//! The seconds are the device's own clock; they must be a number, but are not used, because
//! nothing relates that clock to the computer's. `*HH` is optional: the exclusive or of all
//! bytes before the asterisk as two hexadecimal digits, as in NMEA 0183; a line with a wrong
//! checksum is discarded. Empty lines and lines that begin with `#` are comments. Blanks around
//! fields are allowed. The first line after connecting is discarded, because it may be the rest
//! of one. Nothing is ever sent to the device.

use crate::framing::{Fault, Framing, Reading, Verdict};
use crate::plausible::{self, rotation_from_quaternion};
use crate::step::Step;
use glam::DVec3;
use std::time::Duration;

/// Maximum length of a line with its ending, bytes.
pub const LINE_LIMIT: usize = 200;

/// The line protocol.
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
    /// Parses one line without its ending.
    ///
    /// # Errors
    /// [`Fault::Layout`] if it is not written as a reading, [`Fault::Implausible`] if its
    /// numbers are impossible.
    pub fn parse(&self, line: &[u8]) -> Result<Reading, Fault> {
        let line = str::from_utf8(without_checksum(line)?).map_err(|_| Fault::Layout)?;
        let mut fields = line.split(',').map(str::trim);
        let station = fields.next().and_then(|field| field.parse::<u8>().ok());
        let station = station.filter(|s| *s > 0).ok_or(Fault::Layout)?;
        let mut values = [0.0; 7];
        for value in &mut values {
            *value = fields.next().and_then(number).ok_or(Fault::Layout)?;
        }
        let seconds_fit = fields.next().is_none_or(|field| number(field).is_some());
        if !seconds_fit || fields.next().is_some() {
            return Err(Fault::Layout);
        }
        let [x, y, z, qw, qx, qy, qz] = values;
        let rotation = rotation_from_quaternion([qw, qx, qy, qz], 0.01)?;
        let translation = DVec3::new(x, y, z);
        Ok(Reading {
            station,
            error: None,
            transmitter_from_sensor: plausible::pose(rotation, translation, self.envelope_metres)?,
        })
    }
}

/// A decimal number. `inf` and `nan`, which `parse` would accept, are refused.
fn number(field: &str) -> Option<f64> {
    let well_formed = field
        .bytes()
        .all(|byte| byte.is_ascii_digit() || b"+-.eE".contains(&byte));
    let value = field.parse::<f64>().ok().filter(|_| well_formed)?;
    value.is_finite().then_some(value)
}

/// The line without its checksum, which must be right if there is one.
fn without_checksum(line: &[u8]) -> Result<&[u8], Fault> {
    let Some(asterisk) = line.iter().position(|byte| *byte == b'*') else {
        return Ok(line);
    };
    let (text, sum) = line.split_at(asterisk);
    let digits = str::from_utf8(sum.trim_ascii_end().get(1..).unwrap_or_default());
    let expected = digits
        .ok()
        .filter(|digits| digits.len() == 2)
        .and_then(|digits| u8::from_str_radix(digits, 16).ok());
    if expected == Some(checksum(text)) {
        Ok(text)
    } else {
        Err(Fault::Layout)
    }
}

/// Only reads. Many boards restart when their port is opened, which takes seconds.
pub(crate) fn start_sequence() -> Vec<Step> {
    vec![Step::AwaitRecords(Duration::from_secs(4))]
}

/// Exclusive or of all bytes.
#[must_use]
pub fn checksum(text: &[u8]) -> u8 {
    text.iter().fold(0, |sum, byte| sum ^ byte)
}

impl Framing for Format {
    fn classify(&self, previous: Option<u8>, bytes: &[u8]) -> Verdict {
        let head = bytes.get(..LINE_LIMIT).unwrap_or(bytes);
        let noise = |skip| Verdict::Noise {
            skip,
            fault: Fault::Layout,
        };
        let Some(end) = head.iter().position(|byte| *byte == b'\n') else {
            return match previous {
                Some(b'\n') if bytes.len() < LINE_LIMIT => Verdict::Incomplete,
                _ => noise(head.len()),
            };
        };
        let len = end + 1;
        if previous != Some(b'\n') {
            return noise(len);
        }
        let line = head.get(..end).unwrap_or_default().trim_ascii();
        if line.is_empty() || line.starts_with(b"#") {
            return Verdict::NoPose { len };
        }
        match self.parse(line) {
            Ok(reading) => Verdict::Reading { len, reading },
            Err(fault) => Verdict::Noise { skip: len, fault },
        }
    }
}

#[cfg(test)]
mod tests;
