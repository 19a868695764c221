//! What the tracker said, in the order of arrival.

use crate::latency::TrackerTrack;
use crate::latency::without_jumps;
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_sync::{Degree, HistoryConfig, PoseHistory, Provenance, Smoothing};
use std::collections::BTreeSet;

/// Readings kept: an hour of the fastest tracker.
const MOST: usize = 1_000_000;
/// Rotations are smoothed over so many seconds to either side.
const SMOOTHING: f64 = 0.02;
/// And poses for pairs over so much, nanoseconds.
const NARROW_NANOS: i64 = 35_000_000;

/// Of one station.
#[derive(Clone, Debug)]
pub struct Readings {
    station: u8,
    others: BTreeSet<u8>,
    kept: Vec<(MonotonicTime, RigidTransform)>,
}

impl Readings {
    /// Of the station with this number.
    #[must_use]
    pub const fn of_station(station: u8) -> Self {
        Self {
            station,
            others: BTreeSet::new(),
            kept: Vec::new(),
        }
    }

    /// Takes one; those of other stations are noted only.
    pub fn push(&mut self, sample: &PoseSample) {
        if sample.station != self.station {
            self.others.insert(sample.station);
        } else if self.kept.len() < MOST && sample.transmitter_from_sensor.rotation.is_finite() {
            self.kept
                .push((sample.arrived_at, sample.transmitter_from_sensor));
        }
    }

    /// How many.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// What to say where there are none; `None` where there are.
    #[must_use]
    pub fn missing(&self) -> Option<String> {
        if !self.kept.is_empty() {
            return None;
        }
        if self.others.is_empty() {
            return Some("the recording has no readings of a tracker; record with one".to_owned());
        }
        let others: Vec<String> = self.others.iter().map(u8::to_string).collect();
        Some(format!(
            "the tracker sent nothing of station {}, only of {}; choose with --station",
            self.station,
            others.join(", ")
        ))
    }

    /// The pose by time, seconds after `zero`.
    #[must_use]
    pub fn track(&self, zero: MonotonicTime) -> TrackerTrack {
        let poses = self.kept.iter();
        let poses = poses.map(|(at, pose)| (at.seconds_since(zero), *pose));
        TrackerTrack::of_poses(poses, SMOOTHING)
    }

    /// As the running rig keeps them, but without readings that the next ones contradict, and
    /// smoothed less.
    #[must_use]
    pub fn history(&self) -> PoseHistory {
        let mut history = PoseHistory::new(HistoryConfig {
            capacity: self.kept.len().max(2),
            // A recording is one stretch of time.
            jump_back_nanos: i64::MAX,
            // Hundreds of pairs take the noise away; what a wider window bends straight they would
            // not.
            smoothing: Smoothing::Local {
                half_window_nanos: NARROW_NANOS,
                degree: Degree::Quadratic,
            },
            ..HistoryConfig::default()
        });
        let Some(first) = self.kept.first().map(|k| k.0) else {
            return history;
        };
        let seconds =
            |(at, pose): &(MonotonicTime, RigidTransform)| (at.seconds_since(first), *pose);
        for (at, pose) in without_jumps(self.kept.iter().map(seconds).collect()) {
            history.push(first.offset_nanos((at * 1e9).round() as i64), pose);
        }
        history
    }
}

/// The pose at an instant between two readings.
pub(super) fn between(history: &PoseHistory, at: MonotonicTime) -> Option<RigidTransform> {
    let found = history.at(at)?;
    (found.provenance != Provenance::Predicted).then_some(found.transmitter_from_sensor)
}
