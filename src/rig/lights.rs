//! Which light a picture is drawn in, and where its own is worked out.
//!
//! A recording that no rig has composed has time: each picture waits for its own light. In a
//! live rig nothing waits but the very first: light is worked out on a thread of its own at
//! low priority, one picture at a time, and a picture is drawn in the newest light
//! that is finished when it is decoded. The light has a memory, so the journal says which
//! pictures it saw and when its findings came into force, and a replay does it again: the
//! same pictures in the same order, each light held back until the picture that was first
//! drawn in it.

use super::RigError;
use super::feed::Noted;
use super::lighter::{Lighter, Seen, WorkedOut};
use super::prepare::LightState;
use crossbeam_channel::{Receiver, Sender, bounded};
use penumbra_interface::MonotonicTime;
use penumbra_interface::threads;
use penumbra_picture::Picture;
use penumbra_session::LightNote;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// The light in force, and the way to the next.
pub(super) struct Lights {
    way: Way,
    force: Force,
}

/// When light comes into force.
enum Way {
    /// Each picture waits for its own.
    Own(Box<Lighter>),
    /// Live: when it is finished.
    Beside(Beside),
    /// A replay of a live rig: when it did live.
    AsNoted {
        lighter: Box<Lighter>,
        held: Option<WorkedOut>,
    },
}

/// The light in force.
#[derive(Default)]
pub(super) struct Force {
    /// It.
    pub state: LightState,
    /// Arrival of the picture that it is of.
    of: Option<MonotonicTime>,
    /// How long it took.
    pub took: Duration,
    /// What was wrong with its environment picture, to be told once.
    pub unseen: Option<String>,
    /// A new preview of the environment, to be shown once.
    pub preview: Option<Arc<Picture>>,
}

impl Force {
    fn enter(&mut self, worked_out: WorkedOut) {
        self.of = Some(worked_out.of);
        self.took = worked_out.took;
        if let Some(state) = worked_out.state {
            self.state = state;
        }
        self.unseen = worked_out.unseen.or(self.unseen.take());
        self.preview = worked_out.preview.or(self.preview.take());
    }

    /// Without any light there is nothing to show meanwhile.
    const fn is_dark(&self) -> bool {
        self.state.lighting.is_none()
    }
}

impl Lights {
    /// Each picture waits for its own light.
    pub fn own(lighter: Lighter) -> Self {
        Self::by(Way::Own(Box::new(lighter)))
    }

    /// Light comes into force as a live rig's journal says, if there is one; else each
    /// picture is drawn in the light of the one before.
    pub fn as_noted(lighter: Lighter) -> Self {
        Self::by(Way::AsNoted {
            lighter: Box::new(lighter),
            held: None,
        })
    }

    /// On a thread of its own.
    ///
    /// # Errors
    /// No thread to be had.
    pub fn beside(lighter: Lighter) -> Result<Self, RigError> {
        Ok(Self::by(Way::Beside(Beside::start(lighter)?)))
    }

    fn by(way: Way) -> Self {
        Self {
            way,
            force: Force::default(),
        }
    }

    /// Sees to the light of a decoded picture. What is to be noted of it, where somebody may
    /// replay it; then comes [`Self::in_force`].
    pub fn see(&mut self, seen: &Seen, picture: &Picture, noted: Noted) -> Option<LightNote> {
        match &mut self.way {
            Way::Own(lighter) => {
                self.force.enter(lighter.work_out(seen, picture));
                None
            }
            Way::Beside(beside) => Some(beside.see(&mut self.force, seen, picture)),
            Way::AsNoted { lighter, held } => {
                let work_out = || lighter.work_out(seen, picture);
                see_as_noted(&mut self.force, held, seen.arrived_at, noted, work_out);
                None
            }
        }
    }

    /// The light that the picture which was seen last is drawn in. Waits for the first.
    pub fn in_force(&mut self) -> &mut Force {
        if let Way::Beside(beside) = &mut self.way
            && self.force.is_dark()
        {
            beside.wait(&mut self.force);
        }
        &mut self.force
    }
}

/// What the live rig did with the picture of this arrival.
fn see_as_noted(
    force: &mut Force,
    held: &mut Option<WorkedOut>,
    arrived_at: MonotonicTime,
    noted: Noted,
    work_out: impl FnOnce() -> WorkedOut,
) {
    let note = match noted {
        Noted::PassedOver => return,
        Noted::Composed(note) => note,
        Noted::Nothing => None,
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

/// A picture on its way to the light and back: its memory is used again.
struct Errand {
    seen: Seen,
    picture: Picture,
}

/// The thread that works out light, and the way to it. Dropping it ends the thread.
struct Beside {
    errands: Option<Sender<Errand>>,
    finished: Receiver<(WorkedOut, Errand)>,
    /// The thread has nothing to do.
    idle: bool,
    spare: Picture,
    thread: Option<JoinHandle<()>>,
}

impl Beside {
    fn start(mut lighter: Lighter) -> Result<Self, RigError> {
        let (errands, waiting) = bounded::<Errand>(1);
        let (done, finished) = bounded(1);
        let job = move || {
            for errand in waiting {
                let light = lighter.work_out(&errand.seen, &errand.picture);
                if done.send((light, errand)).is_err() {
                    return;
                }
            }
        };
        let thread = threads::spawn_background("light", job);
        Ok(Self {
            errands: Some(errands),
            finished,
            idle: true,
            spare: Picture::default(),
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// Puts into force what is finished, and hands over this picture if nothing is under
    /// way.
    fn see(&mut self, force: &mut Force, seen: &Seen, picture: &Picture) -> LightNote {
        if let Ok(finished) = self.finished.try_recv() {
            self.take(force, finished);
        }
        let sees = self.idle && self.hand_over(seen, picture);
        // The first light is waited for.
        let lit_by = if sees && force.is_dark() {
            Some(seen.arrived_at)
        } else {
            force.of
        };
        LightNote { seen: sees, lit_by }
    }

    fn hand_over(&mut self, seen: &Seen, picture: &Picture) -> bool {
        let mut copy = std::mem::take(&mut self.spare);
        copy.copy_from(picture);
        let errand = Errand {
            seen: seen.clone(),
            picture: copy,
        };
        let errands = self.errands.as_ref();
        let sent = errands.is_some_and(|errands| errands.send(errand).is_ok());
        self.idle = !sent;
        sent
    }

    fn take(&mut self, force: &mut Force, (light, errand): (WorkedOut, Errand)) {
        force.enter(light);
        self.spare = errand.picture;
        self.idle = true;
    }

    fn wait(&mut self, force: &mut Force) {
        if !self.idle
            && let Ok(finished) = self.finished.recv()
        {
            self.take(force, finished);
        }
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.errands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests;
