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
    way: Mode,
    force: ActiveLight,
}

/// When a light estimate becomes active.
enum Mode {
    /// Each frame waits for its own light.
    Own(Box<LightUpdater>),
    /// Live: as soon as it is finished.
    LightWorker(LightWorker),
    /// Replay of a live rig: at the frame at which it became active live.
    AsNoted {
        lighter: Box<LightUpdater>,
        held: Option<LightResult>,
    },
}

impl LightScheduler {
    /// Creates a scheduler in which each frame waits for its own light.
    pub fn own(lighter: LightUpdater) -> Self {
        Self::by(Mode::Own(Box::new(lighter)))
    }

    /// Creates a scheduler for a replay: light becomes active as recorded in the live rig's
    /// journal. Without light notes each frame is composed in the light of the frame before.
    pub fn as_noted(lighter: LightUpdater) -> Self {
        Self::by(Mode::AsNoted {
            lighter: Box::new(lighter),
            held: None,
        })
    }

    /// Creates a scheduler for a live rig, with light estimates on their own thread.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn beside(lighter: LightUpdater) -> Result<Self, RigError> {
        Ok(Self::by(Mode::LightWorker(LightWorker::start(lighter)?)))
    }

    fn by(way: Mode) -> Self {
        Self {
            way,
            force: ActiveLight::default(),
        }
    }

    /// Schedules the light estimate of a decoded picture and returns the note for the journal of a
    /// live rig. Call [`Self::in_force`] afterwards.
    pub fn see(
        &mut self,
        seen: &LightRequest,
        picture: &Picture,
        noted: JournalEntry,
    ) -> Option<LightRecord> {
        match &mut self.way {
            Mode::Own(lighter) => {
                self.force.enter(lighter.work_out(seen, picture));
                None
            }
            Mode::LightWorker(beside) => Some(beside.see(&mut self.force, seen, picture)),
            Mode::AsNoted { lighter, held } => {
                let work_out = || lighter.work_out(seen, picture);
                see_as_noted(&mut self.force, held, seen.arrived_at, noted, work_out);
                None
            }
        }
    }

    /// Returns the light in which the frame of the last [`Self::see`] is composed. Waits for the
    /// first estimate.
    pub fn in_force(&mut self) -> &mut ActiveLight {
        if let Mode::LightWorker(beside) = &mut self.way
            && self.force.is_dark()
        {
            beside.wait(&mut self.force);
        }
        &mut self.force
    }
}

/// Repeats what the live rig did with the frame that arrived at `arrived_at`.
fn see_as_noted(
    force: &mut ActiveLight,
    held: &mut Option<LightResult>,
    arrived_at: MonotonicTime,
    noted: JournalEntry,
    work_out: impl FnOnce() -> LightResult,
) {
    let note = match noted {
        JournalEntry::Skipped => return,
        JournalEntry::Composed(note) => note,
        JournalEntry::None => None,
    };
    let due = |of: MonotonicTime| match note {
        Some(note) => note.lit_by.is_some_and(|by| of <= by),
        None => of < arrived_at,
    };
    if let Some(light) = held.take_if(|light| due(light.of)) {
        force.enter(light);
    }
    if note.is_none_or(|note| note.seen) {
        let light = work_out();
        if force.is_dark() || due(light.of) {
            force.enter(light);
        } else {
            *held = Some(light);
        }
    }
}

#[cfg(test)]
mod tests;
