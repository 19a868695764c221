//! The interface of tracker drivers.

use crate::error::DeviceError;
use crate::time::MonotonicTime;
use bytes::Bytes;
use std::time::Duration;

/// An open, configured, streaming tracker. Dropping it stops the stream and closes the port.
///
/// A driver delivers the bytes as they arrived, not poses: the same bytes go into the recording
/// and into the decoder of the protocol, so that a replay decodes exactly what the live rig did.
pub trait Tracker: Send {
    /// Waits up to `timeout` for bytes; `None` if none came.
    ///
    /// # Errors
    /// The device fails; [`DeviceError::recovery`] tells whether to read on, reopen or stop.
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError>;

    /// Reports the state of the tracker.
    fn report(&self) -> TrackerReport;
}

/// The bytes of one read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackerBytes {
    /// The bytes.
    pub bytes: Bytes,
    /// When the last of them had arrived.
    pub arrived_at: MonotonicTime,
}

/// The state of a tracker.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackerReport {
    /// An identity that stays the same after replugging: the name under `/dev/serial/by-id`, a
    /// network address, or what comes closest to it.
    pub identity: String,
    /// Name of the protocol of its bytes, such as `fastrak-binary-quaternion`, for which a
    /// decoder can be made.
    pub protocol: String,
    /// The device's description of itself, one line, if it sent one.
    pub description: Option<String>,
    /// A note for the user, one line: an error letter, a mode that the device did not confirm.
    pub warning: Option<String>,
    /// Bytes received.
    pub bytes: u64,
}
