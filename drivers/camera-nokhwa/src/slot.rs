//! Passes the newest frame from one thread to another.

use penumbra_interface::{DeviceError, Frame};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Holds one frame; a newer one replaces it.
#[derive(Default)]
pub(crate) struct Slot {
    held: Mutex<Held>,
    changed: Condvar,
}

#[derive(Default)]
struct Held {
    frame: Option<Frame>,
    superseded: u64,
    error: Option<DeviceError>,
    /// The reader is gone; the writer must end.
    closed: bool,
}

impl Slot {
    /// Stores a frame; returns whether there still is a reader.
    pub fn put(&self, frame: Frame) -> bool {
        let mut held = self.lock();
        if held.frame.replace(frame).is_some() {
            held.superseded += 1;
        }
        self.changed.notify_one();
        !held.closed
    }

    /// Stores the error that ends the stream.
    pub fn fail(&self, error: DeviceError) {
        self.lock().error = Some(error);
        self.changed.notify_one();
    }

    /// Waits for a frame. The error that ended the stream is returned after the last frame.
    pub fn take(&self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let waiting = |held: &mut Held| held.frame.is_none() && held.error.is_none();
        let waited = self
            .changed
            .wait_timeout_while(self.lock(), timeout, waiting);
        let (mut held, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match (held.frame.take(), &held.error) {
            (Some(frame), _) => Ok(Some(frame)),
            (None, Some(error)) => Err(error.clone()),
            (None, None) => Ok(None),
        }
    }

    /// Number of frames that were replaced by newer ones before they were read.
    pub fn superseded(&self) -> u64 {
        self.lock().superseded
    }

    /// Requests the writer to end.
    pub fn close(&self) {
        self.lock().closed = true;
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use penumbra_interface::{MonotonicTime, PixelFormat};

    fn frame(sequence: u64) -> Frame {
        Frame {
            data: Bytes::from_static(b"x"),
            format: PixelFormat::Jpeg,
            width: 0,
            height: 0,
            stride: 0,
            sequence,
            captured_at: MonotonicTime::default(),
            arrived_at: MonotonicTime::default(),
            exposure: None,
            bracket_ev: 0.0,
            controls: None,
        }
    }

    #[test]
    fn newest_frame_is_returned_and_the_error_last() {
        let slot = Slot::default();
        assert!(slot.take(Duration::ZERO).unwrap().is_none());
        assert!(slot.put(frame(1)));
        assert!(slot.put(frame(2)));
        let device = "cam".to_owned();
        slot.fail(DeviceError::Unplugged { device });
        assert_eq!(slot.take(Duration::ZERO).unwrap().unwrap().sequence, 2);
        assert_eq!(slot.superseded(), 1);
        assert!(slot.take(Duration::ZERO).is_err());
        slot.close();
        assert!(!slot.put(frame(3)));
    }
}
