//! A simulated tracker: the device and its motion.

use crate::csv;
use crate::fastrak::Fastrak;
use crate::flock::Flock;
use crate::freed::Freed;
use crate::liberty::Liberty;
use crate::trajectory::Trajectory;
use penumbra_interface::{MonotonicTime, RigidTransform};
use thiserror::Error;

/// Nanoseconds. A device that is later than this skips the records that it missed.
const BACKLOG: i64 = 500_000_000;

/// Source of the records that a simulated tracker sends.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Records of the poses of a trajectory.
    Trajectory(Trajectory),
    /// Recorded bytes of a real tracker.
    Recording(Recording),
}

/// Recorded bytes of a tracker with their arrival times, repeated without end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Nanoseconds from the first chunk, and the bytes.
    chunks: Vec<(i64, Vec<u8>)>,
}

impl Recording {
    /// Creates a recording from chunks in the order of their arrival. It starts with the first one.
    #[must_use]
    pub fn new(chunks: Vec<(MonotonicTime, Vec<u8>)>) -> Self {
        let began = chunks.first().map_or(MonotonicTime::default(), |c| c.0);
        let chunks = chunks.into_iter();
        Self {
            chunks: chunks
                .map(|(at, bytes)| (at.nanos_since(began).max(0), bytes))
                .collect(),
        }
    }

    /// Whether there is nothing to send.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.chunks.iter().all(|(_, bytes)| bytes.is_empty())
    }

    /// The index of the chunk after this one, and the nanoseconds between them.
    fn after(&self, index: usize) -> (usize, i64) {
        let time = |index: usize| self.chunks.get(index).map(|chunk| chunk.0);
        match (time(index), time(index + 1)) {
            (Some(now), Some(next)) => (index + 1, (next - now).max(0)),
            // The interval from the last to the first is that between the first two.
            _ => (0, time(1).unwrap_or(10_000_000).max(1_000_000)),
        }
    }
}

/// There is no simulated device for this protocol.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "there is no simulated tracker for {protocol:?}; try fastrak, liberty, patriot, flock, freed or csv"
)]
pub struct UnknownProtocol {
    /// The protocol name.
    pub protocol: String,
}

#[derive(Clone, Debug)]
enum Device {
    Fastrak(Fastrak),
    Liberty(Liberty),
    Flock(Flock),
    Freed(Freed),
    Csv,
}

/// A simulated device without I/O or clock: it executes commands and returns answers and records
/// at given times.
#[derive(Clone, Debug)]
pub struct SimulatedTracker {
    device: Device,
    source: Source,
    rate: Option<f64>,
    /// When it was first used, which is the start of the trajectory.
    began: Option<MonotonicTime>,
    /// When the next record is due; `None` while it does not stream.
    due: Option<MonotonicTime>,
    /// Index of the next chunk of the recording.
    chunk: usize,
    /// Until when it re-initialises and ignores commands.
    resets_until: Option<MonotonicTime>,
}

impl SimulatedTracker {
    /// A device for `protocol`, a name as in a session (`fastrak`, `fastrak-binary-quaternion`,
    /// `liberty`, `flock` …). With a recording it starts in the mode of the name,
    /// otherwise with factory settings. `rate` is in records a second, `None` for the device's
    /// own. `unprompted` makes a FreeD unit stream without a command, as units that send datagrams
    /// do.
    ///
    /// # Errors
    /// There is no simulated device for the protocol.
    pub fn new(
        protocol: &str,
        source: Source,
        rate: Option<f64>,
        unprompted: bool,
    ) -> Result<Self, UnknownProtocol> {
        let family = protocol.split(['-', ':']).next().unwrap_or_default();
        let mut device = match family {
            "fastrak" => Device::Fastrak(Fastrak::default()),
            "liberty" | "patriot" => Device::Liberty(Liberty::new(family == "patriot")),
            "flock" => Device::Flock(Flock::default()),
            "freed" => Device::Freed(Freed::new(unprompted)),
            "csv" => Device::Csv,
            _ => {
                return Err(UnknownProtocol {
                    protocol: protocol.to_owned(),
                });
            }
        };
        if matches!(source, Source::Recording(_)) {
            device.configure_for(protocol);
        }
        Ok(Self {
            device,
            source,
            rate: rate.filter(|rate| *rate > 0.0),
            began: None,
            due: None,
            chunk: 0,
            resets_until: None,
        })
    }

    /// Executes commands and appends the immediate answers.
    pub fn receive(&mut self, bytes: &[u8], now: MonotonicTime, out: &mut Vec<u8>) {
        if self.resets_until.is_some_and(|until| now < until) {
            return;
        }
        let pose = self.pose(now);
        match &mut self.device {
            Device::Fastrak(device) => device.receive(bytes, pose, out),
            Device::Liberty(device) => device.receive(bytes, pose, out),
            Device::Flock(device) => device.receive(bytes, pose, out),
            Device::Freed(device) => device.receive(bytes, pose, out),
            Device::Csv => {}
        }
        if let Device::Fastrak(device) = &mut self.device {
            let reset = device.take_reset();
            self.resets_until = reset.map(|s| now.offset_nanos((s * 1e9) as i64));
        }
    }

    /// Appends all records that are due by `now`.
    pub fn advance(&mut self, now: MonotonicTime, out: &mut Vec<u8>) {
        if !self.is_streaming() {
            self.due = None;
            return;
        }
        let mut due = self.due.unwrap_or(now);
        if now.nanos_since(due) > BACKLOG {
            due = now;
        }
        while due <= now {
            let pause = self.send(due, out);
            due = due.offset_nanos(pause);
        }
        self.due = Some(due);
    }

    /// When to call [`advance`](Self::advance) again; `None` while the device does not stream.
    #[must_use]
    pub fn next_due(&self) -> Option<MonotonicTime> {
        self.due.filter(|_| self.is_streaming())
    }

    /// Whether it sends records continuously.
    #[must_use]
    pub fn is_streaming(&self) -> bool {
        match &self.device {
            Device::Fastrak(device) => device.is_streaming(),
            Device::Liberty(device) => device.is_streaming(),
            Device::Flock(device) => device.is_streaming(),
            Device::Freed(device) => device.is_streaming(),
            Device::Csv => true,
        }
    }

    /// The pose of the sensor, `transmitter_from_sensor`.
    pub fn pose(&mut self, now: MonotonicTime) -> RigidTransform {
        let began = *self.began.get_or_insert(now);
        match &self.source {
            Source::Trajectory(path) => path.pose_at(now.seconds_since(began)),
            Source::Recording(_) => RigidTransform::IDENTITY,
        }
    }

    /// Appends one record or one chunk of the recording; the nanoseconds until the next.
    fn send(&mut self, at: MonotonicTime, out: &mut Vec<u8>) -> i64 {
        if let Source::Recording(recording) = &self.source {
            if let Some((_, bytes)) = recording.chunks.get(self.chunk) {
                out.extend_from_slice(bytes);
            }
            let (next, pause) = recording.after(self.chunk);
            self.chunk = next;
            return pause;
        }
        let pose = self.pose(at);
        match &mut self.device {
            Device::Fastrak(device) => device.records(pose, out),
            Device::Liberty(device) => device.stream(pose, out),
            Device::Flock(device) => device.records(pose, out),
            Device::Freed(_) => Freed::record(pose, out),
            Device::Csv => {
                let began = self.began.unwrap_or(at);
                csv::record(at.seconds_since(began), pose, out);
            }
        }
        (1e9 / self.rate.unwrap_or_else(|| self.device.default_rate())) as i64
    }
}

impl Device {
    /// Sets the mode of a protocol name.
    fn configure_for(&mut self, protocol: &str) {
        match self {
            Self::Fastrak(device) => device.configure_for(protocol),
            Self::Liberty(device) => device.configure_for(protocol),
            Self::Flock(device) => device.configure_for(protocol),
            Self::Freed(_) | Self::Csv => {}
        }
    }

    /// The device's own rate, records a second.
    fn default_rate(&self) -> f64 {
        match self {
            Self::Fastrak(device) => 120.0 / device.active() as f64,
            Self::Liberty(_) => 240.0,
            Self::Flock(_) | Self::Csv => 100.0,
            // Video units send once a field.
            Self::Freed(_) => 50.0,
        }
    }
}

#[cfg(test)]
mod tests;
