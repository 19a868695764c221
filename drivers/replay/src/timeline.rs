//! One time for all devices of a recording.

use penumbra_interface::{Clock, MonotonicTime};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// When what was recorded is due here. The recording begins when the first of its devices
/// is opened, and again after its end.
pub struct Timeline {
    clock: Arc<dyn Clock>,
    sleep: fn(Duration),
    /// First arrival in the recording.
    first: MonotonicTime,
    /// From one beginning to the next.
    lap_nanos: i64,
    began: OnceLock<MonotonicTime>,
}

/// From the last arrival of one lap to the first of the next: one picture at 30 a second.
const SEAM_NANOS: i64 = 33_333_333;

impl Timeline {
    /// For a recording whose arrivals lie between `first` and `last`. `sleep` is how the
    /// devices wait: `std::thread::sleep`, unless a test knows better.
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
            lap_nanos: last.nanos_since(first).max(0).saturating_add(SEAM_NANOS),
            began: OnceLock::new(),
        }
    }

    /// Nanoseconds from the recording's time to the present one in lap `lap`.
    pub(crate) fn shift_nanos(&self, lap: i64) -> i64 {
        let began = *self.began.get_or_init(|| self.clock.now());
        began
            .nanos_since(self.first)
            .saturating_add(lap.saturating_mul(self.lap_nanos))
    }

    /// The lap that runs now, from 0.
    pub(crate) fn lap(&self) -> i64 {
        let began = *self.began.get_or_init(|| self.clock.now());
        self.clock.now().nanos_since(began).max(0) / self.lap_nanos
    }

    pub(crate) fn now(&self) -> MonotonicTime {
        self.clock.now()
    }

    /// Waits until `due`, but not longer than `longest`; true if it is due now.
    pub(crate) fn wait_until(&self, due: MonotonicTime, longest: Duration) -> bool {
        let left =
            u64::try_from(due.nanos_since(self.now())).map_or(Duration::ZERO, Duration::from_nanos);
        if !left.is_zero() {
            (self.sleep)(left.min(longest));
        }
        self.now() >= due
    }

    /// Waits for `longest`.
    pub(crate) fn wait(&self, longest: Duration) {
        (self.sleep)(longest);
    }
}
