//! A simulated tracker: one of the machines, and what moves it.

use crate::fastrak::Fastrak;
use crate::flock::Flock;
use crate::freed::Freed;
use crate::liberty::Liberty;
use crate::{Trajectory, csv};
use penumbra_interface::{MonotonicTime, RigidTransform};
use thiserror::Error;

/// A device that fell further behind than this leaves out what it missed, nanoseconds.
const BACKLOG: i64 = 500_000_000;

/// What a simulated tracker sends while it streams.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// Records of poses along a path.
    Trajectory(Trajectory),
    /// Bytes that a real one sent.
    Recording(Recording),
}

/// Bytes of a tracker with the times at which they came; begins again after the last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    chunks: Vec<(i64, Vec<u8>)>,
}

impl Recording {
    /// From chunks in the order of their arrival. Nobody needs the pause before the first.
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

    /// The chunk after this one, and how long after it, nanoseconds.
    fn after(&self, index: usize) -> (usize, i64) {
        let time = |index: usize| self.chunks.get(index).map(|chunk| chunk.0);
        match (time(index), time(index + 1)) {
            (Some(now), Some(next)) => (index + 1, (next - now).max(0)),
            // Between the last and the first as long as between the first two.
            _ => (0, time(1).unwrap_or(10_000_000).max(1_000_000)),
        }
    }
}

/// No simulation speaks this protocol.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error(
    "no simulated tracker speaks {protocol:?}; try fastrak, liberty, patriot, flock, freed or csv"
)]
pub struct UnknownProtocol {
    /// What was asked for.
    pub protocol: String,
}

#[derive(Clone, Debug)]
enum Machine {
    Fastrak(Fastrak),
    Liberty(Liberty),
    Flock(Flock),
    Freed(Freed),
    Csv,
}

/// A device without I/O: commands in, answers and records out, on the clock it is given.
#[derive(Clone, Debug)]
pub struct SimulatedTracker {
    machine: Machine,
    source: Source,
    rate: Option<f64>,
    /// When it was switched on; the path begins there.
    began: Option<MonotonicTime>,
    /// When the next record is due, while it streams.
    due: Option<MonotonicTime>,
    /// The recording's next chunk.
    chunk: usize,
    /// It does not listen before: it re-initialises.
    deaf_until: Option<MonotonicTime>,
}

impl SimulatedTracker {
    /// A device that speaks `protocol` (a name as in a session: `fastrak`,
    /// `fastrak-binary-quaternion`, `liberty`, `flock` …). With a recording it begins in the
    /// mode that the name says; otherwise as from the factory. `rate` in records a second,
    /// `None` for the device's own. `unasked` makes a FreeD unit stream from the beginning,
    /// as those do that send datagrams.
    ///
    /// # Errors
    /// When no simulation speaks the protocol.
    pub fn new(
        protocol: &str,
        source: Source,
        rate: Option<f64>,
        unasked: bool,
    ) -> Result<Self, UnknownProtocol> {
        let family = protocol.split(['-', ':']).next().unwrap_or_default();
        let mut machine = match family {
            "fastrak" => Machine::Fastrak(Fastrak::default()),
            "liberty" | "patriot" => Machine::Liberty(Liberty::new(family == "patriot")),
            "flock" => Machine::Flock(Flock::default()),
            "freed" => Machine::Freed(Freed::new(unasked)),
            "csv" => Machine::Csv,
            _ => {
                return Err(UnknownProtocol {
                    protocol: protocol.to_owned(),
                });
            }
        };
        if matches!(source, Source::Recording(_)) {
            machine.set_as(protocol);
        }
        Ok(Self {
            machine,
            source,
            rate: rate.filter(|rate| *rate > 0.0),
            began: None,
            due: None,
            chunk: 0,
            deaf_until: None,
        })
    }

    /// Takes what the driver wrote and appends what the device answers at once.
    pub fn receive(&mut self, bytes: &[u8], now: MonotonicTime, out: &mut Vec<u8>) {
        if self.deaf_until.is_some_and(|until| now < until) {
            return;
        }
        let pose = self.pose(now);
        match &mut self.machine {
            Machine::Fastrak(device) => device.receive(bytes, pose, out),
            Machine::Liberty(device) => device.receive(bytes, pose, out),
            Machine::Flock(device) => device.receive(bytes, pose, out),
            Machine::Freed(device) => device.receive(bytes, pose, out),
            Machine::Csv => {}
        }
        if let Machine::Fastrak(device) = &mut self.machine {
            let reset = device.take_reset();
            self.deaf_until = reset.map(|s| now.offset_nanos((s * 1e9) as i64));
        }
    }

    /// Appends all that is due by `now`.
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

    /// When to call [`advance`](Self::advance) again; `None` while the device is quiet.
    #[must_use]
    pub fn next_due(&self) -> Option<MonotonicTime> {
        self.due.filter(|_| self.is_streaming())
    }

    /// Whether it sends of itself.
    #[must_use]
    pub fn is_streaming(&self) -> bool {
        match &self.machine {
            Machine::Fastrak(device) => device.is_streaming(),
            Machine::Liberty(device) => device.is_streaming(),
            Machine::Flock(device) => device.is_streaming(),
            Machine::Freed(device) => device.is_streaming(),
            Machine::Csv => true,
        }
    }

    /// Where the sensor is, `transmitter_from_sensor`.
    pub fn pose(&mut self, now: MonotonicTime) -> RigidTransform {
        let began = *self.began.get_or_insert(now);
        match &self.source {
            Source::Trajectory(path) => path.pose_at(now.seconds_since(began)),
            Source::Recording(_) => RigidTransform::IDENTITY,
        }
    }

    /// One record, or one chunk of the recording; how long until the next, nanoseconds.
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
        match &mut self.machine {
            Machine::Fastrak(device) => device.records(pose, out),
            Machine::Liberty(device) => device.stream(pose, out),
            Machine::Flock(device) => device.records(pose, out),
            Machine::Freed(_) => Freed::record(pose, out),
            Machine::Csv => {
                let began = self.began.unwrap_or(at);
                csv::record(at.seconds_since(began), pose, out);
            }
        }
        (1e9 / self.rate.unwrap_or_else(|| self.machine.usual_rate())) as i64
    }
}

impl Machine {
    fn set_as(&mut self, protocol: &str) {
        match self {
            Self::Fastrak(device) => device.set_as(protocol),
            Self::Liberty(device) => device.set_as(protocol),
            Self::Flock(device) => device.set_as(protocol),
            Self::Freed(_) | Self::Csv => {}
        }
    }

    /// Records a second.
    fn usual_rate(&self) -> f64 {
        match self {
            Self::Fastrak(device) => 120.0 / device.active() as f64,
            Self::Liberty(_) => 240.0,
            Self::Flock(_) | Self::Csv => 100.0,
            // A video unit sends once a field.
            Self::Freed(_) => 50.0,
        }
    }
}

#[cfg(test)]
mod tests;
