//! How many frames a camera lags behind its exposure control, seen in the pictures.
//!
//! The exposure is toggled between two values; after each toggle the frame is looked for
//! at which the brightness goes over to its new level. Several toggles vote, since noise, a
//! flickering lamp or somebody walking by may spoil one of them.

use super::cycle::Timing;

/// Longest lag that is told from "does not follow at all".
pub(crate) const MAX_LAG: u64 = 6;
/// Frames from toggle to toggle: the lag and some at the new level.
const WINDOW: u64 = MAX_LAG + 4;
const TOGGLES: usize = 6;
/// Votes that must agree.
const QUORUM: usize = 4;
/// Frames by which a level is judged.
const SETTLED: usize = 3;
/// Levels closer than this (stops) cannot be told apart.
const LEAST_STEP: f64 = 0.15;

/// What the meter wants next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Wish {
    /// Another frame.
    Frame,
    /// The other exposure, now.
    Toggle,
    /// Nothing more: the timing, or `None` if the pictures do not tell.
    Done(Option<Timing>),
}

/// Measures the lag.
#[derive(Clone, Debug, Default)]
pub(crate) struct LagMeter {
    /// Frames since the last toggle: their place after it, and their brightness in stops.
    window: Vec<(u64, f64)>,
    toggled_after: Option<u64>,
    first: Option<u64>,
    old_level: Option<Level>,
    votes: Vec<Option<u64>>,
}

#[derive(Clone, Copy, Debug)]
struct Level {
    median: f64,
    spread: f64,
}

impl LagMeter {
    /// Takes a frame: its counter and its brightness in stops.
    pub(crate) fn take(&mut self, sequence: u64, stops: f64) -> Wish {
        let start = self.toggled_after.map_or_else(
            || *self.first.get_or_insert(sequence),
            |toggled| toggled + 1,
        );
        let place = sequence.saturating_sub(start);
        self.window.push((place, stops));
        if place + 1 < WINDOW || self.window.len() < SETTLED {
            return Wish::Frame;
        }
        let new_level = level(&self.window);
        if let Some(old_level) = self.old_level {
            self.votes
                .push(crossing(&self.window, old_level, new_level));
        }
        self.old_level = Some(new_level);
        if self.votes.len() >= TOGGLES {
            return Wish::Done(elect(&self.votes));
        }
        Wish::Toggle
    }

    /// The exposure was toggled after frame `sequence` was received.
    pub(crate) fn toggled(&mut self, sequence: u64) {
        self.window.clear();
        self.toggled_after = Some(sequence);
    }
}

/// Level at the end of a window.
fn level(window: &[(u64, f64)]) -> Level {
    let mut last: Vec<f64> = window.iter().rev().take(SETTLED).map(|(_, b)| *b).collect();
    last.sort_by(f64::total_cmp);
    let spread = last.last().unwrap_or(&0.0) - last.first().unwrap_or(&0.0);
    Level {
        median: last.get(last.len() / 2).copied().unwrap_or(0.0),
        spread,
    }
}

/// The place of the first frame at the new level; `None` if it is not clear.
fn crossing(window: &[(u64, f64)], old: Level, new: Level) -> Option<u64> {
    let step = new.median - old.median;
    let noise = old.spread.max(new.spread);
    if !step.is_finite() || step.abs() < LEAST_STEP.max(3.0 * noise) {
        return None;
    }
    let is_new = |stops: f64| (stops - old.median) / step > 0.5;
    let last_old = window.iter().rev().find(|(_, stops)| !is_new(*stops));
    let place = last_old.map_or(0, |(place, _)| place + 1);
    // Were the frames about the crossing lost, it could be any of them.
    window.iter().any(|(at, _)| *at == place).then_some(place)
}

/// The lag that a quorum of votes agrees on to a frame.
fn elect(votes: &[Option<u64>]) -> Option<Timing> {
    let mut cast: Vec<u64> = votes.iter().flatten().copied().collect();
    cast.sort_unstable();
    let median = *cast.get(cast.len() / 2)?;
    let near: Vec<u64> = cast
        .into_iter()
        .filter(|v| v.abs_diff(median) <= 1)
        .collect();
    let (first, last) = (*near.first()?, *near.last()?);
    (near.len() >= QUORUM && last <= MAX_LAG).then_some(Timing {
        lag: first,
        guard: last - first,
    })
}
