//! Finds the end of a camera's JPEG frame and completes the frame.
//!
//! Cameras pad frames to their packet size, omit the end marker (the kernel's
//! `UVC_QUIRK_MJPEG_NO_EOF`), omit the Huffman tables (as MJPEG in AVI files does; the tables
//! of ITU-T T.81, annex K.3 then apply), and cut frames short without an error flag, which
//! `uvcvideo` sets for short uncompressed frames only. Markers: T.81, table B.1.

use crate::huffman::STANDARD_TABLES;
use bytes::BufMut;

/// Start of image.
const SOI: u8 = 0xD8;
/// End of image.
const EOI: u8 = 0xD9;
/// Start of scan.
const SOS: u8 = 0xDA;
/// Huffman tables.
const DHT: u8 = 0xC4;

/// Properties of a JPEG frame according to its markers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Jpeg {
    /// Bytes up to the end marker, inclusive; without a marker, up to the last byte that is
    /// not zero.
    pub len: usize,
    pub has_end: bool,
    /// The start of the first scan, if no Huffman tables precede it: there they belong.
    pub tables_missing_at: Option<usize>,
}

/// Why bytes are not a JPEG frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum JpegError {
    /// They do not begin with a start marker.
    NoStart,
    /// They end, or a segment has no valid length, before the first scan.
    NoScan,
}

impl Jpeg {
    /// Walks from marker to marker.
    pub(crate) fn parse(data: &[u8]) -> Result<Self, JpegError> {
        if !data.starts_with(&[0xFF, SOI]) {
            return Err(JpegError::NoStart);
        }
        let (mut at, mut has_tables, mut first_scan) = (2, false, None);
        loop {
            let Some((marker, marker_at)) = next_marker(data, at) else {
                return without_end(data, first_scan, has_tables);
            };
            at = marker_at + 2;
            match marker {
                EOI => {
                    let first_scan = first_scan.ok_or(JpegError::NoScan)?;
                    return Ok(Self {
                        len: at,
                        has_end: true,
                        tables_missing_at: (!has_tables).then_some(first_scan),
                    });
                }
                // Restart markers and TEM have no length. A second start marker is an error
                // that the decoder handles better.
                0x01 | 0xD0..=0xD8 => continue,
                DHT => has_tables |= first_scan.is_none(),
                SOS => first_scan = first_scan.or(Some(marker_at)),
                _ => {}
            }
            let Some(length) = segment_length(data, at) else {
                return without_end(data, first_scan, has_tables);
            };
            at += length;
        }
    }

    /// Appends the frame to `out`, with Huffman tables and end marker. `data` is what was
    /// parsed.
    pub(crate) fn write_complete(&self, data: &[u8], out: &mut Vec<u8>) {
        let split = self.tables_missing_at.unwrap_or(0);
        let (head, tail) = data[..self.len].split_at(split);
        out.put_slice(head);
        if self.tables_missing_at.is_some() {
            out.put_slice(&STANDARD_TABLES);
        }
        out.put_slice(tail);
        if !self.has_end {
            out.put_slice(&[0xFF, EOI]);
        }
    }
}

/// The next marker from `at` on and its position. Skips entropy-coded data and fill bytes.
fn next_marker(data: &[u8], mut at: usize) -> Option<(u8, usize)> {
    loop {
        at += memchr::memchr(0xFF, data.get(at..)?)?;
        match *data.get(at + 1)? {
            // FF 00 is a coded FF. The first FF of FF FF is a fill byte.
            0x00 => at += 2,
            0xFF => at += 1,
            marker => return Some((marker, at)),
        }
    }
}

fn segment_length(data: &[u8], at: usize) -> Option<usize> {
    let length = usize::from(u16::from_be_bytes([*data.get(at)?, *data.get(at + 1)?]));
    (length >= 2 && at + length <= data.len()).then_some(length)
}

/// A frame with a scan but without an end marker.
fn without_end(
    data: &[u8],
    first_scan: Option<usize>,
    has_tables: bool,
) -> Result<Jpeg, JpegError> {
    let first_scan = first_scan.ok_or(JpegError::NoScan)?;
    let padding = data.iter().rev().take_while(|&&b| b == 0).count();
    let mut len = data.len() - padding;
    // A marker that was cut in half, or a coded FF whose 00 was taken for padding.
    if data[len - 1] == 0xFF {
        len -= 1;
    }
    Ok(Jpeg {
        len: len.max(first_scan + 2),
        has_end: false,
        tables_missing_at: (!has_tables).then_some(first_scan),
    })
}

#[cfg(test)]
mod tests;
