//! Which exposure a frame has, when exposures change all the time.
//!
//! ┌ A value that is set after frame s was received applies from frame s + 1 + lag on. ┐
//! │ The `guard` frames from there on may have either; they are attributed to none.    │
//! │ Frames are counted by the camera's own counter, so that lost ones shift nothing.  │
//! └ Each value is kept for `hold` > guard frames.                                     ┘

use std::collections::VecDeque;

/// How a camera follows its exposure control.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Timing {
    /// Frames that still come with the old exposure.
    pub lag: u64,
    /// Frames after those whose exposure is not certain.
    pub guard: u64,
}

/// A cycle of exposures, by their place in the settings' list.
#[derive(Clone, Debug)]
pub(crate) struct Cycle {
    /// Whether each step has had a certain frame since it was last set.
    seen: Vec<bool>,
    hold: u64,
    timing: Timing,
    /// From which frame on which step applies: the one in force, then those to come.
    changes: VecDeque<(u64, usize)>,
    /// After which frame the next value is to be set.
    due_after: u64,
    current: usize,
}

impl Cycle {
    /// A cycle of `steps` exposures of which `first` is in force since long before frame
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
    pub(crate) fn attribute(&mut self, sequence: u64) -> Option<usize> {
        while self
            .changes
            .get(1)
            .is_some_and(|(from, _)| *from <= sequence)
        {
            self.changes.pop_front();
        }
        let (from, step) = *self.changes.front()?;
        let certain = from == 0 || sequence >= from + self.timing.guard;
        self.seen[step] |= certain;
        certain.then_some(step)
    }

    /// The step to be set now that frame `sequence` was received, if one is due.
    pub(crate) fn due(&self, sequence: u64) -> Option<usize> {
        let is_due = self.seen.len() > 1 && sequence >= self.due_after;
        is_due.then_some((self.current + 1) % self.seen.len())
    }

    /// The step was set after frame `sequence` was received.
    pub(crate) fn was_set(&mut self, sequence: u64, step: usize) {
        self.current = step;
        // A step that had none last time is kept longer: frames that are lost in the rhythm of
        // the cycle would take the same step every time.
        let more = u64::from(!std::mem::replace(&mut self.seen[step], false));
        self.due_after = sequence + self.hold + more;
        self.changes
            .push_back((sequence + 1 + self.timing.lag, step));
    }
}
