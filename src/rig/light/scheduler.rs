//! Selects the light in which each frame is composed and schedules light estimates.
//!
//! Without a journal each frame of a recording waits for the light of its instant, between the
//! environment pictures before and after it; where the recording is watched at its own rate, light is
//! estimated on a low-priority thread as in a live rig, and frames wait for a limited time. In a live
//! rig only the first frame waits: the light of the frames goes to the newest estimate that is
//! finished when their pictures have been decoded. The
//! estimate depends on earlier frames, so the journal records which frames it used and when each
//! result became active. A replay repeats this: it estimates light from the same frames in the
//! same order and holds each result back until the frame that was first composed in it.

use crate::error::RigError;
use crate::journal::JournalEntry;
use crate::light::state::{ActiveLight, LightRequest, LightResult, LightState, Lights};
use crate::light::worker::{LightUpdater, LightWorker};
use penumbra_interface::MonotonicTime;
use penumbra_picture::Picture;
use penumbra_session::LightRecord;

/// Holds the active light and schedules the next estimates.
pub(crate) struct LightScheduler {
    mode: Mode,
    active: ActiveLight,
    /// The instant of the last picture that was to be shown.
    shown: Option<MonotonicTime>,
}

/// When a light estimate becomes active.
enum Mode {
    /// Each frame waits for the light of its instant.
    PerFrame(Box<LightUpdater>),
    /// Live: as soon as it is finished.
    Live(LightWorker),
    /// A recording at its own rate, ahead of what is shown.
    Ahead(LightWorker),
    /// Replay of a live rig: at the frame at which it became active live.
    FromJournal {
        updater: Box<LightUpdater>,
        /// A result that is not active yet.
        held: Option<LightResult>,
    },
}

impl LightScheduler {
    /// Creates a scheduler in which each frame waits for the light of its instant.
    pub fn per_frame(updater: LightUpdater) -> Self {
        Self {
            mode: Mode::PerFrame(Box::new(updater)),
            active: ActiveLight::exact(),
            shown: None,
        }
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

    /// Creates a scheduler for a recording that is watched at its own rate, with light estimates on
    /// their own thread.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn watched(updater: LightUpdater) -> Result<Self, RigError> {
        Ok(Self {
            mode: Mode::Ahead(LightWorker::start(updater)?),
            active: ActiveLight::exact(),
            shown: None,
        })
    }

    fn new(mode: Mode) -> Self {
        Self {
            mode,
            active: ActiveLight::default(),
            shown: None,
        }
    }

    /// Schedules the light estimate of a decoded picture and returns the record for the journal of
    /// a live rig. Call [`Self::active_light`] and [`Self::light_at`] afterwards.
    pub fn schedule(
        &mut self,
        request: &LightRequest,
        picture: &Picture,
        entry: JournalEntry,
    ) -> Option<LightRecord> {
        match &mut self.mode {
            Mode::PerFrame(updater) => {
                let result = updater.estimate(request, picture);
                self.active.activate(result, request.captured_at);
                None
            }
            Mode::Live(worker) => Some(worker.schedule(&mut self.active, request, picture)),
            Mode::Ahead(worker) => {
                worker.schedule_ahead(&mut self.active, request, picture, self.shown);
                None
            }
            Mode::FromJournal { updater, held } => {
                let estimate = || updater.estimate(request, picture);
                let at = [request.arrived_at, request.captured_at];
                follow_journal(&mut self.active, held, at, entry, estimate);
                None
            }
        }
    }

    /// Returns the active light after the last [`Self::schedule`]. Waits for the first estimate.
    pub fn active_light(&mut self) -> &mut ActiveLight {
        if self.active.is_missing() {
            self.wait();
        }
        &mut self.active
    }

    /// Number of environment pictures without an estimate of their own, because the thread was busy
    /// until a newer one was there.
    pub const fn left_out(&self) -> u64 {
        match &self.mode {
            Mode::Live(worker) | Mode::Ahead(worker) => worker.left_out,
            Mode::PerFrame(_) | Mode::FromJournal { .. } => 0,
        }
    }

    /// Takes finished light estimates of a recording that is watched.
    pub fn poll(&mut self) {
        if let Mode::Ahead(worker) = &mut self.mode {
            worker.poll(&mut self.active, self.shown);
        }
    }

    /// Waits for the light estimate in progress; false if there is none.
    pub fn wait(&mut self) -> bool {
        match &mut self.mode {
            Mode::Live(worker) | Mode::Ahead(worker) => worker.wait(&mut self.active),
            Mode::PerFrame(_) | Mode::FromJournal { .. } => false,
        }
    }

    /// Returns whether the light of the picture captured at `at` is known. If not, later pictures
    /// must be scheduled first.
    pub fn is_settled(&self, at: MonotonicTime) -> bool {
        self.active.lights.is_settled(at)
    }

    /// Notes that the picture captured at `at` is the next to be shown.
    pub const fn show(&mut self, at: MonotonicTime) {
        self.shown = Some(at);
    }

    /// Returns the light of the picture captured at `at`.
    pub fn light_at(&mut self, at: MonotonicTime) -> LightState {
        self.active.at(at)
    }

    /// Returns the light at an instant after that of the last [`Self::light_at`], as far as it is
    /// known.
    pub fn coming_light(&mut self, at: MonotonicTime) -> LightState {
        self.active.coming(at)
    }

    /// Forgets the lights of a recording that starts again.
    pub fn restart(&mut self) {
        if matches!(self.active.lights, Lights::Delayed(_)) {
            return;
        }
        match &mut self.mode {
            Mode::PerFrame(updater) => updater.restart(),
            Mode::Ahead(worker) => worker.restart(),
            Mode::Live(_) | Mode::FromJournal { .. } => (),
        }
        self.shown = None;
        self.active.lights = ActiveLight::exact().lights;
    }
}

/// Repeats what the live rig did with the frame that arrived at `arrived_at` and was captured at
/// `captured_at`.
fn follow_journal(
    active: &mut ActiveLight,
    held: &mut Option<LightResult>,
    [arrived_at, captured_at]: [MonotonicTime; 2],
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
        active.activate(light, captured_at);
    }
    if record.is_none_or(|record| record.seen) {
        let light = estimate();
        if active.is_missing() || is_due(&light) {
            active.activate(light, captured_at);
        } else {
            *held = Some(light);
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
