//! A connection to a tracker.

use penumbra_interface::{DeviceError, MonotonicTime};
use std::time::Duration;

/// An open serial port or socket.
pub trait Line: Send {
    /// Waits up to `timeout` for bytes and reads the available ones into `buffer`; returns their
    /// number and the time of reading, `None` if there are none.
    ///
    /// # Errors
    /// [`DeviceError::Unplugged`] when the other end has disconnected and everything has been read.
    fn read(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
    ) -> Result<Option<(usize, MonotonicTime)>, DeviceError>;

    /// Writes all of `bytes`.
    ///
    /// # Errors
    /// As for [`read`](Self::read); [`DeviceError::Silent`] if the other end accepts nothing for a
    /// second.
    fn write(&mut self, bytes: &[u8]) -> Result<(), DeviceError>;
}
