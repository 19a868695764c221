//! Measures the tracker's latency while the rig runs, on a thread of its own.
//!
//! A live rig's frames never wait for it: what it cannot take is dropped. Nobody waits for the
//! frames of a recording, so that it is told everything there; and where what it finds comes
//! into force, the recording's frames wait for it, so that the same recording gives the same
//! pictures.

mod shrink;

use super::source::Source;
use super::{RigError, RigSetup};
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::DQuat;
use penumbra_calibration::intrinsics::Grey;
use penumbra_calibration::latency::Mounted;
use penumbra_calibration::latency::follow::{Followed, Follower};
use penumbra_config::{Config, FollowLatency};
use penumbra_interface::threads;
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_picture::Picture;
use shrink::shrink;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// What may wait for the thread: the readings of some seconds.
const WAITING: usize = 2048;
/// Small pictures on their way.
const PICTURES: usize = 4;
/// Pictures without markers are looked at no more often, seconds.
const SPACING: f64 = 0.06;
/// What is known this well comes into force, 1σ in seconds.
const SURE: f64 = 2e-3;

/// The tracker's latency: what is in force, and what was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LatencyState {
    /// In force.
    pub in_force_nanos: i64,
    /// Measured; `None` where nobody does.
    pub followed: Option<Followed>,
}

/// What the thread is told.
enum Fact {
    Reading(MonotonicTime, RigidTransform),
    Pose(MonotonicTime, DQuat),
    Picture(MonotonicTime, Grey),
    /// Another loop begins.
    Restart,
    /// All has been told; an answer is waited for.
    Finish,
}

/// The way to whoever measures. Dropping it ends the thread.
pub(super) struct LatencyWatch {
    station: Option<u8>,
    apply: bool,
    way: Way,
    last_picture: Option<MonotonicTime>,
}

enum Way {
    Inline(Box<Watcher>),
    Beside(Beside),
}

struct Beside {
    facts: Option<Sender<Fact>>,
    spares: Receiver<Grey>,
    finished: Receiver<()>,
    known: Arc<Mutex<Followed>>,
    /// Everything is told, though the frames wait.
    lossless: bool,
    thread: Option<JoinHandle<()>>,
}

impl LatencyWatch {
    /// Of a rig with a tracker; `None` where nobody wants to know.
    ///
    /// # Errors
    /// No thread to be had.
    pub fn start(
        setup: &RigSetup,
        config: &Config,
        source: &Source,
        station: Option<u8>,
    ) -> Result<Option<Self>, RigError> {
        let wanted = config.sync.follow_latency;
        if setup.calibration.tracker.is_none() || wanted == FollowLatency::Off {
            return Ok(None);
        }
        let apply = wanted == FollowLatency::Apply;
        let watcher = Watcher::of(Mounted::scene_camera(&setup.calibration));
        let way = if apply && !source.is_live() {
            Way::Inline(Box::new(watcher))
        } else {
            Way::Beside(Beside::start(watcher, !source.is_live())?)
        };
        Ok(Some(Self {
            station,
            apply,
            way,
            last_picture: None,
        }))
    }

    /// A reading of the tracker arrived.
    pub fn reading(&mut self, sample: &PoseSample) {
        if self.station == Some(sample.station) {
            let pose = sample.transmitter_from_sensor;
            self.tell(Fact::Reading(sample.arrived_at, pose));
        }
    }

    /// A picture of the scene camera, and its pose by markers where it has one.
    pub fn look(
        &mut self,
        captured_at: MonotonicTime,
        picture: &Picture,
        by_markers: Option<RigidTransform>,
    ) {
        if let Some(pose) = by_markers {
            self.tell(Fact::Pose(captured_at, pose.rotation));
            return;
        }
        let last = self.last_picture;
        if last.is_some_and(|last| (0.0..SPACING).contains(&captured_at.seconds_since(last))) {
            return;
        }
        if let Some(mut small) = self.spare() {
            shrink(picture, &mut small);
            self.last_picture = Some(captured_at);
            self.tell(Fact::Picture(captured_at, small));
        }
    }

    /// What was measured so far.
    pub fn known(&self) -> Followed {
        match &self.way {
            Way::Inline(watcher) => watcher.follower.known(),
            Way::Beside(beside) => *beside.known.lock().unwrap_or_else(PoisonError::into_inner),
        }
    }

    /// The latency to come into force, nanoseconds, if it is sure and wished.
    pub fn wished_latency(&self) -> Option<i64> {
        let measured = self.known().measured.filter(|m| m.sigma < SURE);
        Some((measured.filter(|_| self.apply)?.seconds * 1e9) as i64)
    }

    /// Time begins anew.
    pub fn restart(&mut self) {
        self.last_picture = None;
        self.tell(Fact::Restart);
    }

    /// All has been told: what is known of it. A live rig does not wait.
    pub fn finish(&mut self) -> Followed {
        self.tell(Fact::Finish);
        if let Way::Beside(beside) = &self.way
            && beside.lossless
        {
            // Gone is finished, too.
            let _ = beside.finished.recv();
        }
        self.known()
    }

    fn tell(&mut self, fact: Fact) {
        match &mut self.way {
            Way::Inline(watcher) => {
                watcher.take(fact);
            }
            Way::Beside(beside) => beside.tell(fact),
        }
    }

    /// Memory for a small picture; none where so many are on their way that one is too many.
    fn spare(&mut self) -> Option<Grey> {
        match &mut self.way {
            Way::Inline(watcher) => Some(watcher.spare.take().unwrap_or_else(none)),
            Way::Beside(beside) if beside.lossless => {
                Some(beside.spares.try_recv().unwrap_or_else(|_| none()))
            }
            Way::Beside(beside) => beside.spares.try_recv().ok(),
        }
    }
}

impl Beside {
    fn start(mut watcher: Watcher, lossless: bool) -> Result<Self, RigError> {
        let (facts, told) = bounded::<Fact>(WAITING);
        let (spare, spares) = bounded(PICTURES);
        for _ in 0..PICTURES {
            let _ = spare.try_send(none());
        }
        let (done, finished) = bounded(1);
        let known = Arc::new(Mutex::new(Followed::default()));
        let shared = Arc::clone(&known);
        let job = move || {
            for fact in told {
                let finish = matches!(fact, Fact::Finish);
                if watcher.take(fact) {
                    *shared.lock().unwrap_or_else(PoisonError::into_inner) =
                        watcher.follower.known();
                }
                if let Some(small) = watcher.spare.take() {
                    let _ = spare.try_send(small);
                }
                if finish {
                    let _ = done.try_send(());
                }
            }
        };
        let thread = threads::spawn_background("latency", job);
        Ok(Self {
            facts: Some(facts),
            spares,
            finished,
            known,
            lossless,
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// A fact that a live rig's thread has no time for is lost: the next ones say as much.
    fn tell(&self, fact: Fact) {
        let Some(facts) = &self.facts else { return };
        if self.lossless {
            let _ = facts.send(fact);
        } else {
            let _ = facts.try_send(fact);
        }
    }
}

impl Drop for Beside {
    fn drop(&mut self) {
        self.facts = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Who measures.
#[derive(Default)]
struct Watcher {
    follower: Follower,
    /// A small picture that was looked at.
    spare: Option<Grey>,
}

impl Watcher {
    fn of(mounted: Option<Mounted>) -> Self {
        Self {
            follower: Follower::new(mounted),
            spare: None,
        }
    }

    /// Whether something else is known now.
    fn take(&mut self, fact: Fact) -> bool {
        match fact {
            Fact::Reading(at, pose) => self.follower.reading(at, pose),
            Fact::Pose(at, rotation) => self.follower.pose(at, rotation),
            Fact::Picture(at, small) => {
                self.follower.picture(at, &small);
                self.spare = Some(small);
            }
            Fact::Restart => self.follower.restart(),
            Fact::Finish => {
                self.follower.estimate();
                return true;
            }
        }
        let due = self.follower.due();
        if due {
            self.follower.estimate();
        }
        due
    }
}

const fn none() -> Grey {
    Grey {
        width: 0,
        height: 0,
        data: Vec::new(),
    }
}

#[cfg(test)]
mod tests;
