//! Replays a recording at its recorded rate, times a factor.

use penumbra_config::ReplaySpeed;
use penumbra_interface::MonotonicTime;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Delay from which a frame is skipped, so that the picture keeps up with the recording.
const MAX_DELAY: Duration = Duration::from_millis(50);
/// Maximum recorded time between two frames. A larger or negative difference is a jump of the
/// recorder's clock or a pause of the recording, and is not replayed.
const MAX_GAP_SECONDS: f64 = 5.0;
/// Interval at which a request to stop is checked, and what goes on meanwhile is looked after, while
/// waiting.
pub(super) const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Computes when each frame is due and waits for it.
pub(super) struct Pace {
    factor: Option<f64>,
    /// Whether no frame is skipped; the picture then falls behind the recording.
    keep_all: bool,
    /// The start of the replay: time of this machine and time of the recording.
    start: Option<(Instant, MonotonicTime)>,
    previous: MonotonicTime,
}

impl Pace {
    pub const fn new(speed: ReplaySpeed, keep_all: bool) -> Self {
        let factor = match speed {
            ReplaySpeed::Factor(factor) => Some(factor),
            ReplaySpeed::Max => None,
        };
        Self {
            factor,
            keep_all,
            start: None,
            previous: MonotonicTime::from_nanos(0),
        }
    }

    pub const fn restart(&mut self) {
        self.start = None;
    }

    /// Waits until a frame that arrived at `at` is due, or until `stop`, and calls `meanwhile` at
    /// least once and then again and again. Returns false if the frame is late and must be skipped. If
    /// all frames are kept, a late frame restarts the pace.
    pub fn wait(
        &mut self,
        at: MonotonicTime,
        stop: &AtomicBool,
        mut meanwhile: impl FnMut(),
    ) -> bool {
        meanwhile();
        let now = Instant::now();
        let Some(due) = self.due(at, now) else {
            return true;
        };
        while !stop.load(Ordering::Relaxed) {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            std::thread::sleep(left.min(POLL_INTERVAL));
            meanwhile();
        }
        let is_late = now.saturating_duration_since(due) >= MAX_DELAY;
        if is_late && self.keep_all {
            self.restart();
        }
        !is_late || self.keep_all
    }

    /// Returns whether a frame that arrived at `at` and is read ahead of the frame that is due is
    /// late already and will be skipped.
    pub fn is_late(&self, at: MonotonicTime) -> bool {
        let (Some(factor), Some((start, first)), false) = (self.factor, self.start, self.keep_all)
        else {
            return false;
        };
        let after = at.seconds_since(first).max(0.0) / factor;
        start.elapsed() >= Duration::from_secs_f64(after) + MAX_DELAY
    }

    /// Returns when a frame that arrived at `at` is due; `None` at maximum speed.
    fn due(&mut self, at: MonotonicTime, now: Instant) -> Option<Instant> {
        let factor = self.factor?;
        let step = at.seconds_since(self.previous);
        self.previous = at;
        if !(0.0..=MAX_GAP_SECONDS).contains(&step) {
            self.start = None;
        }
        let (start, first) = *self.start.get_or_insert((now, at));
        Some(start + Duration::from_secs_f64(at.seconds_since(first) / factor))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> MonotonicTime {
        MonotonicTime::from_nanos(1_000_000_000_000 + millis * 1_000_000)
    }

    #[test]
    fn frames_are_due_at_recorded_intervals_divided_by_the_factor() {
        let (mut pace, now) = (Pace::new(ReplaySpeed::Factor(2.0), false), Instant::now());
        assert_eq!(pace.due(at(0), now), Some(now));
        assert_eq!(pace.due(at(40), now), Some(now + Duration::from_millis(20)));
        assert_eq!(
            pace.due(at(2040), now),
            Some(now + Duration::from_millis(1020))
        );
        assert_eq!(Pace::new(ReplaySpeed::Max, false).due(at(0), now), None);
    }

    #[test]
    fn clock_jump_restarts_the_pace() {
        let (mut pace, start) = (Pace::new(ReplaySpeed::Factor(1.0), false), Instant::now());
        pace.due(at(0), start);
        let later = start + Duration::from_secs(3);
        for jumped in [-10_000, 3_600_000] {
            assert_eq!(pace.due(at(jumped), later), Some(later));
            let next = later + Duration::from_millis(33);
            assert_eq!(pace.due(at(jumped + 33), later), Some(next));
        }
    }

    #[test]
    fn late_frames_are_skipped_and_a_stop_request_ends_the_wait() {
        let mut pace = Pace::new(ReplaySpeed::Factor(1.0), false);
        let (go, stop) = (AtomicBool::new(false), AtomicBool::new(true));
        pace.start = Some((Instant::now() - Duration::from_secs(1), at(0)));
        pace.previous = at(0);
        assert!(pace.is_late(at(10)) && !pace.is_late(at(2000)));
        assert!(!pace.wait(at(10), &go, || ()));
        // Due in four seconds; the stop request must end the wait.
        let mut calls = 0;
        assert!(pace.wait(at(5000), &stop, || calls += 1));
        assert!(calls > 0);
    }

    #[test]
    fn keep_all_plays_late_frames_late() {
        let mut pace = Pace::new(ReplaySpeed::Factor(1.0), true);
        let go = AtomicBool::new(false);
        let second_ago = Instant::now() - Duration::from_secs(1);
        pace.start = Some((second_ago, at(0)));
        pace.previous = at(0);
        assert!(!pace.is_late(at(10)));
        assert!(pace.wait(at(10), &go, || ()));
        // Later frames follow at the recorded intervals again.
        let now = Instant::now();
        assert_eq!(pace.due(at(20), now), Some(now));
        assert_eq!(pace.due(at(50), now), Some(now + Duration::from_millis(30)));
    }
}
