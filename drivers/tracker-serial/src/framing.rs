//! What a protocol says of bytes, and what a record says.

use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};

/// How one protocol's records are told from noise.
pub trait Framing {
    /// What the bytes at the front of `bytes` are, where `before` is the byte that came
    /// right before them, `None` at the stream's beginning. Called with at least one byte; it must
    /// not answer [`Verdict::Incomplete`] for good once it has a record's length.
    fn judge(&self, before: Option<u8>, bytes: &[u8]) -> Verdict;
}

/// What stands at the front of some bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// A good record with a pose, `len` bytes long.
    Reading {
        /// Bytes of it.
        len: usize,
        /// What it says.
        reading: Reading,
    },
    /// A good record of another kind, such as a status, `len` bytes long.
    Aside {
        /// Bytes of it.
        len: usize,
    },
    /// The beginning of what may become a record.
    Incomplete,
    /// No record starts here. `skip` bytes (at least one) may be passed over.
    Noise {
        /// Bytes in which no record can start.
        skip: usize,
        /// Why.
        fault: Fault,
    },
}

impl Verdict {
    /// Noise of one byte.
    #[must_use]
    pub const fn noise(fault: Fault) -> Self {
        Self::Noise { skip: 1, fault }
    }
}

/// What one record says, in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// The tracker's number of the receiver, from 1.
    pub station: u8,
    /// The device's error letter. Latched by some devices, so no reason to drop the pose.
    pub error: Option<u8>,
    /// Pose of the receiver.
    pub transmitter_from_sensor: RigidTransform,
}

impl Reading {
    /// The same as a sample that arrived at `arrived_at`.
    #[must_use]
    pub const fn arrived(self, arrived_at: MonotonicTime) -> PoseSample {
        PoseSample {
            station: self.station,
            transmitter_from_sensor: self.transmitter_from_sensor,
            arrived_at,
            error: self.error,
        }
    }
}

/// Why bytes are no record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// Wrong byte in a fixed place, or a wrong checksum.
    #[error("not laid out as a record")]
    Layout,
    /// Numbers that cannot be.
    #[error("a record with impossible numbers")]
    Implausible,
}
