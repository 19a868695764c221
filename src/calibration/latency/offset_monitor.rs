//! Tracks the offset while the rig runs: estimates it again from the last seconds, and filters.

use super::image_based::{OffsetMethod, from_image_motion};
use super::image_motion::ImageMotion;
use super::model::{CameraMotion, CameraRotation, ClockOffset, LatencyError};
use super::mounted::MountedCamera;
use super::rotations::from_rotations;
use super::track::TrackerTrack;
use crate::intrinsics::Grey;
use glam::DQuat;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::rotation_vector;
use std::collections::VecDeque;

/// Length of the record that an estimate uses, seconds.
const WINDOW: f64 = 20.0;
/// Interval between estimates, seconds.
const INTERVAL: f64 = 5.0;
/// Maximum offset that is searched, seconds.
const MAX_OFFSET: f64 = 0.25;
/// Half-width of the window that smooths the tracker's rotations, seconds.
const SMOOTHING: f64 = 0.02;
/// Maximum interval between successive pictures, seconds.
const MAX_GAP: f64 = 0.15;
/// Maximum angular speed of a hand-held camera, radians per second; faster poses are wrong.
const MAX_SPEED: f64 = 10.0;
/// Minimum rotation of the tracker within the window, radians.
const MIN_ROTATION: f64 = 0.03;
/// Drift of the clocks: increase of the offset's variance per second, s². One millisecond after a
/// minute.
const DRIFT: f64 = 1e-6 / 60.0;
/// Maximum deviation of an estimate that is accepted, σ.
const GATE: f64 = 4.0;
/// Number of successive consistent estimates after which a rejected offset is accepted: more than a
/// window holds.
const MIN_REPEATS: u32 = 6;
/// Maximum number of items kept of each kind, whatever their time stamps.
const MAX_ITEMS: usize = 20_000;

/// The filtered offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilteredOffset {
    /// As [`ClockOffset::seconds`].
    pub seconds: f64,
    /// 1σ, seconds; it grows while there are no new estimates.
    pub sigma: f64,
    /// Method of the last estimate.
    pub method: OffsetMethod,
    /// Time of the last estimate.
    pub estimated_at: MonotonicTime,
}

/// State of the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OffsetState {
    /// The offset; `None` before the first estimate.
    pub offset: Option<FilteredOffset>,
    /// Why the last seconds yielded no estimate, if they did not.
    pub refusal: Option<LatencyError>,
}

/// Tracks the offset. Pass readings, poses and pictures in the order of arrival, and call
/// [`Self::estimate`] whenever [`Self::is_due`].
#[derive(Clone, Debug, Default)]
pub struct OffsetMonitor {
    mounted: Option<MountedCamera>,
    zero: Option<MonotonicTime>,
    readings: VecDeque<(f64, RigidTransform)>,
    rotations: VecDeque<CameraRotation>,
    motions: VecDeque<CameraMotion>,
    flow: ImageMotion,
    last_pose: Option<(f64, DQuat)>,
    last_picture: Option<f64>,
    /// Newest time stamp of the camera.
    now: f64,
    last_estimate: f64,
    filter: OffsetFilter,
    /// Method and time of the last accepted estimate.
    accepted: Option<(OffsetMethod, MonotonicTime)>,
    refusal: Option<LatencyError>,
}

impl OffsetMonitor {
    /// Creates a monitor for a camera whose mounting may be known.
    #[must_use]
    pub fn new(mounted: Option<MountedCamera>) -> Self {
        Self {
            mounted,
            ..Self::default()
        }
    }

    /// Discards everything but the mounting, as after a restart of a session.
    pub fn restart(&mut self) {
        *self = Self::new(self.mounted.take());
    }

    /// Adds a reading of the tracker.
    pub fn add_reading(
        &mut self,
        arrived_at: MonotonicTime,
        transmitter_from_sensor: RigidTransform,
    ) {
        let at = self.seconds(arrived_at);
        let RigidTransform {
            rotation,
            translation,
        } = transmitter_from_sensor;
        if rotation.is_finite() && translation.is_finite() {
            keep(&mut self.readings, (at, transmitter_from_sensor), |r| r.0);
        }
    }

    /// Adds the camera's orientation in a picture.
    pub fn add_pose(&mut self, captured_at: MonotonicTime, world_from_camera: DQuat) {
        let to = self.advance(captured_at);
        let before = self.last_pose.replace((to, world_from_camera));
        let Some((from, rotation)) = before.filter(|(from, _)| are_successive(*from, to)) else {
            return;
        };
        let rotation = (rotation.inverse() * world_from_camera).normalize();
        if rotation_vector(rotation).length() < MAX_SPEED * (to - from) {
            let rotation = CameraRotation { from, to, rotation };
            keep(&mut self.rotations, rotation, |r| r.to);
        }
    }

    /// Adds a picture without a pose; a reduced copy suffices.
    pub fn add_picture(&mut self, captured_at: MonotonicTime, picture: &Grey) {
        let to = self.advance(captured_at);
        let flow = self.flow.next(picture);
        let before = self.last_picture.replace(to);
        if let (Some(flow), Some(from)) = (flow, before)
            && are_successive(from, to)
        {
            keep(&mut self.motions, CameraMotion { from, to, flow }, |m| m.to);
        }
    }

    /// Returns whether enough new pictures have arrived for another estimate.
    #[must_use]
    pub fn is_due(&self) -> bool {
        self.now - self.last_estimate >= INTERVAL
    }

    /// Estimates the offset from the last seconds and filters it.
    pub fn estimate(&mut self) -> OffsetState {
        let new = self.now - std::mem::replace(&mut self.last_estimate, self.now);
        if new > 0.0 {
            self.trim();
            self.filter.predict(new);
            match self.estimate_window() {
                Ok((found, method)) => {
                    let share = (new / WINDOW).min(1.0);
                    let accepted = self.filter.update(&found, method.systematic(), share);
                    self.accepted = self
                        .zero
                        .filter(|_| accepted)
                        .map_or(self.accepted, |zero| {
                            Some((method, zero.offset_nanos((self.now * 1e9) as i64)))
                        });
                    self.refusal = None;
                }
                Err(refusal) => self.refusal = Some(refusal),
            }
        }
        self.state()
    }

    /// Returns the result of the last [`Self::estimate`].
    #[must_use]
    pub fn state(&self) -> OffsetState {
        let offset = self.filter.offset.zip(self.accepted);
        OffsetState {
            offset: offset.map(|((seconds, variance), (method, at))| FilteredOffset {
                seconds,
                sigma: variance.sqrt().hypot(method.systematic()),
                method,
                estimated_at: at,
            }),
            refusal: self.refusal,
        }
    }

    fn estimate_window(&self) -> Result<(ClockOffset, OffsetMethod), LatencyError> {
        if self.is_at_rest() {
            return Err(LatencyError::AtRest);
        }
        let track = TrackerTrack::from_poses(self.readings.iter().copied(), SMOOTHING);
        let rotations: Vec<CameraRotation> = self.rotations.iter().copied().collect();
        let motions: Vec<CameraMotion> = self.motions.iter().copied().collect();
        let by_poses = from_rotations(&track, &rotations, MAX_OFFSET)
            .map(|found| (found, OffsetMethod::Poses));
        by_poses.or_else(|pose_error| {
            let flow = from_image_motion(&track, &motions, self.mounted.as_ref(), MAX_OFFSET);
            // The error of the poses is more useful, where there are enough of them.
            flow.map_err(|flow_error| match pose_error {
                LatencyError::TooShort { .. } => flow_error,
                _ => pose_error,
            })
        })
    }

    fn is_at_rest(&self) -> bool {
        let Some((_, first)) = self.readings.front() else {
            return false;
        };
        let angle = |pose: &RigidTransform| {
            rotation_vector(first.rotation.inverse() * pose.rotation).length()
        };
        self.readings
            .iter()
            .all(|(_, pose)| angle(pose) < MIN_ROTATION)
    }

    fn trim(&mut self) {
        let oldest = self.now - WINDOW;
        // Negative offsets need readings from before the oldest picture.
        drop_before(&mut self.readings, oldest - MAX_OFFSET, |r| r.0);
        drop_before(&mut self.rotations, oldest, |r| r.from);
        drop_before(&mut self.motions, oldest, |m| m.from);
    }

    /// Advances the time to a picture's and returns it, seconds.
    fn advance(&mut self, captured_at: MonotonicTime) -> f64 {
        self.now = self.now.max(self.seconds(captured_at));
        self.seconds(captured_at)
    }

    fn seconds(&mut self, at: MonotonicTime) -> f64 {
        at.seconds_since(*self.zero.get_or_insert(at))
    }
}

fn are_successive(from: f64, to: f64) -> bool {
    to > from && to - from < MAX_GAP
}

/// Adds an item if it is newer than the last.
fn keep<T>(kept: &mut VecDeque<T>, new: T, time: impl Fn(&T) -> f64) {
    if kept.back().is_some_and(|last| time(last) >= time(&new)) {
        return;
    }
    if kept.len() == MAX_ITEMS {
        kept.pop_front();
    }
    kept.push_back(new);
}

fn drop_before<T>(kept: &mut VecDeque<T>, oldest: f64, time: impl Fn(&T) -> f64) {
    while kept.front().is_some_and(|first| time(first) < oldest) {
        kept.pop_front();
    }
}

// ┌ A random walk x with variance DRIFT per second, measured as z with variance σ² (Kalman 1960 ┐
// │ in one dimension). Of a window that overlaps the one before, only a share is new: its       │
// └ variance counts as σ² / share.                                                              ┘
#[derive(Clone, Debug, Default)]
struct OffsetFilter {
    /// Offset (seconds) and variance (s²).
    offset: Option<(f64, f64)>,
    /// The last rejected measurement, and the number of successive ones consistent with it.
    rejected: Option<(f64, u32)>,
}

impl OffsetFilter {
    fn predict(&mut self, seconds: f64) {
        if let Some((_, variance)) = &mut self.offset {
            *variance += DRIFT * seconds;
        }
    }

    /// Returns whether the measurement was accepted.
    fn update(&mut self, found: &ClockOffset, systematic: f64, share: f64) -> bool {
        let (z, own) = (found.seconds, found.sigma * found.sigma);
        let Some((x, variance)) = self.offset else {
            self.offset = Some((z, own));
            return true;
        };
        let window_variance = own / share;
        let gate = GATE * (variance + window_variance + systematic * systematic).sqrt();
        if (z - x).abs() > gate {
            let near = |last: f64| (z - last).abs() < gate;
            let before = self.rejected.filter(|(last, _)| near(*last));
            let count = before.map_or(0, |(_, count)| count) + 1;
            self.rejected = Some((z, count));
            if count < MIN_REPEATS {
                return false;
            }
            self.offset = Some((z, own));
        } else {
            let gain = variance / (variance + window_variance);
            self.offset = Some((x + gain * (z - x), (1.0 - gain) * variance));
        }
        self.rejected = None;
        true
    }
}

#[cfg(test)]
mod tests;
