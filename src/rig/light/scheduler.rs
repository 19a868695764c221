//! Which light a picture is drawn in, and where its own is worked out.
//!
//! A recording that no rig has composed has time: each picture waits for its own light. In a
//! live rig nothing waits but the very first: light is worked out on a thread of its own at
//! low priority, one picture at a time, and a picture is drawn in the newest light
//! that is finished when it is decoded. The light has a memory, so the journal says which
//! pictures it saw and when its findings came into force, and a replay does it again: the
//! same pictures in the same order, each light held back until the picture that was first
//! drawn in it.

use crate::error::RigError;
use crate::journal::JournalEntry;
use crate::light::state::{ActiveLight, LightRequest, LightResult};
use crate::light::worker::{LightUpdater, LightWorker};
use penumbra_interface::MonotonicTime;
use penumbra_picture::Picture;
use penumbra_session::LightRecord;

/// The light in force, and the way to the next.
pub(crate) struct LightScheduler {
    way: Mode,
    force: ActiveLight,
}

/// When light comes into force.
enum Mode {
    /// Each picture waits for its own.
    Own(Box<LightUpdater>),
    /// Live: when it is finished.
    LightWorker(LightWorker),
    /// A replay of a live rig: when it did live.
    AsNoted {
        lighter: Box<LightUpdater>,
        held: Option<LightResult>,
    },
}

impl LightScheduler {
    /// Each picture waits for its own light.
    pub fn own(lighter: LightUpdater) -> Self {
        Self::by(Mode::Own(Box::new(lighter)))
    }

    /// Light comes into force as a live rig's journal says, if there is one; else each
    /// picture is drawn in the light of the one before.
    pub fn as_noted(lighter: LightUpdater) -> Self {
        Self::by(Mode::AsNoted {
            lighter: Box::new(lighter),
            held: None,
        })
    }

    /// On a thread of its own.
    ///
    /// # Errors
    /// No thread to be had.
    pub fn beside(lighter: LightUpdater) -> Result<Self, RigError> {
        Ok(Self::by(Mode::LightWorker(LightWorker::start(lighter)?)))
    }

    fn by(way: Mode) -> Self {
        Self {
            way,
            force: ActiveLight::default(),
        }
    }

    /// Sees to the light of a decoded picture. What is to be noted of it, where somebody may
    /// replay it; then comes [`Self::in_force`].
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

    /// The light that the picture which was seen last is drawn in. Waits for the first.
    pub fn in_force(&mut self) -> &mut ActiveLight {
        if let Mode::LightWorker(beside) = &mut self.way
            && self.force.is_dark()
        {
            beside.wait(&mut self.force);
        }
        &mut self.force
    }
}

/// What the live rig did with the picture of this arrival.
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
