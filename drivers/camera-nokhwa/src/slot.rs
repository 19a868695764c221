//! Where the newest frame waits between two threads.

use penumbra_interface::{DeviceError, Frame};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A place for one frame: a newer one takes the place of an older.
#[derive(Default)]
pub(crate) struct Slot {
    held: Mutex<Held>,
    came: Condvar,
}

#[derive(Default)]
struct Held {
    frame: Option<Frame>,
    superseded: u64,
    error: Option<DeviceError>,
    /// The reader has gone: the writer is to end.
    closed: bool,
}

impl Slot {
    /// Leaves a frame; whether anybody still reads.
    pub fn put(&self, frame: Frame) -> bool {
        let mut held = self.lock();
        if held.frame.replace(frame).is_some() {
            held.superseded += 1;
        }
        self.came.notify_one();
        !held.closed
    }

    /// Leaves the error that ends the camera.
    pub fn fail(&self, error: DeviceError) {
        self.lock().error = Some(error);
        self.came.notify_one();
    }

    /// Waits for a frame. The error that ended the camera comes after its last frame.
    pub fn take(&self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let waiting = |held: &mut Held| held.frame.is_none() && held.error.is_none();
        let waited = self.came.wait_timeout_while(self.lock(), timeout, waiting);
        let (mut held, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match (held.frame.take(), &held.error) {
            (Some(frame), _) => Ok(Some(frame)),
            (None, Some(error)) => Err(error.clone()),
            (None, None) => Ok(None),
        }
    }

    /// Frames that gave way to newer ones.
    pub fn superseded(&self) -> u64 {
        self.lock().superseded
    }

    /// Tells the writer to end.
    pub fn close(&self) {
        self.lock().closed = true;
    }

    fn lock(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
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
    fn the_newest_frame_wins_and_the_error_comes_last() {
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
