//! Measures how many frames late a camera applies a new exposure time.
//!
//! The exposure is toggled between two values. After each toggle, the first frame at the new
//! brightness is looked for. Several toggles vote, because noise, a flickering lamp or a
//! passer-by may spoil some.

use super::cycle::Timing;

/// Maximum lag in frames; a longer one cannot be distinguished from a camera that does not react.
pub(crate) const MAX_LAG: u64 = 6;
/// Frames from one toggle to the next: the longest lag and some at the new brightness.
const WINDOW: u64 = MAX_LAG + 4;
/// Toggles that are evaluated.
const TOGGLES: usize = 6;
/// Toggles that must agree on the lag.
const QUORUM: usize = 4;
/// Frames at the end of a window from which its brightness level is taken.
const SETTLED_FRAMES: usize = 3;
/// Minimum difference of two levels that can be distinguished, stops.
const MIN_DIFFERENCE: f64 = 0.15;

/// What the estimator needs next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Request {
    /// Another frame.
    NextFrame,
    /// The other exposure, now.
    Toggle,
    /// Nothing: this is the timing, or `None` if the frames do not show it.
    Done(Option<Timing>),
}

/// Measures the lag of one camera.
#[derive(Clone, Debug, Default)]
pub(crate) struct LagEstimator {
    /// Frames since the last toggle: their number after it, and their brightness in stops.
    window: Vec<(u64, f64)>,
    toggled_after: Option<u64>,
    first: Option<u64>,
    old_level: Option<Level>,
    /// The lag that each toggle shows, if it is clear.
    votes: Vec<Option<u64>>,
}

/// A brightness in stops.
#[derive(Clone, Copy, Debug)]
struct Level {
    median: f64,
    /// Difference between the brightest and the darkest frame.
    spread: f64,
}

impl LagEstimator {
    /// Handles a frame, given by its counter and its brightness in stops.
    pub(crate) fn on_frame(&mut self, sequence: u64, brightness: f64) -> Request {
        let start = self.toggled_after.map_or_else(
            || *self.first.get_or_insert(sequence),
            |toggled| toggled + 1,
        );
        let number = sequence.saturating_sub(start);
        self.window.push((number, brightness));
        if number + 1 < WINDOW || self.window.len() < SETTLED_FRAMES {
            return Request::NextFrame;
        }
        let new_level = final_level(&self.window);
        if let Some(old_level) = self.old_level {
            self.votes
                .push(first_at_new_level(&self.window, old_level, new_level));
        }
        self.old_level = Some(new_level);
        if self.votes.len() >= TOGGLES {
            return Request::Done(agreed_timing(&self.votes));
        }
        Request::Toggle
    }

    /// The exposure was toggled after frame `sequence` was received.
    pub(crate) fn on_toggle(&mut self, sequence: u64) {
        self.window.clear();
        self.toggled_after = Some(sequence);
    }
}

/// The level at the end of a window.
fn final_level(window: &[(u64, f64)]) -> Level {
    let last = window.iter().rev().take(SETTLED_FRAMES);
    let mut last: Vec<f64> = last.map(|(_, brightness)| *brightness).collect();
    last.sort_by(f64::total_cmp);
    let spread = last.last().unwrap_or(&0.0) - last.first().unwrap_or(&0.0);
    Level {
        median: last.get(last.len() / 2).copied().unwrap_or(0.0),
        spread,
    }
}

/// The number of the first frame at the new level; `None` if it is not clear.
fn first_at_new_level(window: &[(u64, f64)], old: Level, new: Level) -> Option<u64> {
    let difference = new.median - old.median;
    let noise = old.spread.max(new.spread);
    if !difference.is_finite() || difference.abs() < MIN_DIFFERENCE.max(3.0 * noise) {
        return None;
    }
    let is_new = |brightness: f64| (brightness - old.median) / difference > 0.5;
    let last_old = window.iter().rev().find(|(_, b)| !is_new(*b));
    let first_new = last_old.map_or(0, |(number, _)| number + 1);
    // If that frame was lost, the change may have come with any of the lost ones.
    window
        .iter()
        .any(|(number, _)| *number == first_new)
        .then_some(first_new)
}

/// The lag that a quorum of votes agrees on to within one frame.
fn agreed_timing(votes: &[Option<u64>]) -> Option<Timing> {
    let mut cast: Vec<u64> = votes.iter().flatten().copied().collect();
    cast.sort_unstable();
    let median = *cast.get(cast.len() / 2)?;
    let near: Vec<u64> = cast
        .into_iter()
        .filter(|vote| vote.abs_diff(median) <= 1)
        .collect();
    let (first, last) = (*near.first()?, *near.last()?);
    (near.len() >= QUORUM && last <= MAX_LAG).then_some(Timing {
        lag: first,
        guard: last - first,
    })
}
