//! Finds records in a stream of bytes: what all protocols have in common.

use crate::{Fault, Format, Framing, Reading, Verdict};
use penumbra_interface::{MonotonicTime, PoseSample};

/// Room for two of the longest records (CSV lines) and what a push may add.
const CAPACITY: usize = 512;
const NEVER: MonotonicTime = MonotonicTime::from_nanos(i64::MIN);

/// What happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Records handed on.
    pub records: u64,
    /// Records without a pose: status answers.
    pub asides: u64,
    /// Bytes that belonged to no record.
    pub skipped_bytes: u64,
    /// Times that the place of the records was lost after it had been found.
    pub resyncs: u64,
    /// Well laid out records whose numbers cannot be.
    pub implausible: u64,
    /// The error letter of the newest record, if it had one.
    pub error: Option<u8>,
}

/// A tracker's stream. Push bytes as they come; each record is handed to a closure.
///
/// A record's first bytes occur by chance, in floats above all, so a place in the stream
/// counts as found only when two good records follow one another there.
#[derive(Clone, Debug)]
pub struct Decoder<F = Format> {
    format: F,
    nanos_per_byte: Option<f64>,
    /// When the last byte of the push before came.
    newest: MonotonicTime,
    /// The byte before the first one of `bytes`.
    outgoing: Option<u8>,
    bytes: [u8; CAPACITY],
    /// Arrival of each byte: a record found late keeps the time at which its end came.
    arrivals: [MonotonicTime; CAPACITY],
    len: usize,
    locked: bool,
    counters: Counters,
}

impl<F> Decoder<F> {
    /// A decoder that has seen nothing yet.
    #[must_use]
    pub const fn new(format: F) -> Self {
        Self {
            format,
            nanos_per_byte: None,
            newest: NEVER,
            outgoing: None,
            bytes: [0; CAPACITY],
            arrivals: [NEVER; CAPACITY],
            len: 0,
            locked: false,
            counters: Counters {
                records: 0,
                asides: 0,
                skipped_bytes: 0,
                resyncs: 0,
                implausible: 0,
                error: None,
            },
        }
    }

    /// Corrects arrival times by the line's speed: a record that ends n bytes before the
    /// end of what was read in one go arrived n · 10 bits earlier (8N1), but not before
    /// what was read earlier. Without this all records of one push carry the push's time.
    #[must_use]
    pub fn with_baud(mut self, baud: u32) -> Self {
        self.nanos_per_byte = (baud > 0).then(|| 10.0e9 / f64::from(baud));
        self
    }

    pub(crate) fn set_format(&mut self, format: F) {
        self.format = format;
    }

    /// How the records are spelled.
    #[must_use]
    pub const fn format(&self) -> &F {
        &self.format
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
        self.newest = NEVER;
        self.outgoing = None;
    }

    /// When a byte with `after` bytes behind it in the same read came.
    fn arrival(&self, arrived_at: MonotonicTime, after: usize) -> MonotonicTime {
        match self.nanos_per_byte {
            Some(nanos) => arrived_at
                .offset_nanos(-((after as f64 * nanos) as i64))
                .max(self.newest.min(arrived_at)),
            None => arrived_at,
        }
    }

    /// Appends as many of `bytes` as there is room for and says how many.
    fn append(&mut self, bytes: &[u8], arrived_at: MonotonicTime) -> usize {
        let count = bytes.len().min(CAPACITY - self.len);
        self.bytes[self.len..self.len + count].copy_from_slice(&bytes[..count]);
        if self.nanos_per_byte.is_some() {
            for i in 0..count {
                let arrival = self.arrival(arrived_at, bytes.len() - 1 - i);
                self.arrivals[self.len + i] = arrival;
            }
        } else {
            self.arrivals[self.len..self.len + count].fill(arrived_at);
        }
        self.len += count;
        count
    }

    /// Some bytes on; the records' place is unknown again.
    fn skip(&mut self, count: usize, fault: Fault) -> Step {
        self.counters.resyncs += u64::from(self.locked);
        self.counters.implausible += u64::from(fault == Fault::Implausible);
        self.counters.skipped_bytes += count as u64;
        self.locked = false;
        Step::Skip(count)
    }

    /// More bytes may tell, unless there is no room for more.
    fn wait(&mut self, start: usize) -> Step {
        if start == 0 && self.len == CAPACITY {
            self.skip(1, Fault::Layout)
        } else {
            Step::Wait
        }
    }

    fn count(&mut self, reading: Option<Reading>) {
        match reading {
            Some(reading) => {
                self.counters.records += 1;
                self.counters.error = reading.error;
            }
            None => self.counters.asides += 1,
        }
    }
}

/// What to do with the bytes at one place of the buffer.
enum Step {
    Take(usize, Option<Reading>),
    Skip(usize),
    Wait,
}

impl<F: Framing> Decoder<F> {
    /// Takes bytes whose last one arrived at `arrived_at` and hands every record found to
    /// `sink`, in order.
    pub fn push(
        &mut self,
        bytes: &[u8],
        arrived_at: MonotonicTime,
        mut sink: impl FnMut(PoseSample),
    ) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let taken = self.append(rest, arrived_at);
            rest = &rest[taken..];
            self.drain(&mut sink);
        }
        self.newest = arrived_at;
    }

    /// Takes everything out of the buffer that can be judged already.
    fn drain(&mut self, sink: &mut impl FnMut(PoseSample)) {
        let mut start = 0;
        while start < self.len {
            match self.step(start) {
                Step::Wait => break,
                Step::Skip(count) => start += count,
                Step::Take(len, reading) => {
                    start += len;
                    self.count(reading);
                    if let Some(reading) = reading {
                        sink(reading.arrived(self.arrivals[start - 1]));
                    }
                }
            }
        }
        self.outgoing = self.before(start);
        self.bytes.copy_within(start..self.len, 0);
        self.arrivals.copy_within(start..self.len, 0);
        self.len -= start;
    }

    /// The byte in front of place `start`.
    fn before(&self, start: usize) -> Option<u8> {
        start
            .checked_sub(1)
            .map_or(self.outgoing, |i| Some(self.bytes[i]))
    }

    fn step(&mut self, start: usize) -> Step {
        let (len, reading) = match self
            .format
            .judge(self.before(start), &self.bytes[start..self.len])
        {
            Verdict::Reading { len, reading } => (len, Some(reading)),
            Verdict::Aside { len } => (len, None),
            Verdict::Incomplete => return self.wait(start),
            Verdict::Noise { skip, fault } => {
                return self.skip(skip.clamp(1, self.len - start), fault);
            }
        };
        let next = &self.bytes[start + len..self.len];
        if self.locked {
            return Step::Take(len, reading);
        }
        if next.is_empty() {
            return self.wait(start);
        }
        match self.format.judge(self.before(start + len), next) {
            Verdict::Reading { .. } | Verdict::Aside { .. } => {
                self.locked = true;
                Step::Take(len, reading)
            }
            Verdict::Incomplete => self.wait(start),
            Verdict::Noise { .. } => self.skip(1, Fault::Layout),
        }
    }
}

#[cfg(test)]
mod tests;
