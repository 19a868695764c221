//! Which environment and which pose belong to a picture of the scene camera.

use super::brackets::{EnvironmentSet, Gathering};
use super::history::{HistoryConfig, PoseAt, PoseHistory, Provenance, Pushed, Smoothing};
use penumbra_interface::{Frame, MonotonicTime, PoseSample, RigidTransform};
use serde::Serialize;
use std::collections::VecDeque;
use std::sync::Arc;

/// Latencies, and how long a picture waits for what belongs to it.
///
/// A picture waits until the tracker's readings reach `lookahead_nanos` beyond its
/// exposure, so that its pose is interpolated, not predicted; but no longer than
/// `max_wait_nanos` after its arrival, and not at all once the tracker has been silent for
/// `silent_after_nanos`. Time is the newest arrival on any stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairingConfig {
    /// Stamp of the scene camera minus the middle of its exposure.
    pub scene_latency_nanos: i64,
    /// Stamp of the environment camera minus the middle of its exposure.
    pub environment_latency_nanos: i64,
    /// Arrival of a tracker's record minus its measurement.
    pub tracker_latency_nanos: i64,
    /// Brackets that follow each base exposure of the environment camera.
    pub brackets: usize,
    /// The station that carries the scene camera; `None` if nothing is tracked.
    pub station: Option<u8>,
    /// Readings wanted beyond the exposure.
    pub lookahead_nanos: i64,
    /// Longest wait for them.
    pub max_wait_nanos: i64,
    /// Pictures from before the first view of the environment wait for it so long, and get
    /// it though it is from their future: there is no other light to show them in. 0 to
    /// hand them on without.
    pub first_view_wait_nanos: i64,
    /// A tracker that said nothing for so long is not waited for.
    pub silent_after_nanos: i64,
    /// Half the time about the exposure over which the sensor's motion is told, nanoseconds; 0
    /// where nobody asks.
    pub motion_nanos: i64,
    /// What is kept and believed of the tracker.
    pub history: HistoryConfig,
}

impl Default for PairingConfig {
    /// As for a live rig: a picture waits for the readings around its exposure, no more.
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
    /// For a recording, where waiting costs nothing: a picture waits until the smoothing
    /// window is full on both sides, and the first pictures for the first view.
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
    /// Counts the pictures of the scene camera in the order of arrival, from 0.
    pub index: u64,
    /// The picture.
    pub scene: Frame,
    /// Middle of its exposure, corrected for the camera's latency.
    pub captured_at: MonotonicTime,
    /// The environment, if it was seen before.
    pub environment: Option<PairedEnvironment>,
    /// The sensor's pose at `captured_at`, if it is known.
    pub pose: Option<PoseAt>,
    /// Its poses a little before and after, if asked for, and the seconds between.
    pub motion: Option<(RigidTransform, RigidTransform, f64)>,
}

/// The environment as it was a little before.
#[derive(Clone, Debug)]
pub struct PairedEnvironment {
    /// The view, shared.
    pub set: Arc<EnvironmentSet>,
    /// Nanoseconds that it is older than the scene camera's picture. Negative only before
    /// the first view, see [`PairingConfig::first_view_wait_nanos`].
    pub skew_nanos: i64,
}

/// What happened so far, for status and report.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct PairingCounts {
    /// Pictures of the scene camera taken.
    pub scene_frames: u64,
    /// Of these, handed on.
    pub paired: u64,
    /// Handed on without a pose.
    pub without_pose: u64,
    /// Handed on with a predicted pose.
    pub predicted: u64,
    /// Handed on without an environment.
    pub without_environment: u64,
    /// Handed on with the first view though they are from before it.
    pub before_first_view: u64,
    /// Handed on after the longest wait, or because too many waited.
    pub waited_out: u64,
    /// Views of the environment begun.
    pub environment_sets: u64,
    /// Of these, without all their brackets.
    pub incomplete_sets: u64,
    /// Brackets without their base exposure.
    pub orphan_brackets: u64,
    /// Readings kept.
    pub poses: u64,
    /// Readings that were not finite, late, or impossibly far from the one before.
    pub rejected_poses: u64,
    /// Readings of other stations.
    pub other_stations: u64,
    /// Times that a stream went back in time and pairing began anew.
    pub time_jumps: u64,
}

/// Pictures that wait at most.
const WAITING: usize = 16;
/// The tracker's latency follows what is wished by a millisecond a second, so that nothing
/// jumps: one part in so many.
const LATENCY_SLEW: i64 = 1000;
/// Arrivals may be out of order by so much; more is another time.
const JUMP_BACK_NANOS: i64 = 500_000_000;

/// Pairs streams. Push what arrives, in the order of arrival, and pop until there is
/// nothing; at the end of a recording [`Self::finish`].
#[derive(Debug)]
pub struct Pairing {
    config: PairingConfig,
    history: PoseHistory,
    environment: Gathering,
    waiting: VecDeque<RigFrame>,
    /// Pictures at the front of `waiting` that may not wait any longer.
    overdue: usize,
    now: Option<MonotonicTime>,
    /// Last word of the tracker, or the beginning.
    heard_at: MonotonicTime,
    counts: PairingCounts,
    /// What the tracker's latency moves to.
    wished_latency: i64,
}

impl Pairing {
    /// Nothing has arrived yet.
    #[must_use]
    pub fn new(config: PairingConfig) -> Self {
        Self {
            config,
            history: PoseHistory::new(config.history),
            environment: Gathering::new(config.brackets),
            waiting: VecDeque::with_capacity(WAITING + 1),
            overdue: 0,
            now: None,
            heard_at: MonotonicTime::default(),
            counts: PairingCounts::default(),
            wished_latency: config.tracker_latency_nanos,
        }
    }

    /// Lets the tracker's latency move there, a millisecond a second, for the readings to come.
    pub const fn wish_tracker_latency(&mut self, nanos: i64) {
        self.wished_latency = nanos;
    }

    /// The tracker's latency that is in force, nanoseconds.
    #[must_use]
    pub const fn tracker_latency(&self) -> i64 {
        self.config.tracker_latency_nanos
    }

    /// Towards what is wished, after so long.
    fn slew_latency(&mut self, passed_nanos: i64) {
        let most = passed_nanos.clamp(0, self.config.silent_after_nanos.max(0)) / LATENCY_SLEW;
        let latency = &mut self.config.tracker_latency_nanos;
        *latency += (self.wished_latency - *latency).clamp(-most, most);
    }

    /// What happened so far.
    #[must_use]
    pub fn counts(&self) -> PairingCounts {
        PairingCounts {
            environment_sets: self.environment.generation(),
            incomplete_sets: self.environment.incomplete,
            orphan_brackets: self.environment.orphans,
            ..self.counts
        }
    }

    /// The tracker's history, for poses at other instants.
    #[must_use]
    pub const fn history(&self) -> &PoseHistory {
        &self.history
    }

    /// A picture of the scene camera arrived.
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
        if self.waiting.len() > WAITING {
            self.overdue = self.overdue.max(self.waiting.len() - WAITING);
        }
    }

    /// A picture of the scene camera arrived, and was passed over for newer ones.
    pub fn pass_over(&mut self, arrived_at: MonotonicTime) {
        self.advance(arrived_at);
        self.counts.scene_frames += 1;
    }

    /// A picture of the environment camera arrived.
    pub fn push_environment(&mut self, frame: Frame) {
        self.advance(frame.arrived_at);
        let latency = self.config.environment_latency_nanos;
        let captured_at = frame.captured_at.offset_nanos(latency.saturating_neg());
        self.environment.push(frame, captured_at);
    }

    /// A reading of the tracker arrived.
    pub fn push_pose(&mut self, sample: &PoseSample) {
        self.advance(sample.arrived_at);
        if self.config.station != Some(sample.station) {
            self.counts.other_stations += 1;
            return;
        }
        self.slew_latency(sample.arrived_at.nanos_since(self.heard_at));
        self.heard_at = sample.arrived_at;
        let latency = self.config.tracker_latency_nanos;
        let measured_at = sample.arrived_at.offset_nanos(latency.saturating_neg());
        match self
            .history
            .push(measured_at, sample.transmitter_from_sensor)
        {
            Pushed::Kept | Pushed::Restarted => self.counts.poses += 1,
            Pushed::Invalid | Pushed::Late | Pushed::Outlier => self.counts.rejected_poses += 1,
        }
    }

    /// Says what time it is, where streams may be silent (live, on a timer).
    pub fn advance(&mut self, now: MonotonicTime) {
        let Some(before) = self.now else {
            self.now = Some(now);
            self.heard_at = now;
            return;
        };
        if now.nanos_since(before) < -JUMP_BACK_NANOS {
            self.restart(now);
        } else {
            self.now = Some(before.max(now));
        }
    }

    /// Another time has begun: what waits is handed on, what was remembered is of no use.
    fn restart(&mut self, now: MonotonicTime) {
        for i in 0..self.waiting.len() {
            self.complete(i);
        }
        self.overdue = self.waiting.len();
        self.history.clear();
        self.environment.clear();
        self.now = Some(now);
        self.heard_at = now;
        self.counts.time_jumps += 1;
    }

    /// No more will arrive: nothing waits any longer.
    pub fn finish(&mut self) {
        self.overdue = self.waiting.len();
    }

    /// The next picture, in the order of arrival, that need not wait any longer.
    pub fn pop(&mut self) -> Option<RigFrame> {
        let first = self.waiting.front()?;
        if self.overdue == 0 && !self.ready(first) {
            return None;
        }
        self.complete(0);
        let frame = self.waiting.pop_front()?;
        self.overdue = self.overdue.saturating_sub(1);
        self.count(&frame);
        Some(frame)
    }

    /// When the first waiting picture need not wait any longer, though nothing more
    /// arrives; `None` if none waits.
    #[must_use]
    pub fn deadline(&self) -> Option<MonotonicTime> {
        let first = self.waiting.front()?;
        let arrived_at = first.scene.arrived_at;
        let wait = arrived_at.offset_nanos(self.config.max_wait_nanos);
        let silent = self.heard_at.offset_nanos(self.config.silent_after_nanos);
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

    fn ready(&self, frame: &RigFrame) -> bool {
        self.environment_ready(frame) && self.pose_ready(frame)
    }

    /// Only the very first pictures wait for an environment.
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
            || now.nanos_since(self.heard_at) >= self.config.silent_after_nanos
    }

    /// Gives the picture at `i` what belongs to it, unless it has it already.
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
            let patience = self.config.first_view_wait_nanos;
            let soon = |set: &&Arc<EnvironmentSet>| {
                set.captured_at.nanos_since(captured_at) <= patience && patience > 0
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

/// Poses on both sides of an instant, or before it where nothing later is known.
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
