//! Pairs each picture of the scene camera with a view of the environment and a pose.

use super::brackets::{BracketCollector, EnvironmentSet};
use super::history::{HistoryConfig, PoseAt, PoseHistory, Provenance, Pushed, Smoothing};
use super::lost_readings::LostReadings;
use super::stations::Stations;
use penumbra_interface::{Frame, MonotonicTime, PoseSample, RigidTransform};
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::Arc;

/// Latencies and waiting times. All times in nanoseconds.
///
/// A picture waits until the tracker's readings extend `lookahead_nanos` beyond its exposure, so that
/// its pose is interpolated rather than predicted; but no longer than `max_wait_nanos` after its
/// arrival, and not at all if the tracker has been silent for `silent_after_nanos`. The current time
/// is the newest arrival on any stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairingConfig {
    /// Time stamp of the scene camera minus the middle of its exposure.
    pub scene_latency_nanos: i64,
    /// Time stamp of the environment camera minus the middle of its exposure.
    pub environment_latency_nanos: i64,
    /// Arrival of a tracker's record minus its measurement.
    pub tracker_latency_nanos: i64,
    /// Number of brackets that follow each base exposure of the environment camera.
    pub brackets: usize,
    /// Station of the sensor on the scene camera; `None` without a tracker.
    pub station: Option<u8>,
    /// Time after the exposure for which readings are awaited.
    pub lookahead_nanos: i64,
    /// Maximum waiting time for them.
    pub max_wait_nanos: i64,
    /// Maximum waiting time of pictures for the first view of the environment, which they get even
    /// if it is captured later, because there is no other light. 0 to return them without a view.
    pub first_view_wait_nanos: i64,
    /// Silence after which the tracker is not awaited.
    pub silent_after_nanos: i64,
    /// Half the interval around the exposure over which the sensor's motion is returned; 0 for none.
    pub motion_nanos: i64,
    /// Settings of the tracker's history.
    pub history: HistoryConfig,
}

impl Default for PairingConfig {
    /// For a live rig: a picture waits only for the readings around its exposure.
    fn default() -> Self {
        Self {
            scene_latency_nanos: 0,
            environment_latency_nanos: 0,
            tracker_latency_nanos: 0,
            brackets: 0,
            station: Some(1),
            lookahead_nanos: 0,
            max_wait_nanos: 50_000_000,
            first_view_wait_nanos: 0,
            silent_after_nanos: 250_000_000,
            motion_nanos: 0,
            history: HistoryConfig::default(),
        }
    }
}

impl PairingConfig {
    /// Returns the settings for a recording, where waiting costs nothing: pictures wait until the
    /// smoothing window is full on both sides, and the first pictures wait for the first view.
    #[must_use]
    pub fn with_full_windows(mut self) -> Self {
        self.first_view_wait_nanos = 100_000_000;
        if let Smoothing::Local {
            half_window_nanos, ..
        } = self.history.smoothing
        {
            self.lookahead_nanos = half_window_nanos;
            let needed = half_window_nanos + self.tracker_latency_nanos.max(0);
            self.max_wait_nanos = self.max_wait_nanos.max(2 * needed);
        }
        self
    }
}

/// Everything that belongs to one picture of the scene camera.
#[derive(Clone, Debug)]
pub struct RigFrame {
    /// Number of the scene camera's picture in the order of arrival, from 0.
    pub index: u64,
    /// The picture.
    pub scene: Frame,
    /// Middle of its exposure, corrected by the camera's latency.
    pub captured_at: MonotonicTime,
    /// The newest earlier view of the environment, if there is one.
    pub environment: Option<PairedEnvironment>,
    /// The sensor's pose at `captured_at`, if it is known.
    pub pose: Option<PoseAt>,
    /// The sensor's poses before and after it and the seconds between; see [`PairingConfig::motion_nanos`].
    pub motion: Option<(RigidTransform, RigidTransform, f64)>,
}

/// A paired view of the environment.
#[derive(Clone, Debug)]
pub struct PairedEnvironment {
    /// The view, shared.
    pub set: Arc<EnvironmentSet>,
    /// Age relative to the scene camera's picture, nanoseconds. Negative only before the first view;
    /// see [`PairingConfig::first_view_wait_nanos`].
    pub skew_nanos: i64,
}

/// Counters for status and report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PairingCounts {
    /// Pictures of the scene camera received.
    pub scene_frames: u64,
    /// Pictures returned.
    pub paired: u64,
    /// Pictures returned without a pose.
    pub without_pose: u64,
    /// Pictures returned with a predicted pose.
    pub predicted: u64,
    /// Pictures returned without a view of the environment.
    pub without_environment: u64,
    /// Pictures returned with the first view although captured before it.
    pub before_first_view: u64,
    /// Pictures returned after the maximum waiting time.
    pub waited_out: u64,
    /// Views of the environment started.
    pub environment_sets: u64,
    /// Views without all their brackets.
    pub incomplete_sets: u64,
    /// Brackets without their base exposure.
    pub orphan_brackets: u64,
    /// Readings added to the history.
    pub poses: u64,
    /// Readings rejected as invalid, late or outliers.
    pub rejected_poses: u64,
    /// Those that are no numbers or no rotation.
    pub invalid_poses: u64,
    /// Those that are not newer than the reading before.
    pub late_poses: u64,
    /// Estimated number of readings that were lost on their way.
    pub lost_readings: u64,
    /// Readings of other stations.
    pub other_stations: u64,
    /// These stations.
    pub stations_seen: Stations,
    /// The station that is used; `None` without a tracker.
    pub station: Option<u8>,
    /// Number of restarts because time stamps went back.
    pub time_jumps: u64,
}

/// Number of readings of other stations after which the used one counts as wrong.
const WRONG_STATION_AFTER: u64 = 30;

impl PairingCounts {
    /// Returns what is wrong if the tracker sends readings, but none of the station that is used.
    #[must_use]
    pub fn wrong_station(&self) -> Option<String> {
        let station = self.station?;
        let is_wrong = self.poses + self.rejected_poses == 0;
        (is_wrong && self.other_stations >= WRONG_STATION_AFTER).then(|| {
            format!(
                "no reading of station {station} among {}; stations seen: {}; set `station` under \
                 [tracker]",
                self.other_stations, self.stations_seen
            )
        })
    }
}

/// Maximum number of waiting pictures.
const MAX_WAITING: usize = 16;
/// Inverse slew rate of the tracker's latency, to avoid jumps: one millisecond per second.
const LATENCY_SLEW: i64 = 1000;
/// Maximum disorder of arrivals, nanoseconds; beyond it a new time line starts.
const JUMP_BACK_NANOS: i64 = 500_000_000;

/// Pairs streams. Push frames and poses in the order of arrival and call [`Self::pop`] until it
/// returns `None`; at the end of a recording call [`Self::finish`].
#[derive(Debug)]
pub struct Pairing {
    config: PairingConfig,
    history: PoseHistory,
    environment: BracketCollector,
    waiting: VecDeque<RigFrame>,
    /// Number of pictures at the front of `waiting` that are due.
    overdue: usize,
    now: Option<MonotonicTime>,
    /// Arrival of the tracker's last record, or the first arrival.
    tracker_heard_at: MonotonicTime,
    counts: PairingCounts,
    /// Value that the tracker's latency approaches, nanoseconds.
    target_latency: i64,
    lost: LostReadings,
}

impl Pairing {
    /// Creates a pairing without arrivals.
    #[must_use]
    pub fn new(config: PairingConfig) -> Self {
        Self {
            config,
            history: PoseHistory::new(config.history),
            environment: BracketCollector::new(config.brackets),
            waiting: VecDeque::with_capacity(MAX_WAITING + 1),
            overdue: 0,
            now: None,
            tracker_heard_at: MonotonicTime::default(),
            counts: PairingCounts::default(),
            target_latency: config.tracker_latency_nanos,
            lost: LostReadings::default(),
        }
    }

    /// Sets the value that the tracker's latency approaches by one millisecond per second.
    pub const fn set_target_latency(&mut self, nanos: i64) {
        self.target_latency = nanos;
    }

    /// The active latency of the tracker, nanoseconds.
    #[must_use]
    pub const fn tracker_latency(&self) -> i64 {
        self.config.tracker_latency_nanos
    }

    /// Moves the tracker's latency towards its target, `passed_nanos` after the last time.
    fn slew_latency(&mut self, passed_nanos: i64) {
        let max = passed_nanos.clamp(0, self.config.silent_after_nanos.max(0)) / LATENCY_SLEW;
        let latency = &mut self.config.tracker_latency_nanos;
        *latency += (self.target_latency - *latency).clamp(-max, max);
    }

    /// Returns the counters.
    #[must_use]
    pub fn counts(&self) -> PairingCounts {
        PairingCounts {
            environment_sets: self.environment.generation(),
            incomplete_sets: self.environment.incomplete,
            orphan_brackets: self.environment.orphans,
            station: self.config.station,
            lost_readings: self.lost.count(),
            ..self.counts
        }
    }

    /// The tracker's history, for poses at other instants.
    #[must_use]
    pub const fn history(&self) -> &PoseHistory {
        &self.history
    }

    /// Adds a picture of the scene camera.
    pub fn push_scene(&mut self, frame: Frame) {
        self.advance(frame.arrived_at);
        let captured_at = frame
            .captured_at
            .offset_nanos(self.config.scene_latency_nanos.saturating_neg());
        self.waiting.push_back(RigFrame {
            index: self.counts.scene_frames,
            scene: frame,
            captured_at,
            environment: None,
            pose: None,
            motion: None,
        });
        self.counts.scene_frames += 1;
        if self.waiting.len() > MAX_WAITING {
            self.overdue = self.overdue.max(self.waiting.len() - MAX_WAITING);
        }
    }

    /// Counts a picture of the scene camera that was skipped in favour of newer ones.
    pub fn skip_scene(&mut self, arrived_at: MonotonicTime) {
        self.advance(arrived_at);
        self.counts.scene_frames += 1;
    }

    /// Adds a picture of the environment camera.
    pub fn push_environment(&mut self, frame: Frame) {
        self.advance(frame.arrived_at);
        let latency = self.config.environment_latency_nanos;
        let captured_at = frame.captured_at.offset_nanos(latency.saturating_neg());
        self.environment.push(frame, captured_at);
    }

    /// Adds a reading of the tracker.
    pub fn push_pose(&mut self, sample: &PoseSample) {
        self.advance(sample.arrived_at);
        if self.config.station != Some(sample.station) {
            self.counts.other_stations += 1;
            self.counts.stations_seen.insert(sample.station);
            return;
        }
        self.lost.add(sample.arrived_at);
        self.slew_latency(sample.arrived_at.nanos_since(self.tracker_heard_at));
        self.tracker_heard_at = sample.arrived_at;
        let latency = self.config.tracker_latency_nanos;
        let measured_at = sample.arrived_at.offset_nanos(latency.saturating_neg());
        let pushed = self
            .history
            .push(measured_at, sample.transmitter_from_sensor);
        self.counts.invalid_poses += u64::from(pushed == Pushed::Invalid);
        self.counts.late_poses += u64::from(pushed == Pushed::Late);
        match pushed {
            Pushed::Kept | Pushed::Restarted => self.counts.poses += 1,
            Pushed::Invalid | Pushed::Late | Pushed::Outlier => self.counts.rejected_poses += 1,
        }
    }

    /// Advances the current time, for streams that may be silent (live, on a timer).
    pub fn advance(&mut self, now: MonotonicTime) {
        let Some(before) = self.now else {
            self.now = Some(now);
            self.tracker_heard_at = now;
            return;
        };
        if now.nanos_since(before) < -JUMP_BACK_NANOS {
            self.restart(now);
        } else {
            self.now = Some(before.max(now));
        }
    }

    /// Starts a new time line: completes the waiting pictures, then clears the histories.
    fn restart(&mut self, now: MonotonicTime) {
        for i in 0..self.waiting.len() {
            self.complete(i);
        }
        self.overdue = self.waiting.len();
        self.history.clear();
        self.environment.clear();
        self.now = Some(now);
        self.tracker_heard_at = now;
        self.counts.time_jumps += 1;
    }

    /// Ends the waiting of all pictures, because nothing more will arrive.
    pub fn finish(&mut self) {
        self.overdue = self.waiting.len();
    }

    /// Returns the next picture, in the order of arrival, if it is due.
    pub fn pop(&mut self) -> Option<RigFrame> {
        let first = self.waiting.front()?;
        if self.overdue == 0 && !self.is_ready(first) {
            return None;
        }
        self.complete(0);
        let frame = self.waiting.pop_front()?;
        self.overdue = self.overdue.saturating_sub(1);
        self.count(&frame);
        Some(frame)
    }

    /// Returns the time at which the first waiting picture is due even if nothing more arrives;
    /// `None` if no picture waits.
    #[must_use]
    pub fn deadline(&self) -> Option<MonotonicTime> {
        let first = self.waiting.front()?;
        let arrived_at = first.scene.arrived_at;
        let wait = arrived_at.offset_nanos(self.config.max_wait_nanos);
        let silent = self
            .tracker_heard_at
            .offset_nanos(self.config.silent_after_nanos);
        let view = arrived_at.offset_nanos(self.config.first_view_wait_nanos);
        let pose_due = if self.pose_ready(first) {
            arrived_at
        } else {
            wait.min(silent)
        };
        let view_due = if self.environment_ready(first) {
            arrived_at
        } else {
            view
        };
        Some(pose_due.max(view_due))
    }

    fn is_ready(&self, frame: &RigFrame) -> bool {
        self.environment_ready(frame) && self.pose_ready(frame)
    }

    /// Only the first pictures wait for a view of the environment.
    fn environment_ready(&self, frame: &RigFrame) -> bool {
        let now = self.now.unwrap_or(frame.scene.arrived_at);
        self.environment.generation() > 1
            || self.environment.first(now).is_some()
            || now.nanos_since(frame.scene.arrived_at) >= self.config.first_view_wait_nanos
    }

    fn pose_ready(&self, frame: &RigFrame) -> bool {
        let now = self.now.unwrap_or(frame.scene.arrived_at);
        let wanted = frame.captured_at.offset_nanos(self.config.lookahead_nanos);
        self.config.station.is_none()
            || self.history.newest().is_some_and(|newest| newest >= wanted)
            || now.nanos_since(frame.scene.arrived_at) >= self.config.max_wait_nanos
            || now.nanos_since(self.tracker_heard_at) >= self.config.silent_after_nanos
    }

    /// Pairs the picture at index `i`, as far as it is not paired yet.
    fn complete(&mut self, i: usize) {
        let Some(frame) = self.waiting.get_mut(i) else {
            return;
        };
        let (captured_at, now) = (frame.captured_at, self.now.unwrap_or_default());
        if frame.pose.is_none() {
            frame.pose = self.history.at(captured_at);
            frame.motion = motion(&self.history, captured_at, self.config.motion_nanos);
        }
        if frame.environment.is_none() {
            let timeout = self.config.first_view_wait_nanos;
            let soon = |set: &&Arc<EnvironmentSet>| {
                set.captured_at.nanos_since(captured_at) <= timeout && timeout > 0
            };
            let set = self
                .environment
                .newest_until(captured_at, now)
                .or_else(|| self.environment.first(now).filter(soon));
            frame.environment = set.map(|set| PairedEnvironment {
                set: Arc::clone(set),
                skew_nanos: captured_at.nanos_since(set.captured_at),
            });
        }
    }

    fn count(&mut self, frame: &RigFrame) {
        let provenance = frame.pose.map(|pose| pose.provenance);
        let waited = self.now.is_some_and(|now| {
            now.nanos_since(frame.scene.arrived_at) >= self.config.max_wait_nanos
        });
        let in_vain = waited && matches!(provenance, None | Some(Provenance::Predicted));
        self.counts.paired += 1;
        self.counts.without_pose += u64::from(provenance.is_none());
        self.counts.predicted += u64::from(provenance == Some(Provenance::Predicted));
        self.counts.without_environment += u64::from(frame.environment.is_none());
        self.counts.waited_out += u64::from(in_vain);
        let early = frame.environment.as_ref().is_some_and(|e| e.skew_nanos < 0);
        self.counts.before_first_view += u64::from(early);
    }
}

/// Returns poses on both sides of an instant, or before it if nothing later is known.
fn motion(
    history: &PoseHistory,
    at: MonotonicTime,
    half: i64,
) -> Option<(RigidTransform, RigidTransform, f64)> {
    if half <= 0 {
        return None;
    }
    let pose = |nanos: i64| {
        let found = history.at(at.offset_nanos(nanos))?;
        Some(found.transmitter_from_sensor)
    };
    let seconds = half as f64 * 2e-9;
    match (pose(-half), pose(half)) {
        (Some(before), Some(after)) => Some((before, after, seconds)),
        _ => Some((pose(-2 * half)?, pose(0)?, seconds)),
    }
}

#[cfg(test)]
mod tests;
