//! Keeps the recorded pace.

use penumbra_config::ReplaySpeed;
use penumbra_interface::MonotonicTime;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A frame later than this is left out, so that the picture keeps up with the recording.
const LATE: Duration = Duration::from_millis(50);
/// Recorded time that passes between two frames. With more, or with time that goes back,
/// the recorder's clock has jumped or the recording paused: nobody wants to wait for that.
const LONGEST_GAP_SECONDS: f64 = 5.0;
/// How long a wish to stop goes unheard.
const NAP: Duration = Duration::from_millis(50);

/// When each frame is due.
pub(super) struct Pace {
    factor: Option<f64>,
    /// No frame is left out: the picture falls behind the recording instead.
    keep_all: bool,
    /// A moment here and the same in the recording.
    begun: Option<(Instant, MonotonicTime)>,
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
            begun: None,
            previous: MonotonicTime::from_nanos(0),
        }
    }

    pub const fn restart(&mut self) {
        self.begun = None;
    }

    /// Waits until a frame that arrived at `at` is due, or until `stop`; false if it is too
    /// late for it. Where all are kept it goes on from this one at the recorded pace.
    pub fn wait(&mut self, at: MonotonicTime, stop: &AtomicBool) -> bool {
        let now = Instant::now();
        let Some(due) = self.due(at, now) else {
            return true;
        };
        while !stop.load(Ordering::Relaxed) {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            std::thread::sleep(left.min(NAP));
        }
        let late = now.saturating_duration_since(due) >= LATE;
        if late && self.keep_all {
            self.restart();
        }
        !late || self.keep_all
    }

    /// When a frame that arrived at `at` is due; `None` if that does not matter.
    fn due(&mut self, at: MonotonicTime, now: Instant) -> Option<Instant> {
        let factor = self.factor?;
        let step = at.seconds_since(self.previous);
        self.previous = at;
        if !(0.0..=LONGEST_GAP_SECONDS).contains(&step) {
            self.begun = None;
        }
        let (start, first) = *self.begun.get_or_insert((now, at));
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
    fn frames_are_due_at_the_recorded_distances_times_the_factor() {
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
    fn after_a_jump_of_the_clock_the_pace_begins_anew() {
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
    fn late_frames_are_left_out_and_a_stop_ends_the_wait() {
        let mut pace = Pace::new(ReplaySpeed::Factor(1.0), false);
        let (go, stop) = (AtomicBool::new(false), AtomicBool::new(true));
        pace.begun = Some((Instant::now() - Duration::from_secs(1), at(0)));
        pace.previous = at(0);
        assert!(!pace.wait(at(10), &go));
        // Due in four seconds; a test that waited for it would be seen to.
        assert!(pace.wait(at(5000), &stop));
    }

    #[test]
    fn where_all_are_kept_late_frames_are_played_late() {
        let mut pace = Pace::new(ReplaySpeed::Factor(1.0), true);
        let go = AtomicBool::new(false);
        let second_ago = Instant::now() - Duration::from_secs(1);
        pace.begun = Some((second_ago, at(0)));
        pace.previous = at(0);
        assert!(pace.wait(at(10), &go));
        // What follows comes at the recorded distance again, and is not hurried.
        let now = Instant::now();
        assert_eq!(pace.due(at(20), now), Some(now));
        assert_eq!(pace.due(at(50), now), Some(now + Duration::from_millis(30)));
    }
}
