//! Finds records in a stream of bytes, for all protocols.

use crate::framing::{Fault, Framing, Reading, Verdict};
use penumbra_interface::{MonotonicTime, PoseSample};

/// Room for two of the longest records (CSV lines) and for new bytes.
const CAPACITY: usize = 512;
const NEVER: MonotonicTime = MonotonicTime::from_nanos(i64::MIN);

/// Counters of a decoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Records with a pose.
    pub records: u64,
    /// Records without a pose: answers and comments.
    pub without_pose: u64,
    /// Bytes that belonged to no record.
    pub skipped_bytes: u64,
    /// How often the decoder lost synchronisation.
    pub resyncs: u64,
    /// Records with the right layout but impossible numbers.
    pub implausible: u64,
    /// The error letter of the newest record, if it had one.
    pub error: Option<u8>,
}

/// Decodes a tracker's stream: push bytes as they arrive, and receive each record in a
/// closure.
///
/// The first bytes of a record also occur by chance, above all in binary numbers. So a decoder is
/// synchronised (locked) only after two consecutive valid records.
#[derive(Clone, Debug)]
pub struct Decoder<F> {
    format: F,
    nanos_per_byte: Option<f64>,
    /// When the last byte of the previous push arrived.
    previous_push: MonotonicTime,
    /// The byte before the first one of `bytes`.
    previous_byte: Option<u8>,
    bytes: [u8; CAPACITY],
    /// Arrival of each byte: a record that is recognised late keeps the time at which its last
    /// byte arrived.
    arrivals: [MonotonicTime; CAPACITY],
    len: usize,
    locked: bool,
    counters: Counters,
}

impl<F> Decoder<F> {
    /// A decoder at the beginning of a stream.
    #[must_use]
    pub const fn new(format: F) -> Self {
        Self {
            format,
            nanos_per_byte: None,
            previous_push: NEVER,
            previous_byte: None,
            bytes: [0; CAPACITY],
            arrivals: [NEVER; CAPACITY],
            len: 0,
            locked: false,
            counters: Counters {
                records: 0,
                without_pose: 0,
                skipped_bytes: 0,
                resyncs: 0,
                implausible: 0,
                error: None,
            },
        }
    }

    /// Corrects arrival times by the baud rate of the line: a record that ends n bytes before
    /// the end of one read arrived n · 10 bits earlier (8N1), but not before the end of the
    /// previous read. Without this, all records of one read have the time of the read.
    #[must_use]
    pub fn with_baud(mut self, baud: u32) -> Self {
        self.nanos_per_byte = (baud > 0).then(|| 10.0e9 / f64::from(baud));
        self
    }

    pub(crate) fn set_format(&mut self, format: F) {
        self.format = format;
    }

    /// The layout of the records.
    #[must_use]
    pub const fn format(&self) -> &F {
        &self.format
    }

    /// Whether the decoder is synchronised with the stream.
    #[must_use]
    pub const fn locked(&self) -> bool {
        self.locked
    }

    /// The counters so far.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Discards buffered bytes, e.g. after a port has been reopened. The counters are kept.
    pub const fn reset(&mut self) {
        self.len = 0;
        self.locked = false;
        self.previous_push = NEVER;
        self.previous_byte = None;
    }

    /// Arrival time of a byte that is followed by `after` bytes of the same read.
    fn arrival(&self, arrived_at: MonotonicTime, after: usize) -> MonotonicTime {
        match self.nanos_per_byte {
            Some(nanos) => arrived_at
                .offset_nanos(-((after as f64 * nanos) as i64))
                .max(self.previous_push.min(arrived_at)),
            None => arrived_at,
        }
    }

    /// Appends as many of `bytes` as fit; returns their number.
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

    /// Counts `count` skipped bytes; the decoder loses synchronisation.
    fn skip(&mut self, count: usize, fault: Fault) -> Outcome {
        self.counters.resyncs += u64::from(self.locked);
        self.counters.implausible += u64::from(fault == Fault::Implausible);
        self.counters.skipped_bytes += count as u64;
        self.locked = false;
        Outcome::Skip(count)
    }

    /// Waits for more bytes, unless there is no room for them.
    fn wait(&mut self, start: usize) -> Outcome {
        if start == 0 && self.len == CAPACITY {
            self.skip(1, Fault::Layout)
        } else {
            Outcome::Wait
        }
    }

    fn count(&mut self, reading: Option<Reading>) {
        match reading {
            Some(reading) => {
                self.counters.records += 1;
                self.counters.error = reading.error;
            }
            None => self.counters.without_pose += 1,
        }
    }
}

/// Result of examining the bytes at one position of the buffer.
enum Outcome {
    /// A record of this length.
    Take(usize, Option<Reading>),
    /// This many bytes that belong to no record.
    Skip(usize),
    /// More bytes are needed.
    Wait,
}

impl<F: Framing> Decoder<F> {
    /// Adds bytes, the last of which arrived at `arrived_at`, and passes every record found to
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
        self.previous_push = arrived_at;
    }

    /// Removes everything from the buffer that can be classified already.
    fn drain(&mut self, sink: &mut impl FnMut(PoseSample)) {
        let mut start = 0;
        while start < self.len {
            match self.examine(start) {
                Outcome::Wait => break,
                Outcome::Skip(count) => start += count,
                Outcome::Take(len, reading) => {
                    start += len;
                    self.count(reading);
                    if let Some(reading) = reading {
                        sink(reading.into_sample(self.arrivals[start - 1]));
                    }
                }
            }
        }
        self.previous_byte = self.byte_before(start);
        self.bytes.copy_within(start..self.len, 0);
        self.arrivals.copy_within(start..self.len, 0);
        self.len -= start;
    }

    fn byte_before(&self, start: usize) -> Option<u8> {
        start
            .checked_sub(1)
            .map_or(self.previous_byte, |i| Some(self.bytes[i]))
    }

    fn examine(&mut self, start: usize) -> Outcome {
        let bytes = &self.bytes[start..self.len];
        let (len, reading) = match self.format.classify(self.byte_before(start), bytes) {
            Verdict::Reading { len, reading } => (len, Some(reading)),
            Verdict::NoPose { len } => (len, None),
            Verdict::Incomplete => return self.wait(start),
            Verdict::Noise { skip, fault } => {
                return self.skip(skip.clamp(1, self.len - start), fault);
            }
        };
        let next = &self.bytes[start + len..self.len];
        if self.locked {
            return Outcome::Take(len, reading);
        }
        if next.is_empty() {
            return self.wait(start);
        }
        match self.format.classify(self.byte_before(start + len), next) {
            Verdict::Reading { .. } | Verdict::NoPose { .. } => {
                self.locked = true;
                Outcome::Take(len, reading)
            }
            Verdict::Incomplete => self.wait(start),
            Verdict::Noise { .. } => self.skip(1, Fault::Layout),
        }
    }
}

#[cfg(test)]
mod tests;
