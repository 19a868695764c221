//! Plays the recording of one device.

use crate::timeline::Timeline;
use penumbra_interface::{Frame, MonotonicTime, TrackerBytes};
use std::sync::Arc;
use std::time::Duration;

/// The recording of one device from its beginning, in the order of arrival.
pub type Items<T> = Box<dyn Iterator<Item = T> + Send>;

/// Opens the recording again at its beginning.
pub(crate) type Restart<T> = Box<dyn FnMut() -> Items<T> + Send>;

/// One item of a recording.
pub trait Recorded: Send {
    /// Time of arrival in the recording.
    fn arrived_at(&self) -> MonotonicTime;
    /// Adds `nanos` to all its times.
    fn shift(&mut self, nanos: i64);
}

impl Recorded for Frame {
    fn arrived_at(&self) -> MonotonicTime {
        self.arrived_at
    }

    fn shift(&mut self, nanos: i64) {
        self.arrived_at = self.arrived_at.offset_nanos(nanos);
        self.captured_at = self.captured_at.offset_nanos(nanos);
    }
}

impl Recorded for TrackerBytes {
    fn arrived_at(&self) -> MonotonicTime {
        self.arrived_at
    }

    fn shift(&mut self, nanos: i64) {
        self.arrived_at = self.arrived_at.offset_nanos(nanos);
    }
}

/// Items that are later than this are skipped, nanoseconds: the program was suspended.
pub(crate) const LATE_NANOS: i64 = 100_000_000;

/// Plays the items of one device, again and again.
pub(crate) struct Playback<T> {
    restart: Restart<T>,
    items: Items<T>,
    timeline: Arc<Timeline>,
    /// Number of the pass through the recording, from 0.
    pass: i64,
    next: Option<T>,
    skipped: u64,
}

impl<T: Recorded> Playback<T> {
    pub(crate) fn new(timeline: Arc<Timeline>, mut restart: Restart<T>) -> Self {
        let mut playback = Self {
            pass: timeline.pass(),
            items: restart(),
            restart,
            timeline,
            next: None,
            skipped: 0,
        };
        playback.skip_past();
        playback
    }

    /// Skips items that were due before now.
    fn skip_past(&mut self) {
        let now = self.timeline.now();
        while self.due().is_some_and(|due| due < now) {
            self.next = None;
        }
    }

    /// When the next item is due; `None` if the recording is empty.
    fn due(&mut self) -> Option<MonotonicTime> {
        if self.next.is_none() {
            self.next = self.items.next();
        }
        if self.next.is_none() {
            self.pass += 1;
            self.items = (self.restart)();
            self.next = self.items.next();
        }
        let arrived_at = self.next.as_ref()?.arrived_at();
        Some(arrived_at.offset_nanos(self.timeline.shift_nanos(self.pass)))
    }

    /// How many items were skipped because they were late.
    pub(crate) const fn skipped(&self) -> u64 {
        self.skipped
    }

    /// Waits up to `timeout` for the next item; its times are shifted to the present.
    pub(crate) fn next(&mut self, timeout: Duration) -> Option<T> {
        loop {
            let Some(due) = self.due() else {
                self.timeline.wait(timeout);
                return None;
            };
            if !self.timeline.wait_until(due, timeout) {
                return None;
            }
            let shift = self.timeline.shift_nanos(self.pass);
            let late = self.timeline.now().nanos_since(due) > LATE_NANOS;
            let Some(mut item) = self.next.take() else {
                continue;
            };
            if late {
                self.skipped += 1;
                continue;
            }
            item.shift(shift);
            return Some(item);
        }
    }
}
