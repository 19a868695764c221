//! Selects the light in which each frame is composed and schedules light estimates.
//!
//! Without a journal each frame of a recording waits for its own light. In a live rig only the
//! first frame waits: light is estimated on a low-priority thread, one frame at a time, and a
//! frame is composed in the newest light that is finished when its picture has been decoded. The
//! estimate depends on earlier frames, so the journal records which frames it used and when each
//! result became active. A replay repeats this: it estimates light from the same frames in the
//! same order and holds each result back until the frame that was first composed in it.

use crate::error::RigError;
use crate::journal::JournalEntry;
use crate::light::state::{ActiveLight, LightRequest, LightResult};
use crate::light::worker::{LightUpdater, LightWorker};
use penumbra_interface::MonotonicTime;
use penumbra_picture::Picture;
use penumbra_session::LightRecord;

/// Holds the active light and schedules the next estimates.
pub(crate) struct LightScheduler {
    mode: Mode,
    active: ActiveLight,
}

/// When a light estimate becomes active.
enum Mode {
    /// Each frame waits for its own light.
    PerFrame(Box<LightUpdater>),
    /// Live: as soon as it is finished.
    Live(LightWorker),
    /// Replay of a live rig: at the frame at which it became active live.
    FromJournal {
        updater: Box<LightUpdater>,
        /// A result that is not active yet.
        held: Option<LightResult>,
    },
}

impl LightScheduler {
    /// Creates a scheduler in which each frame waits for its own light.
    pub fn per_frame(updater: LightUpdater) -> Self {
        Self::new(Mode::PerFrame(Box::new(updater)))
    }

    /// Creates a scheduler for a replay: light becomes active as recorded in the live rig's
    /// journal. For entries without light, each frame is composed in the light of the frame before.
    pub fn from_journal(updater: LightUpdater) -> Self {
        Self::new(Mode::FromJournal {
            updater: Box::new(updater),
            held: None,
        })
    }

    /// Creates a scheduler for a live rig, with light estimates on their own thread.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn live(updater: LightUpdater) -> Result<Self, RigError> {
        Ok(Self::new(Mode::Live(LightWorker::start(updater)?)))
    }

    fn new(mode: Mode) -> Self {
        Self {
            mode,
            active: ActiveLight::default(),
        }
    }

    /// Schedules the light estimate of a decoded picture and returns the record for the journal of
    /// a live rig. Call [`Self::active_light`] afterwards.
    pub fn schedule(
        &mut self,
        request: &LightRequest,
        picture: &Picture,
        entry: JournalEntry,
    ) -> Option<LightRecord> {
        match &mut self.mode {
            Mode::PerFrame(updater) => {
                self.active.activate(updater.estimate(request, picture));
                None
            }
            Mode::Live(worker) => Some(worker.schedule(&mut self.active, request, picture)),
            Mode::FromJournal { updater, held } => {
                let estimate = || updater.estimate(request, picture);
                follow_journal(&mut self.active, held, request.arrived_at, entry, estimate);
                None
            }
        }
    }

    /// Returns the light in which the frame of the last [`Self::schedule`] is composed. Waits for
    /// the first estimate.
    pub fn active_light(&mut self) -> &mut ActiveLight {
        if let Mode::Live(worker) = &mut self.mode
            && self.active.is_missing()
        {
            worker.wait(&mut self.active);
        }
        &mut self.active
    }
}

/// Repeats what the live rig did with the frame that arrived at `arrived_at`.
fn follow_journal(
    active: &mut ActiveLight,
    held: &mut Option<LightResult>,
    arrived_at: MonotonicTime,
    entry: JournalEntry,
    estimate: impl FnOnce() -> LightResult,
) {
    let record = match entry {
        JournalEntry::Skipped => return,
        JournalEntry::Composed(record) => record,
        JournalEntry::None => None,
    };
    let is_due = |light: &LightResult| match record {
        Some(record) => record
            .lit_by
            .is_some_and(|by| light.picture_arrived_at <= by),
        None => light.picture_arrived_at < arrived_at,
    };
    if let Some(light) = held.take_if(|light| is_due(light)) {
        active.activate(light);
    }
    if record.is_none_or(|record| record.seen) {
        let light = estimate();
        if active.is_missing() || is_due(&light) {
            active.activate(light);
        } else {
            *held = Some(light);
        }
    }
}

#[cfg(test)]
mod tests;
