//! The tracker's readings, in the order of arrival.

use crate::latency::TrackerTrack;
use crate::latency::without_jumps;
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_sync::{Degree, HistoryConfig, PoseHistory, Provenance, Smoothing};
use std::collections::BTreeSet;

/// Maximum number of readings: an hour of the fastest tracker.
const MAX_READINGS: usize = 1_000_000;
/// Half-width of the window that smooths rotations for the latency, seconds.
const SMOOTHING: f64 = 0.02;
/// Half-width of the window that smooths poses for hand–eye pairs, nanoseconds.
const PAIR_SMOOTHING_NANOS: i64 = 35_000_000;

/// Readings of one station of the tracker.
#[derive(Clone, Debug)]
pub(super) struct Readings {
    station: u8,
    others: BTreeSet<u8>,
    kept: Vec<(MonotonicTime, RigidTransform)>,
}

impl Readings {
    /// Creates an empty record of the station with this number.
    pub const fn new(station: u8) -> Self {
        Self {
            station,
            others: BTreeSet::new(),
            kept: Vec::new(),
        }
    }

    /// Adds a reading; of other stations only the number is noted.
    pub fn push(&mut self, sample: &PoseSample) {
        if sample.station != self.station {
            self.others.insert(sample.station);
        } else if self.kept.len() < MAX_READINGS
            && sample.transmitter_from_sensor.rotation.is_finite()
        {
            self.kept
                .push((sample.arrived_at, sample.transmitter_from_sensor));
        }
    }

    /// Returns the number of readings.
    pub const fn len(&self) -> usize {
        self.kept.len()
    }

    /// Returns the message for a record without readings; `None` if there are some.
    pub fn missing(&self) -> Option<String> {
        if !self.kept.is_empty() {
            return None;
        }
        if self.others.is_empty() {
            return Some(
                "the recording has no tracker readings; record with the tracker on".to_owned(),
            );
        }
        let others: Vec<String> = self.others.iter().map(u8::to_string).collect();
        Some(format!(
            "the tracker sent no readings of station {}, only of {}; choose another with --station",
            self.station,
            others.join(", ")
        ))
    }

    /// Returns the track for the latency estimate, in seconds after `zero`.
    pub fn track(&self, zero: MonotonicTime) -> TrackerTrack {
        let poses = self.kept.iter();
        let poses = poses.map(|(at, pose)| (at.seconds_since(zero), *pose));
        TrackerTrack::from_poses(poses, SMOOTHING)
    }

    /// Returns the history as the running rig keeps it, but without jumps and with less smoothing.
    pub fn history(&self) -> PoseHistory {
        let mut history = PoseHistory::new(HistoryConfig {
            capacity: self.kept.len().max(2),
            // The clock of a recording never restarts.
            jump_back_nanos: i64::MAX,
            // Hundreds of pairs average the noise out, but not the bias of a wider window.
            smoothing: Smoothing::Local {
                half_window_nanos: PAIR_SMOOTHING_NANOS,
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

/// Returns the pose at an instant between two readings; `None` outside of the record.
pub(super) fn between(history: &PoseHistory, at: MonotonicTime) -> Option<RigidTransform> {
    let found = history.at(at)?;
    (found.provenance != Provenance::Predicted).then_some(found.transmitter_from_sensor)
}
