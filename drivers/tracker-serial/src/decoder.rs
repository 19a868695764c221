//! Finds records in a stream of bytes.

use super::{Fault, Format};
use penumbra_interface::{MonotonicTime, PoseSample};

/// Room for two of the longest records and what a push may add.
const CAPACITY: usize = 256;

/// What happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Records handed on.
    pub records: u64,
    /// Bytes that belonged to no record.
    pub skipped_bytes: u64,
    /// Times that the place of the records was lost after it had been found.
    pub resyncs: u64,
    /// Well laid out records whose numbers cannot be.
    pub implausible: u64,
    /// The error letter of the newest record, if it had one.
    pub error: Option<u8>,
}

/// A FASTRAK stream. Push bytes as they come; each record is handed to a closure.
///
/// `'0'` and a digit occur by chance, in floats above all, so a place in the stream counts
/// as found only when two good records follow one another there.
#[derive(Clone, Debug)]
pub struct Decoder {
    format: Format,
    nanos_per_byte: Option<f64>,
    bytes: [u8; CAPACITY],
    /// Arrival of each byte: a record found late keeps the time at which its end came.
    arrivals: [MonotonicTime; CAPACITY],
    len: usize,
    locked: bool,
    counters: Counters,
}

impl Decoder {
    /// A decoder that has seen nothing yet.
    #[must_use]
    pub const fn new(format: Format) -> Self {
        Self {
            format,
            nanos_per_byte: None,
            bytes: [0; CAPACITY],
            arrivals: [MonotonicTime::from_nanos(0); CAPACITY],
            len: 0,
            locked: false,
            counters: Counters {
                records: 0,
                skipped_bytes: 0,
                resyncs: 0,
                implausible: 0,
                error: None,
            },
        }
    }

    /// Corrects arrival times by the line's speed: a record that ends n bytes before the
    /// end of what was read in one go arrived n · 10 bits earlier (8N1). Without this all
    /// records of one push carry the push's time.
    #[must_use]
    pub fn with_baud(mut self, baud: u32) -> Self {
        self.nanos_per_byte = (baud > 0).then(|| 10.0e9 / f64::from(baud));
        self
    }

    /// Whether the place of the records is known.
    #[must_use]
    pub const fn locked(&self) -> bool {
        self.locked
    }

    /// What happened so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Forgets buffered bytes, as after reopening a port; counters stay.
    pub const fn reset(&mut self) {
        self.len = 0;
        self.locked = false;
    }

    /// Takes bytes whose last one arrived at `arrived_at` and hands every record found to
    /// `sink`, in order.
    pub fn push(
        &mut self,
        bytes: &[u8],
        arrived_at: MonotonicTime,
        mut sink: impl FnMut(PoseSample),
    ) {
        let mut after = bytes.len();
        let mut rest = bytes;
        while !rest.is_empty() {
            let (piece, later) = rest.split_at(rest.len().min(CAPACITY - self.len));
            for &byte in piece {
                after -= 1;
                self.bytes[self.len] = byte;
                self.arrivals[self.len] = self.arrival(arrived_at, after);
                self.len += 1;
            }
            rest = later;
            self.drain(&mut sink);
        }
    }

    /// When a byte with `after` bytes behind it in the same read came.
    fn arrival(&self, arrived_at: MonotonicTime, after: usize) -> MonotonicTime {
        match self.nanos_per_byte {
            Some(nanos) => arrived_at.offset_nanos(-((after as f64 * nanos) as i64)),
            None => arrived_at,
        }
    }

    /// Takes everything out of the buffer that can be judged already. What stays is less
    /// than two records, so a push always finds room.
    fn drain(&mut self, sink: &mut impl FnMut(PoseSample)) {
        let len = self.format.record_len();
        let mut start = 0;
        while self.len - start >= len {
            match self.sample_at(start) {
                Ok(sample) if self.locked => {
                    self.count(&sample);
                    sink(sample);
                    start += len;
                }
                Ok(_) if self.len - start < 2 * len => break,
                Ok(_) if self.sample_at(start + len).is_ok() => self.locked = true,
                Ok(_) => start += self.slide(Fault::Layout),
                Err(fault) => start += self.slide(fault),
            }
        }
        self.bytes.copy_within(start..self.len, 0);
        self.arrivals.copy_within(start..self.len, 0);
        self.len -= start;
    }

    /// The record that starts at `start`, which has room for one.
    fn sample_at(&self, start: usize) -> Result<PoseSample, Fault> {
        let end = start + self.format.record_len();
        let record = self.format.parse(&self.bytes[start..end])?;
        Ok(PoseSample {
            station: record.station,
            transmitter_from_sensor: record.transmitter_from_sensor,
            arrived_at: self.arrivals[end - 1],
            error: record.error,
        })
    }

    fn count(&mut self, sample: &PoseSample) {
        self.counters.records += 1;
        self.counters.error = sample.error;
    }

    /// One byte on; the records' place is unknown again.
    fn slide(&mut self, fault: Fault) -> usize {
        self.counters.resyncs += u64::from(self.locked);
        self.counters.implausible += u64::from(fault == Fault::Implausible);
        self.counters.skipped_bytes += 1;
        self.locked = false;
        1
    }
}

#[cfg(test)]
mod tests;
