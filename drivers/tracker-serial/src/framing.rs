//! How a protocol distinguishes its records from other bytes, and the contents of a record.

use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};

/// Distinguishes the records of one protocol from other bytes.
pub trait Framing {
    /// Classifies the bytes at the front of `bytes`, at least one. `previous` is the byte that
    /// came just before them, `None` at the beginning of the stream. Once `bytes` are as long
    /// as a record, the answer must not be [`Verdict::Incomplete`] any more.
    fn classify(&self, previous: Option<u8>, bytes: &[u8]) -> Verdict;
}

/// Classification of the bytes at one position of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// A valid record with a pose.
    Reading {
        /// Length of the record, bytes.
        len: usize,
        /// Its contents.
        reading: Reading,
    },
    /// A valid record without a pose, such as an answer to a command or a comment.
    NoPose {
        /// Length of the record, bytes.
        len: usize,
    },
    /// Possibly the beginning of a record.
    Incomplete,
    /// No record starts here.
    Noise {
        /// Number of bytes, at least one, in which no record can start.
        skip: usize,
        /// Why not.
        fault: Fault,
    },
}

impl Verdict {
    /// Noise; one byte can be skipped.
    #[must_use]
    pub const fn noise(fault: Fault) -> Self {
        Self::Noise { skip: 1, fault }
    }
}

/// Contents of one record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The tracker's number of the receiver, from 1.
    pub station: u8,
    /// The device's error letter. Some devices repeat the last error in every record, so it is
    /// no reason to discard the pose.
    pub error: Option<u8>,
    /// Pose of the receiver, metres.
    pub transmitter_from_sensor: RigidTransform,
}

impl Reading {
    /// The sample of a record whose last byte arrived at `arrived_at`.
    #[must_use]
    pub const fn into_sample(self, arrived_at: MonotonicTime) -> PoseSample {
        PoseSample {
            station: self.station,
            transmitter_from_sensor: self.transmitter_from_sensor,
            arrived_at,
            error: self.error,
        }
    }
}

/// Why bytes are not a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// A byte in a fixed position is wrong, or the checksum is.
    #[error("not laid out as a record")]
    Layout,
    /// The layout is right, but no device can have measured these numbers.
    #[error("a record with impossible numbers")]
    Implausible,
}
