//! Collects the exposures of a bracket into one view of the environment.

use penumbra_interface::{Frame, MonotonicTime};
use std::collections::VecDeque;
use std::sync::Arc;

/// One view of the environment: the base exposure and its brackets.
#[derive(Clone, Debug)]
pub struct EnvironmentSet {
    /// Number of the view, from 1; newer views have higher numbers.
    pub generation: u64,
    /// Middle of the base exposure, corrected by the camera's latency.
    pub captured_at: MonotonicTime,
    /// Arrival of its first picture.
    pub arrived_at: MonotonicTime,
    /// The base exposure, then its brackets in the order of arrival.
    pub frames: Vec<Frame>,
}

/// Maximum number of views that are kept for pairing.
const MAX_VIEWS: usize = 16;
/// Timeout for the brackets of a view, nanoseconds. Until then the previous view is used, afterwards
/// the incomplete one. A camera that is bracketed live, with each exposure held for some frames,
/// takes a quarter of a second for a cycle of three.
const BRACKET_TIMEOUT_NANOS: i64 = 500_000_000;
/// Maximum time between a bracket and its base exposure, nanoseconds.
const MAX_BRACKET_SPAN_NANOS: i64 = 500_000_000;

/// Time stamps that go back by more than this start a new time line, nanoseconds.
const JUMP_BACK_NANOS: i64 = 500_000_000;

/// Collects pictures into views. A picture of the base exposure (0 EV) starts a view.
#[derive(Clone, Debug)]
pub(super) struct BracketCollector {
    /// Number of brackets of a complete view.
    brackets: usize,
    /// In order of capture; the newest may be incomplete.
    sets: VecDeque<Arc<EnvironmentSet>>,
    generation: u64,
    /// Number of brackets without a base exposure.
    pub orphans: u64,
    /// Number of views that were used or superseded before all their brackets arrived.
    pub incomplete: u64,
}

impl BracketCollector {
    pub fn new(brackets: usize) -> Self {
        Self {
            brackets,
            sets: VecDeque::with_capacity(MAX_VIEWS + 1),
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

    /// Adds a picture that was captured at `captured_at`.
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
        if self.sets.len() > MAX_VIEWS {
            self.sets.pop_front();
        }
    }

    /// Adds a bracket to the newest view, unless it is too far from it or the view has this exposure.
    fn join(&mut self, frame: Frame, captured_at: MonotonicTime) {
        let generation = self.generation;
        let newest = self.sets.iter_mut().find(|s| s.generation == generation);
        let open = newest.filter(|set| {
            let span = captured_at.nanos_since(set.captured_at);
            let has_exposure = set.frames.iter().any(|f| f.bracket_ev == frame.bracket_ev);
            span.abs() <= MAX_BRACKET_SPAN_NANOS && !has_exposure
        });
        // A view that was paired already is in use and never changed.
        match open.and_then(Arc::get_mut) {
            Some(set) => set.frames.push(frame),
            None => self.orphans += 1,
        }
    }

    /// Returns the newest view captured no later than `captured_at` that is complete, superseded or
    /// timed out at `now`.
    pub fn newest_until(
        &self,
        captured_at: MonotonicTime,
        now: MonotonicTime,
    ) -> Option<&Arc<EnvironmentSet>> {
        let is_final = |set: &&Arc<EnvironmentSet>| {
            set.frames.len() > self.brackets
                || set.generation < self.generation
                || now.nanos_since(set.arrived_at) >= BRACKET_TIMEOUT_NANOS
        };
        let until = |set: &&Arc<EnvironmentSet>| set.captured_at <= captured_at;
        self.sets.iter().rev().filter(until).find(is_final)
    }

    /// Returns the first view, for pictures captured before it; `None` once there are others.
    pub fn first(&self, now: MonotonicTime) -> Option<&Arc<EnvironmentSet>> {
        let first = self.sets.front().filter(|set| set.generation == 1)?;
        self.newest_until(first.captured_at, now)
    }
}
