//! Devices that deliver a recording forwards and backwards in turns, so that nothing jumps and
//! nothing pauses where it repeats: what a rig reports is then due to the injected faults.

use penumbra_interface::{
    Camera, CameraReport, Clock, DeviceError, Frame, MonotonicTime, StampSource, SystemClock,
    Tracker, TrackerBytes, TrackerReport,
};
use penumbra_session::{Session, SessionEvent};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Pictures of the scene camera per second.
const SCENE_RATE: i64 = 30;
/// Views of the environment per second; each has all exposures of the recording.
const ENVIRONMENT_RATE: i64 = 5;
/// Records of the tracker per second.
const TRACKER_RATE: i64 = 120;
const SECOND: i64 = 1_000_000_000;

/// A recording in memory.
pub struct Recording {
    /// Arrival after the first picture, nanoseconds, and the picture.
    scene: Vec<(i64, Frame)>,
    /// The exposures of a view.
    environment: Vec<(i64, Vec<Frame>)>,
    tracker: Vec<(i64, TrackerBytes)>,
    protocol: String,
    /// When it starts to be delivered.
    begun: MonotonicTime,
}

impl Recording {
    pub fn read(path: &Path) -> Self {
        let session = Session::open(path).unwrap();
        let mut recording = Self {
            scene: Vec::new(),
            environment: Vec::new(),
            tracker: Vec::new(),
            protocol: session.tracker_protocol().unwrap().to_owned(),
            begun: SystemClock.now(),
        };
        let mut first = None;
        for event in session.events().map(Result::unwrap) {
            let at = event.arrived_at();
            let at = at.nanos_since(*first.get_or_insert(at));
            match event {
                SessionEvent::Scene(frame) => recording.scene.push((at, frame)),
                SessionEvent::Environment(frame) if frame.bracket_ev == 0.0 => {
                    recording.environment.push((at, vec![frame]));
                }
                SessionEvent::Environment(frame) => {
                    recording.environment.last_mut().unwrap().1.push(frame);
                }
                SessionEvent::TrackerBytes {
                    bytes, arrived_at, ..
                } => recording
                    .tracker
                    .push((at, TrackerBytes { bytes, arrived_at })),
                _ => (),
            }
        }
        recording
    }

    /// The time in the recording that is delivered at `now`: it runs forwards, then backwards.
    fn position(&self, now: MonotonicTime) -> i64 {
        let length = self.scene.last().unwrap().0;
        let passed = now.nanos_since(self.begun).rem_euclid(2 * length);
        passed.min(2 * length - passed)
    }
}

/// The item nearest to a time.
fn nearest<T>(items: &[(i64, T)], at: i64) -> &T {
    let after = items.partition_point(|(time, _)| *time < at);
    &items[after.min(items.len() - 1)].1
}

/// Ticks at a fixed rate.
struct Ticks {
    begun: MonotonicTime,
    period: i64,
    number: i64,
}

impl Ticks {
    fn new(begun: MonotonicTime, rate: i64) -> Self {
        let period = SECOND / rate;
        let number = SystemClock.now().nanos_since(begun) / period + 1;
        Self {
            begun,
            period,
            number,
        }
    }

    /// Waits for the next tick, at most for `timeout`. Ticks that have passed are left out, as by
    /// a device whose reader was suspended.
    fn next(&mut self, timeout: Duration) -> Option<u64> {
        let due = self.begun.offset_nanos(self.number * self.period);
        let now = SystemClock.now();
        let wait = Duration::from_nanos(due.nanos_since(now).max(0).unsigned_abs());
        std::thread::sleep(wait.min(timeout));
        let now = SystemClock.now();
        if now < due {
            return None;
        }
        let tick = now.nanos_since(self.begun) / self.period;
        self.number = tick + 1;
        Some(tick as u64)
    }
}

/// Which camera of the recording.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Which {
    Scene,
    Environment,
}

/// A camera of the recording.
pub struct SteadyCamera {
    recording: Arc<Recording>,
    which: Which,
    ticks: Ticks,
    /// Exposures of a view that are still to be delivered, the last one first.
    exposures: Vec<Frame>,
    sequence: u64,
}

impl SteadyCamera {
    pub fn new(recording: Arc<Recording>, which: Which) -> Self {
        let rate = match which {
            Which::Scene => SCENE_RATE,
            Which::Environment => ENVIRONMENT_RATE,
        };
        Self {
            ticks: Ticks::new(recording.begun, rate),
            recording,
            which,
            exposures: Vec::new(),
            sequence: 0,
        }
    }

    /// The picture as if it was taken now.
    fn renewed(&mut self, mut frame: Frame) -> Frame {
        let now = SystemClock.now();
        let age = frame.arrived_at.nanos_since(frame.captured_at);
        (frame.arrived_at, frame.captured_at) = (now, now.offset_nanos(-age));
        self.sequence += 1;
        frame.sequence = self.sequence;
        frame
    }
}

impl Camera for SteadyCamera {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        if let Some(frame) = self.exposures.pop() {
            return Ok(Some(self.renewed(frame)));
        }
        if self.ticks.next(timeout).is_none() {
            return Ok(None);
        }
        let at = self.recording.position(SystemClock.now());
        let frame = match self.which {
            Which::Scene => nearest(&self.recording.scene, at).clone(),
            Which::Environment => {
                let view = nearest(&self.recording.environment, at);
                self.exposures = view.iter().rev().cloned().collect();
                self.exposures.pop().unwrap()
            }
        };
        Ok(Some(self.renewed(frame)))
    }

    fn report(&self) -> CameraReport {
        CameraReport {
            stamps: StampSource::StartOfExposure,
            ..CameraReport::default()
        }
    }
}

/// The tracker of the recording.
pub struct SteadyTracker {
    recording: Arc<Recording>,
    ticks: Ticks,
}

impl SteadyTracker {
    pub fn new(recording: Arc<Recording>) -> Self {
        Self {
            ticks: Ticks::new(recording.begun, TRACKER_RATE),
            recording,
        }
    }
}

impl Tracker for SteadyTracker {
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        if self.ticks.next(timeout).is_none() {
            return Ok(None);
        }
        let now = SystemClock.now();
        let at = self.recording.position(now);
        Ok(Some(TrackerBytes {
            arrived_at: now,
            ..nearest(&self.recording.tracker, at).clone()
        }))
    }

    fn report(&self) -> TrackerReport {
        TrackerReport {
            protocol: self.recording.protocol.clone(),
            ..TrackerReport::default()
        }
    }
}
