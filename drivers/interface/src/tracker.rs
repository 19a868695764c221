//! What every tracker driver does.

use crate::{DeviceError, MonotonicTime};
use bytes::Bytes;
use std::time::Duration;

/// A tracker that is open, configured and streams. Dropping it stops the stream in order
/// and closes the port.
///
/// A driver hands over bytes as they came, not poses: the same bytes go into the recording
/// and into the protocol's decoder, so that a replay decodes what the live rig decoded.
pub trait Tracker: Send {
    /// Waits up to `timeout` for bytes; `None` if none came.
    ///
    /// # Errors
    /// [`DeviceError::recovery`] says whether to read on, to reopen or to give up.
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError>;

    /// What is known of the tracker.
    fn report(&self) -> TrackerReport;
}

/// Bytes as one read gave them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrackerBytes {
    /// The bytes.
    pub bytes: Bytes,
    /// When the last of them was there.
    pub arrived_at: MonotonicTime,
}

/// A tracker's own account of itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackerReport {
    /// Who it is, the same after replugging: the name under `/dev/serial/by-id`, an
    /// address, or what comes nearest to it.
    pub identity: String,
    /// How its bytes are spelled, by the name under which a session keeps it
    /// (`fastrak-binary-quaternion`): what a decoder is made from.
    pub protocol: String,
    /// What the device said of itself when it was asked, in one line.
    pub said: Option<String>,
    /// What is odd but no reason to stop: an error letter, a mode it did not confirm.
    pub warning: Option<String>,
    /// Bytes received.
    pub bytes: u64,
}
