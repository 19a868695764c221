//! The common time of all devices of a recording.

use penumbra_interface::{Clock, MonotonicTime};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Relates recorded times to the present. The recording starts when the first of its devices is
/// opened, and again after its end.
pub struct Timeline {
    clock: Arc<dyn Clock>,
    sleep: fn(Duration),
    /// First arrival time in the recording.
    first: MonotonicTime,
    /// Duration of one pass through the recording.
    pass_nanos: i64,
    /// When the first pass began.
    began: OnceLock<MonotonicTime>,
}

/// Time from the last arrival of one pass to the first of the next: one frame at 30 a second.
const SEAM_NANOS: i64 = 33_333_333;

impl Timeline {
    /// For a recording whose arrival times are from `first` to `last`. The devices wait by
    /// `sleep`: `std::thread::sleep`, or a test's own.
    #[must_use]
    pub fn new(
        (first, last): (MonotonicTime, MonotonicTime),
        clock: Arc<dyn Clock>,
        sleep: fn(Duration),
    ) -> Self {
        Self {
            clock,
            sleep,
            first,
            pass_nanos: last.nanos_since(first).max(0).saturating_add(SEAM_NANOS),
            began: OnceLock::new(),
        }
    }

    /// Offset of recorded times in pass `pass` (from 0), nanoseconds.
    pub(crate) fn shift_nanos(&self, pass: i64) -> i64 {
        let began = *self.began.get_or_init(|| self.clock.now());
        began
            .nanos_since(self.first)
            .saturating_add(pass.saturating_mul(self.pass_nanos))
    }

    /// The present pass, from 0.
    pub(crate) fn pass(&self) -> i64 {
        let began = *self.began.get_or_init(|| self.clock.now());
        self.clock.now().nanos_since(began).max(0) / self.pass_nanos
    }

    pub(crate) fn now(&self) -> MonotonicTime {
        self.clock.now()
    }

    /// Waits until `due`, at most for `timeout`; returns whether `due` is reached.
    pub(crate) fn wait_until(&self, due: MonotonicTime, timeout: Duration) -> bool {
        let left =
            u64::try_from(due.nanos_since(self.now())).map_or(Duration::ZERO, Duration::from_nanos);
        if !left.is_zero() {
            (self.sleep)(left.min(timeout));
        }
        self.now() >= due
    }

    /// Waits for `timeout`.
    pub(crate) fn wait(&self, timeout: Duration) {
        (self.sleep)(timeout);
    }
}
