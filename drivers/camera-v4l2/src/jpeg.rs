//! Whether a camera's bytes are a whole JPEG, and where it ends.
//!
//! Cameras pad the picture to their packet size, leave out the end marker (the kernel's
//! `UVC_QUIRK_MJPEG_NO_EOF`), leave out the Huffman tables (MJPEG as in AVI files: ITU-T
//! T.81, annex K.3 holds for all), and lose the rest of a picture without telling
//! (an ERROR flag is set for short uncompressed frames only). Markers: T.81, table B.1.

use crate::huffman::STANDARD_TABLES;
use bytes::BufMut;

const SOI: u8 = 0xD8;
const EOI: u8 = 0xD9;
const SOS: u8 = 0xDA;
const DHT: u8 = 0xC4;

/// Where the parts of a JPEG lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Jpeg {
    /// Bytes up to and with the end marker; without one, up to the last that is not zero.
    pub len: usize,
    /// Whether the end marker is there.
    pub ended: bool,
    /// Where Huffman tables must be inserted, if it has none: before its first scan.
    pub tables_missing_at: Option<usize>,
}

/// Why bytes are no JPEG.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Does not begin with a start marker.
    NoStart,
    /// Ends or derails before the first scan.
    NoScan,
}

impl Jpeg {
    /// Walks from marker to marker.
    pub(crate) fn find(data: &[u8]) -> Result<Self, Fault> {
        if !data.starts_with(&[0xFF, SOI]) {
            return Err(Fault::NoStart);
        }
        let (mut at, mut has_tables, mut first_scan) = (2, false, None);
        loop {
            let Some((marker, marker_at)) = next_marker(data, at) else {
                return unended(data, first_scan, has_tables);
            };
            at = marker_at + 2;
            match marker {
                EOI => {
                    let first_scan = first_scan.ok_or(Fault::NoScan)?;
                    return Ok(Self {
                        len: at,
                        ended: true,
                        tables_missing_at: (!has_tables).then_some(first_scan),
                    });
                }
                // Restart markers and TEM stand alone; a second start is a derailment that
                // the decoder judges better.
                0x01 | 0xD0..=0xD8 => continue,
                DHT => has_tables |= first_scan.is_none(),
                SOS => first_scan = first_scan.or(Some(marker_at)),
                _ => {}
            }
            let Some(length) = segment_length(data, at) else {
                return unended(data, first_scan, has_tables);
            };
            at += length;
        }
    }

    /// Writes the picture as a complete file: with tables, with an end.
    pub(crate) fn write(&self, data: &[u8], out: &mut Vec<u8>) {
        let split = self.tables_missing_at.unwrap_or(0);
        let (head, tail) = data[..self.len].split_at(split);
        out.put_slice(head);
        if self.tables_missing_at.is_some() {
            out.put_slice(&STANDARD_TABLES);
        }
        out.put_slice(tail);
        if !self.ended {
            out.put_slice(&[0xFF, EOI]);
        }
    }
}

/// The next marker from `at` on, skipping entropy-coded bytes and fill bytes.
fn next_marker(data: &[u8], mut at: usize) -> Option<(u8, usize)> {
    loop {
        at += memchr::memchr(0xFF, data.get(at..)?)?;
        match *data.get(at + 1)? {
            // A stuffed zero belongs to the coded data; a second FF is a fill byte.
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

/// A picture whose scan began but whose end marker is missing.
fn unended(data: &[u8], first_scan: Option<usize>, has_tables: bool) -> Result<Jpeg, Fault> {
    let first_scan = first_scan.ok_or(Fault::NoScan)?;
    let zeros = data.iter().rev().take_while(|&&b| b == 0).count();
    // A stuffed zero after FF is data, and half a marker is none.
    let mut len = data.len() - zeros;
    if data[len - 1] == 0xFF {
        len -= 1;
    }
    Ok(Jpeg {
        len: len.max(first_scan + 2),
        ended: false,
        tables_missing_at: (!has_tables).then_some(first_scan),
    })
}

#[cfg(test)]
mod tests;
