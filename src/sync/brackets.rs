//! The exposures of a bracket come together into one view of the environment.

use penumbra_interface::{Frame, MonotonicTime};
use std::collections::VecDeque;
use std::sync::Arc;

/// One view of the environment: the base exposure and its brackets.
#[derive(Clone, Debug)]
pub struct EnvironmentSet {
    /// Counts the views, from 1; a higher one is newer.
    pub generation: u64,
    /// Middle of the base exposure, corrected for the camera's latency.
    pub captured_at: MonotonicTime,
    /// When the first of its pictures came.
    pub arrived_at: MonotonicTime,
    /// The base exposure first, then its brackets as they came.
    pub frames: Vec<Frame>,
}

/// Views that may still be paired.
const KEPT: usize = 16;
/// A view whose brackets fail to come is used as it is after so long; until then the one
/// before it is. A camera that is bracketed live, each exposure held for some frames, takes
/// a quarter of a second for a cycle of three.
const PATIENCE_NANOS: i64 = 500_000_000;
/// A bracket taken longer than this before or after the base exposure is not of its view.
const SPAN_NANOS: i64 = 500_000_000;

/// A camera whose stamps go back by more than this has begun another time.
const JUMP_BACK_NANOS: i64 = 500_000_000;

/// Gathers pictures into views. A picture of the base exposure (0 EV) begins a view.
#[derive(Clone, Debug)]
pub(super) struct Gathering {
    /// Brackets of a whole view.
    brackets: usize,
    /// In order of capture; the newest may still be gathering.
    sets: VecDeque<Arc<EnvironmentSet>>,
    generation: u64,
    /// Brackets whose base exposure is missing.
    pub orphans: u64,
    /// Views that were used or followed before all their brackets came.
    pub incomplete: u64,
}

impl Gathering {
    pub fn new(brackets: usize) -> Self {
        Self {
            brackets,
            sets: VecDeque::with_capacity(KEPT + 1),
            generation: 0,
            orphans: 0,
            incomplete: 0,
        }
    }

    pub fn clear(&mut self) {
        self.sets.clear();
    }

    pub const fn generation(&self) -> u64 {
        self.generation
    }

    /// Takes a picture that was captured at `captured_at`.
    pub fn push(&mut self, frame: Frame, captured_at: MonotonicTime) {
        if frame.bracket_ev != 0.0 {
            self.join(frame, captured_at);
            return;
        }
        let before = self.sets.back();
        let unfinished = before.is_some_and(|set| set.frames.len() <= self.brackets);
        self.incomplete += u64::from(unfinished);
        let newest = before.map(|set| set.captured_at);
        if newest.is_some_and(|newest| newest.nanos_since(captured_at) > JUMP_BACK_NANOS) {
            self.sets.clear();
        }
        self.generation += 1;
        let set = EnvironmentSet {
            generation: self.generation,
            captured_at,
            arrived_at: frame.arrived_at,
            frames: vec![frame],
        };
        let place = self.sets.partition_point(|s| s.captured_at <= captured_at);
        self.sets.insert(place, Arc::new(set));
        if self.sets.len() > KEPT {
            self.sets.pop_front();
        }
    }

    /// A bracket joins the newest view, unless that is another one's or was taken already.
    fn join(&mut self, frame: Frame, captured_at: MonotonicTime) {
        let generation = self.generation;
        let newest = self.sets.iter_mut().find(|s| s.generation == generation);
        let open = newest.filter(|set| {
            let apart = captured_at.nanos_since(set.captured_at);
            let taken = set.frames.iter().any(|f| f.bracket_ev == frame.bracket_ev);
            apart.abs() <= SPAN_NANOS && !taken
        });
        // A view that a frame was paired with already is never changed: whoever holds it
        // has begun to work with it.
        match open.and_then(Arc::get_mut) {
            Some(set) => set.frames.push(frame),
            None => self.orphans += 1,
        }
    }

    /// The newest view that is not from the future of `captured_at` and has, at `now`, all
    /// the brackets that it will get.
    pub fn newest_until(
        &self,
        captured_at: MonotonicTime,
        now: MonotonicTime,
    ) -> Option<&Arc<EnvironmentSet>> {
        let whole = |set: &&Arc<EnvironmentSet>| {
            set.frames.len() > self.brackets
                || set.generation < self.generation
                || now.nanos_since(set.arrived_at) >= PATIENCE_NANOS
        };
        let until = |set: &&Arc<EnvironmentSet>| set.captured_at <= captured_at;
        self.sets.iter().rev().filter(until).find(whole)
    }

    /// The very first view, for pictures from before it; `None` once others came.
    pub fn first(&self, now: MonotonicTime) -> Option<&Arc<EnvironmentSet>> {
        let first = self.sets.front().filter(|set| set.generation == 1)?;
        self.newest_until(first.captured_at, now)
    }
}
