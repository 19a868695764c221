//! Attributes an exposure to every frame while the exposure changes all the time.
//!
//! ┌ A value that is set after frame s was received takes effect with frame s + 1 + lag.  ┐
//! │ The first `guard` frames from there on may still have the old value and are not      │
//! │ attributed. Frames are counted by the camera, so lost frames shift nothing. Each     │
//! └ value is held for more than `guard` frames.                                          ┘

use std::collections::VecDeque;

/// How a camera follows its exposure control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Timing {
    /// Frames that still have the old exposure after a new one was set.
    pub lag: u64,
    /// Frames after those that may have either exposure.
    pub guard: u64,
}

/// A cycle of exposures, which are given by their indices.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    /// For each step, whether a frame was attributed to it since it was last set.
    seen: Vec<bool>,
    hold: u64,
    timing: Timing,
    /// From which frame on which step is in effect: the present one, then those to come.
    changes: VecDeque<(u64, usize)>,
    /// The frame after which the next step is to be set.
    due_after: u64,
    current: usize,
}

impl Cycle {
    /// A cycle of `steps` exposures. `first` has been in effect since long before frame
    /// `sequence`.
    pub(crate) fn new(
        steps: usize,
        hold: u64,
        timing: Timing,
        (first, sequence): (usize, u64),
    ) -> Self {
        let hold = hold.max(timing.guard + 1);
        Self {
            seen: vec![true; steps],
            hold,
            timing,
            changes: VecDeque::from([(0, first)]),
            due_after: sequence + hold,
            current: first,
        }
    }

    /// The step that frame `sequence` was exposed with; `None` if that is not certain.
    pub(crate) fn step_of(&mut self, sequence: u64) -> Option<usize> {
        let next_from = |changes: &VecDeque<(u64, usize)>| Some(changes.get(1)?.0);
        while next_from(&self.changes).is_some_and(|from| from <= sequence) {
            self.changes.pop_front();
        }
        let (from, step) = *self.changes.front()?;
        let is_certain = from == 0 || sequence >= from + self.timing.guard;
        self.seen[step] |= is_certain;
        is_certain.then_some(step)
    }

    /// The step to set now that frame `sequence` was received, if it is time for one.
    pub(crate) fn next_step(&self, sequence: u64) -> Option<usize> {
        let is_due = self.seen.len() > 1 && sequence >= self.due_after;
        is_due.then_some((self.current + 1) % self.seen.len())
    }

    /// The step was set after frame `sequence` was received.
    pub(crate) fn on_set(&mut self, sequence: u64, step: usize) {
        self.current = step;
        // A step without a frame in the last round is held longer. Otherwise frames that are
        // lost in the rhythm of the cycle would deprive the same step every time.
        let was_seen = std::mem::replace(&mut self.seen[step], false);
        self.due_after = sequence + self.hold + u64::from(!was_seen);
        self.changes
            .push_back((sequence + 1 + self.timing.lag, step));
    }
}
