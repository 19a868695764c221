//! Measures the tracker's latency while the rig runs, on its own thread.
//!
//! Frames of a live rig never wait for it: messages that it cannot accept are dropped. Frames of a
//! recording may wait, so the measurement receives all of them. If the measured latency is applied,
//! frames of a recording also wait for the estimate (it runs on their thread), so that the same
//! recording gives the same pictures.

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

/// Capacity of the message queue: the readings of some seconds.
const QUEUE_CAPACITY: usize = 2048;
/// Number of recycled buffers for small pictures.
const BUFFERS: usize = 4;
/// Minimum time between analysed pictures without markers, seconds.
const MIN_INTERVAL_SECONDS: f64 = 0.06;
/// Maximum standard deviation of a latency that is applied, seconds.
const MAX_SIGMA_SECONDS: f64 = 2e-3;

/// The tracker's latency, active and measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LatencyState {
    /// Active latency, nanoseconds.
    pub active_nanos: i64,
    /// State of the measurement; `None` if the latency is not measured.
    pub measurement: Option<OffsetState>,
}

/// A message to the measurement.
enum Message {
    Reading(MonotonicTime, RigidTransform),
    Pose(MonotonicTime, DQuat),
    Picture(MonotonicTime, Grey),
    /// Another loop of the recording starts.
    Restart,
    /// All data have been sent; the sender waits for an answer.
    Finish,
}

/// Sends data to the measurement. Dropping it ends the thread.
pub(super) struct LatencyMonitor {
    station: Option<u8>,
    apply: bool,
    mode: Mode,
    last_picture: Option<MonotonicTime>,
    /// The measured latency to apply, as of the last picture, nanoseconds.
    requested: Option<i64>,
}

enum Mode {
    SameThread(Box<Measurement>),
    MonitorThread(MonitorThread),
}

struct MonitorThread {
    messages: Option<Sender<Message>>,
    buffers: Receiver<Grey>,
    finished: Receiver<()>,
    known: Arc<Mutex<OffsetState>>,
    /// Whether frames wait instead of dropping messages.
    lossless: bool,
    thread: Option<JoinHandle<()>>,
}

impl LatencyMonitor {
    /// Starts the measurement; `None` without a tracker or with `follow_latency` off.
    ///
    /// # Errors
    /// The system cannot start a thread.
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
        let measurement = Measurement::new(MountedCamera::scene_camera(&setup.calibration));
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

    /// Adds a reading of the tracker.
    pub fn reading(&mut self, sample: &PoseSample) {
        if self.station == Some(sample.station) {
            let pose = sample.transmitter_from_sensor;
            self.send(Message::Reading(sample.arrived_at, pose));
        }
    }

    /// Adds a picture of the scene camera, with its pose by markers if it has one.
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
        if last.is_some_and(|last| {
            (0.0..MIN_INTERVAL_SECONDS).contains(&captured_at.seconds_since(last))
        }) {
            return;
        }
        if let Some(mut small) = self.buffer() {
            shrink(picture, &mut small);
            self.last_picture = Some(captured_at);
            self.send(Message::Picture(captured_at, small));
        }
    }

    /// Returns the current estimate.
    pub fn known(&self) -> OffsetState {
        match &self.mode {
            Mode::SameThread(measurement) => measurement.monitor.state(),
            Mode::MonitorThread(worker) => {
                *worker.known.lock().unwrap_or_else(PoisonError::into_inner)
            }
        }
    }

    /// Returns the latency to use for pairing, nanoseconds; `None` before the first sufficiently
    /// precise estimate, or if the latency is only reported.
    pub const fn requested_latency(&self) -> Option<i64> {
        self.requested
    }

    /// Returns the active and the measured latency. With `is_over`, waits for the estimate from all
    /// data sent; a live rig does not wait.
    pub fn state(&mut self, active_nanos: i64, is_over: bool) -> LatencyState {
        let measurement = if is_over { self.finish() } else { self.known() };
        LatencyState {
            active_nanos,
            measurement: Some(measurement),
        }
    }

    fn confident_latency(&self) -> Option<i64> {
        let measured = self.known().offset.filter(|m| m.sigma < MAX_SIGMA_SECONDS);
        Some((measured.filter(|_| self.apply)?.seconds * 1e9) as i64)
    }

    /// Resets the measurement, because the recording's time starts again.
    pub fn restart(&mut self) {
        self.last_picture = None;
        self.requested = None;
        self.send(Message::Restart);
    }

    /// Returns the estimate from all data sent. A live rig does not wait for it.
    pub fn finish(&mut self) -> OffsetState {
        self.send(Message::Finish);
        if let Mode::MonitorThread(worker) = &self.mode
            && worker.lossless
        {
            // The channel is closed if the thread has ended; there is nothing to wait for then.
            let _ = worker.finished.recv();
        }
        self.known()
    }

    fn send(&mut self, message: Message) {
        match &mut self.mode {
            Mode::SameThread(measurement) => {
                measurement.process(message);
            }
            Mode::MonitorThread(worker) => worker.send(message),
        }
    }

    /// Returns a buffer for a small picture; `None` on a live rig while all buffers are in use.
    fn buffer(&mut self) -> Option<Grey> {
        match &mut self.mode {
            Mode::SameThread(measurement) => {
                Some(measurement.recycled.take().unwrap_or_else(empty_grey))
            }
            Mode::MonitorThread(worker) if worker.lossless => {
                Some(worker.buffers.try_recv().unwrap_or_else(|_| empty_grey()))
            }
            Mode::MonitorThread(worker) => worker.buffers.try_recv().ok(),
        }
    }
}

impl MonitorThread {
    fn start(mut measurement: Measurement, lossless: bool) -> Result<Self, RigError> {
        let (messages, received) = bounded::<Message>(QUEUE_CAPACITY);
        let (recycle, buffers) = bounded(BUFFERS);
        for _ in 0..BUFFERS {
            let _ = recycle.try_send(empty_grey());
        }
        let (done, finished) = bounded(1);
        let known = Arc::new(Mutex::new(OffsetState::default()));
        let shared = Arc::clone(&known);
        let job = move || {
            for message in received {
                let finish = matches!(message, Message::Finish);
                if measurement.process(message) {
                    *shared.lock().unwrap_or_else(PoisonError::into_inner) =
                        measurement.monitor.state();
                }
                if let Some(small) = measurement.recycled.take() {
                    let _ = recycle.try_send(small);
                }
                if finish {
                    let _ = done.try_send(());
                }
            }
        };
        let thread = threads::spawn_background("latency", job);
        Ok(Self {
            messages: Some(messages),
            buffers,
            finished,
            known,
            lossless,
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// Sends a message. A live rig drops it if the queue is full.
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

/// The measurement.
#[derive(Default)]
struct Measurement {
    monitor: OffsetMonitor,
    /// The buffer of an analysed picture, to be recycled.
    recycled: Option<Grey>,
}

impl Measurement {
    fn new(mounted: Option<MountedCamera>) -> Self {
        Self {
            monitor: OffsetMonitor::new(mounted),
            recycled: None,
        }
    }

    /// Processes a message. Returns whether the estimate was updated.
    fn process(&mut self, message: Message) -> bool {
        match message {
            Message::Reading(at, pose) => self.monitor.add_reading(at, pose),
            Message::Pose(at, rotation) => self.monitor.add_pose(at, rotation),
            Message::Picture(at, small) => {
                self.monitor.add_picture(at, &small);
                self.recycled = Some(small);
            }
            Message::Restart => self.monitor.restart(),
            Message::Finish => {
                self.monitor.estimate();
                return true;
            }
        }
        let due = self.monitor.is_due();
        if due {
            self.monitor.estimate();
        }
        due
    }
}

const fn empty_grey() -> Grey {
    Grey {
        width: 0,
        height: 0,
        data: Vec::new(),
    }
}

#[cfg(test)]
mod tests;
