//! Negotiates a format and splits frames into payloads.
//!
//! Source: USB Device Class Definition for Video Devices 1.0: 4.3.1.1 (probe and commit) and
//! 2.4.3.3 (payload headers).

use crate::Stall;
use crate::controls::{GET_CUR, GET_DEF, GET_INFO, GET_LEN, GET_MAX, GET_MIN, SET_CUR};
use crate::usbip::Setup;
use std::time::Duration;

/// Bytes of a payload with its header: the size of the kernel's transfers.
pub const PAYLOAD: usize = 16_384;
const HEADER: usize = 2;
const PROBE: usize = 26;

/// Encoding of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// 4:2:2, Y0 U Y1 V.
    Yuyv,
    /// One JPEG file a frame.
    Mjpeg,
}

/// Formats with their sizes, in the order of their numbers, which begin at 1.
pub const FORMATS: [(Format, &[(u16, u16)]); 2] = [
    (Format::Yuyv, &[(640, 480)]),
    (Format::Mjpeg, &[(640, 480), (1280, 720)]),
];

/// Frame intervals, 100 ns: 30 and 15 frames a second.
pub const INTERVALS: [u32; 2] = [333_333, 666_666];

/// Format, size and rate of the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mode {
    /// Encoding of a frame.
    pub format: Format,
    /// Pixels in a row.
    pub width: u16,
    /// Rows.
    pub height: u16,
    /// Frame interval.
    pub interval: Duration,
}

/// The negotiated mode: numbers of the format and of its size, and the frame interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Negotiation {
    format: usize,
    size: usize,
    interval: u32,
}

impl Default for Negotiation {
    fn default() -> Self {
        Self {
            format: 1,
            size: 1,
            interval: INTERVALS[0],
        }
    }
}

impl Negotiation {
    /// Answers a class request to the streaming interface: data, or nothing for a SET.
    ///
    /// # Errors
    /// There is no such request.
    pub fn request(&mut self, setup: &Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        match setup.request {
            SET_CUR => self.propose(data).map(|()| Vec::new()),
            GET_CUR | GET_MIN | GET_MAX | GET_DEF => Ok(self.block()),
            GET_LEN => Ok(vec![PROBE as u8, 0]),
            GET_INFO => Ok(vec![0x03]),
            _ => Err(Stall),
        }
    }

    /// Selects the mode nearest to the requested one.
    fn propose(&mut self, block: &[u8]) -> Result<(), Stall> {
        let [_, _, format, size, a, b, c, d, ..] = *block else {
            return Err(Stall);
        };
        let wanted = u32::from_le_bytes([a, b, c, d]);
        self.format = usize::from(format).clamp(1, FORMATS.len());
        self.size = usize::from(size).clamp(1, FORMATS[self.format - 1].1.len());
        let slow = wanted > (INTERVALS[0] + INTERVALS[1]) / 2;
        self.interval = INTERVALS[usize::from(slow)];
        Ok(())
    }

    fn block(&self) -> Vec<u8> {
        let mode = self.mode();
        let largest = u32::from(mode.width) * u32::from(mode.height) * 2;
        let mut block = vec![0; PROBE];
        block[2] = self.format as u8;
        block[3] = self.size as u8;
        block[4..8].copy_from_slice(&self.interval.to_le_bytes());
        block[18..22].copy_from_slice(&largest.to_le_bytes());
        block[22..26].copy_from_slice(&(PAYLOAD as u32).to_le_bytes());
        block
    }

    /// The negotiated mode.
    #[must_use]
    pub fn mode(&self) -> Mode {
        let (format, sizes) = FORMATS[self.format - 1];
        let (width, height) = sizes[self.size - 1];
        Mode {
            format,
            width,
            height,
            interval: Duration::from_nanos(u64::from(self.interval) * 100),
        }
    }
}

/// Splits a frame into payloads. `parity` alternates from frame to frame; `damaged` sets the
/// error bit of every header.
pub fn payloads(frame: &[u8], parity: bool, damaged: bool) -> impl Iterator<Item = Vec<u8>> {
    let size = PAYLOAD - HEADER;
    let last = frame.len().div_ceil(size).max(1) - 1;
    frame.chunks(size).enumerate().map(move |(index, chunk)| {
        let end_of_header = 0x80;
        let flags = u8::from(parity) | u8::from(index == last) << 1 | u8::from(damaged) << 6;
        let mut payload = Vec::with_capacity(HEADER + chunk.len());
        payload.extend([HEADER as u8, end_of_header | flags]);
        payload.extend(chunk);
        payload
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_payload_ends_the_frame() {
        let frame = vec![9; PAYLOAD];
        let flags: Vec<_> = payloads(&frame, true, false).map(|p| p[1]).collect();
        assert_eq!(flags, [0x81, 0x83]);
        let flags: Vec<_> = payloads(&[1, 2], false, true).map(|p| p[1]).collect();
        assert_eq!(flags, [0xc2]);
    }

    #[test]
    fn proposal_selects_the_nearest_mode() {
        let mut negotiation = Negotiation::default();
        let mut block = negotiation.block();
        block[2..4].copy_from_slice(&[9, 9]);
        block[4..8].copy_from_slice(&500_001_u32.to_le_bytes());
        negotiation.propose(&block).unwrap();
        let mode = negotiation.mode();
        assert_eq!(
            (mode.format, mode.width, mode.height),
            (Format::Mjpeg, 1280, 720)
        );
        assert_eq!(mode.interval, Duration::from_nanos(66_666_600));
        assert_eq!(negotiation.propose(&[0; 4]), Err(Stall));
    }
}
