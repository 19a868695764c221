//! A connection to a tracker.

use penumbra_interface::{DeviceError, MonotonicTime};
use std::time::Duration;

/// An open serial port or socket.
pub trait Line: Send {
    /// Waits up to `timeout` for bytes and reads what is there into `buffer`: how many bytes,
    /// and when they were read. `None` if none came.
    ///
    /// # Errors
    /// [`DeviceError::Unplugged`] as soon as the other end is gone and everything has been
    /// read.
    fn read(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
    ) -> Result<Option<(usize, MonotonicTime)>, DeviceError>;

    /// Writes all of `bytes`.
    ///
    /// # Errors
    /// As for [`read`](Self::read); [`DeviceError::Silent`] if the other end takes nothing for
    /// a second.
    fn write(&mut self, bytes: &[u8]) -> Result<(), DeviceError>;
}
