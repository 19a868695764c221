//! Measures the tracker's latency while the rig runs, on a thread of its own.
//!
//! A live rig's frames never wait for it: what it cannot take is dropped. Nobody waits for the
//! frames of a recording, so that it is received everything there; and where what it finds comes
//! into force, the recording's frames wait for it, so that the same recording gives the same
//! pictures.

mod shrink;

use crate::error::RigError;
use crate::setup::RigSetup;
use crate::source::Source;
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::DQuat;
use penumbra_calibration::intrinsics::Grey;
use penumbra_calibration::latency::MountedCamera;
use penumbra_calibration::latency::offset_monitor::{OffsetMonitor, OffsetState};
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
    pub followed: Option<OffsetState>,
}

/// What the thread is received.
enum Message {
    Reading(MonotonicTime, RigidTransform),
    Pose(MonotonicTime, DQuat),
    Picture(MonotonicTime, Grey),
    /// Another loop begins.
    Restart,
    /// All has been received; an answer is waited for.
    Finish,
}

/// The way to whoever measures. Dropping it ends the thread.
pub(super) struct LatencyMonitor {
    station: Option<u8>,
    apply: bool,
    mode: Mode,
    last_picture: Option<MonotonicTime>,
    /// The measured latency to be used, as of the last picture, nanoseconds.
    requested: Option<i64>,
}

enum Mode {
    SameThread(Box<Measurement>),
    MonitorThread(MonitorThread),
}

struct MonitorThread {
    messages: Option<Sender<Message>>,
    spares: Receiver<Grey>,
    finished: Receiver<()>,
    known: Arc<Mutex<OffsetState>>,
    /// Everything is received, though the frames wait.
    lossless: bool,
    thread: Option<JoinHandle<()>>,
}

impl LatencyMonitor {
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
        let measurement = Measurement::of(MountedCamera::scene_camera(&setup.calibration));
        let mode = if apply && !source.is_live() {
            Mode::SameThread(Box::new(measurement))
        } else {
            Mode::MonitorThread(MonitorThread::start(measurement, !source.is_live())?)
        };
        Ok(Some(Self {
            station,
            apply,
            mode,
            last_picture: None,
            requested: None,
        }))
    }

    /// A reading of the tracker arrived.
    pub fn reading(&mut self, sample: &PoseSample) {
        if self.station == Some(sample.station) {
            let pose = sample.transmitter_from_sensor;
            self.send(Message::Reading(sample.arrived_at, pose));
        }
    }

    /// A picture of the scene camera, and its pose by markers where it has one.
    pub fn picture(
        &mut self,
        captured_at: MonotonicTime,
        picture: &Picture,
        by_markers: Option<RigidTransform>,
    ) {
        self.send_picture(captured_at, picture, by_markers);
        self.requested = self.confident_latency().or(self.requested);
    }

    fn send_picture(
        &mut self,
        captured_at: MonotonicTime,
        picture: &Picture,
        by_markers: Option<RigidTransform>,
    ) {
        if let Some(pose) = by_markers {
            self.send(Message::Pose(captured_at, pose.rotation));
            return;
        }
        let last = self.last_picture;
        if last.is_some_and(|last| (0.0..SPACING).contains(&captured_at.seconds_since(last))) {
            return;
        }
        if let Some(mut small) = self.spare() {
            shrink(picture, &mut small);
            self.last_picture = Some(captured_at);
            self.send(Message::Picture(captured_at, small));
        }
    }

    /// What was measured so far.
    pub fn known(&self) -> OffsetState {
        match &self.mode {
            Mode::SameThread(measurement) => measurement.follower.state(),
            Mode::MonitorThread(worker) => {
                *worker.known.lock().unwrap_or_else(PoisonError::into_inner)
            }
        }
    }

    /// Returns the latency to use for pairing, nanoseconds; `None` while none is known well
    /// enough or where it is only to be reported.
    pub const fn requested_latency(&self) -> Option<i64> {
        self.requested
    }

    /// Returns the latency and what was measured of it. With `is_over`, waits for the estimate
    /// from all that was sent; a live rig does not wait.
    pub fn state(&mut self, active_nanos: i64, is_over: bool) -> LatencyState {
        let followed = if is_over { self.finish() } else { self.known() };
        LatencyState {
            in_force_nanos: active_nanos,
            followed: Some(followed),
        }
    }

    fn confident_latency(&self) -> Option<i64> {
        let measured = self.known().offset.filter(|m| m.sigma < SURE);
        Some((measured.filter(|_| self.apply)?.seconds * 1e9) as i64)
    }

    /// Time begins anew.
    pub fn restart(&mut self) {
        self.last_picture = None;
        self.requested = None;
        self.send(Message::Restart);
    }

    /// All has been received: what is known of it. A live rig does not wait.
    pub fn finish(&mut self) -> OffsetState {
        self.send(Message::Finish);
        if let Mode::MonitorThread(worker) = &self.mode
            && worker.lossless
        {
            // Gone is finished, too.
            let _ = worker.finished.recv();
        }
        self.known()
    }

    fn send(&mut self, message: Message) {
        match &mut self.mode {
            Mode::SameThread(measurement) => {
                measurement.take(message);
            }
            Mode::MonitorThread(worker) => worker.send(message),
        }
    }

    /// Memory for a small picture; none where so many are on their way that one is too many.
    fn spare(&mut self) -> Option<Grey> {
        match &mut self.mode {
            Mode::SameThread(measurement) => Some(measurement.spare.take().unwrap_or_else(none)),
            Mode::MonitorThread(worker) if worker.lossless => {
                Some(worker.spares.try_recv().unwrap_or_else(|_| none()))
            }
            Mode::MonitorThread(worker) => worker.spares.try_recv().ok(),
        }
    }
}

impl MonitorThread {
    fn start(mut measurement: Measurement, lossless: bool) -> Result<Self, RigError> {
        let (messages, received) = bounded::<Message>(WAITING);
        let (spare, spares) = bounded(PICTURES);
        for _ in 0..PICTURES {
            let _ = spare.try_send(none());
        }
        let (done, finished) = bounded(1);
        let known = Arc::new(Mutex::new(OffsetState::default()));
        let shared = Arc::clone(&known);
        let job = move || {
            for message in received {
                let finish = matches!(message, Message::Finish);
                if measurement.take(message) {
                    *shared.lock().unwrap_or_else(PoisonError::into_inner) =
                        measurement.follower.state();
                }
                if let Some(small) = measurement.spare.take() {
                    let _ = spare.try_send(small);
                }
                if finish {
                    let _ = done.try_send(());
                }
            }
        };
        let thread = threads::spawn_background("latency", job);
        Ok(Self {
            messages: Some(messages),
            spares,
            finished,
            known,
            lossless,
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// A message that a live rig's thread has no time for is lost: the next ones say as much.
    fn send(&self, message: Message) {
        let Some(messages) = &self.messages else {
            return;
        };
        if self.lossless {
            let _ = messages.send(message);
        } else {
            let _ = messages.try_send(message);
        }
    }
}

impl Drop for MonitorThread {
    fn drop(&mut self) {
        self.messages = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Who measures.
#[derive(Default)]
struct Measurement {
    follower: OffsetMonitor,
    /// A small picture that was looked at.
    spare: Option<Grey>,
}

impl Measurement {
    fn of(mounted: Option<MountedCamera>) -> Self {
        Self {
            follower: OffsetMonitor::new(mounted),
            spare: None,
        }
    }

    /// Whether something else is known now.
    fn take(&mut self, message: Message) -> bool {
        match message {
            Message::Reading(at, pose) => self.follower.add_reading(at, pose),
            Message::Pose(at, rotation) => self.follower.add_pose(at, rotation),
            Message::Picture(at, small) => {
                self.follower.add_picture(at, &small);
                self.spare = Some(small);
            }
            Message::Restart => self.follower.restart(),
            Message::Finish => {
                self.follower.estimate();
                return true;
            }
        }
        let due = self.follower.is_due();
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
