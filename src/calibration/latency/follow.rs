//! The offset while the rig runs: asked again of the last seconds, and followed.

use super::{
    CameraMotion, CameraTurn, ClockOffset, ImageMotion, LatencyError, Mounted, TrackerTrack,
    from_motion, from_patches, from_rotations,
};
use crate::intrinsics::Grey;
use glam::DQuat;
use penumbra_interface::{MonotonicTime, RigidTransform};
use std::collections::VecDeque;

/// Seconds that are asked at a time.
const WINDOW: f64 = 20.0;
/// Seconds from one asking to the next.
const EVERY: f64 = 5.0;
/// Largest offset that is tried, seconds.
const RANGE: f64 = 0.25;
/// Of the tracker's rotations, seconds to either side.
const SMOOTHING: f64 = 0.02;
/// Pictures farther apart are no neighbours, seconds.
const NEIGHBOURS: f64 = 0.15;
/// No hand turns a camera faster, radians a second: a wrong pose does.
const FASTEST: f64 = 10.0;
/// A tracker that turned by less within the window tells nothing, radians.
const RESTING: f64 = 0.03;
/// How clocks drift: variance of the offset after a second, s². A millisecond after a minute.
const DRIFT: f64 = 1e-6 / 60.0;
/// What is farther off than so many σ is not believed,
const GATE: f64 = 4.0;
/// until so many in a row say the same: more than one window's worth.
const OTHERWISE: u32 = 6;
/// Kept at most of each kind, whatever the stamps say.
const MOST: usize = 20_000;

/// By what an offset was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Means {
    /// Poses by tags or a board.
    Poses,
    /// The pictures' own motion, as a whole.
    Flow,
    /// The same, patch by patch, the camera's mounting known.
    Patches,
}

impl Means {
    /// As it stands in files and in the status.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Poses => "poses",
            Self::Flow | Self::Patches => "image motion",
        }
    }

    /// What both σ leave out, as blur and shutters pull it, seconds: assumed.
    const fn systematic(self) -> f64 {
        match self {
            Self::Poses => 5e-4,
            Self::Flow => 2e-3,
            Self::Patches => 1e-3,
        }
    }
}

/// The offset as it is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// As [`ClockOffset::seconds`].
    pub seconds: f64,
    /// 1σ; it grows while nothing tells.
    pub sigma: f64,
    /// By what it was last corrected.
    pub by: Means,
    /// When.
    pub at: MonotonicTime,
}

/// What is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Followed {
    /// The offset, if anything has told it yet.
    pub measured: Option<Measured>,
    /// Why the newest seconds tell nothing, where they do not.
    pub refusal: Option<LatencyError>,
}

/// Follows the offset. Feed it what arrives, in the order of arrival, and ask
/// [`Self::estimate`] whenever [`Self::due`].
#[derive(Clone, Debug, Default)]
pub struct Follower {
    mounted: Option<Mounted>,
    zero: Option<MonotonicTime>,
    readings: VecDeque<(f64, RigidTransform)>,
    turns: VecDeque<CameraTurn>,
    motions: VecDeque<CameraMotion>,
    flow: ImageMotion,
    last_pose: Option<(f64, DQuat)>,
    last_picture: Option<f64>,
    /// Newest of the camera.
    now: f64,
    asked: f64,
    walk: Walk,
    by: Option<(Means, MonotonicTime)>,
    refusal: Option<LatencyError>,
}

impl Follower {
    /// Of a camera whose place on the sensor may be known.
    #[must_use]
    pub fn new(mounted: Option<Mounted>) -> Self {
        Self {
            mounted,
            ..Self::default()
        }
    }

    /// Time begins anew.
    pub fn restart(&mut self) {
        *self = Self::new(self.mounted.take());
    }

    /// The tracker said so.
    pub fn reading(&mut self, arrived_at: MonotonicTime, transmitter_from_sensor: RigidTransform) {
        let at = self.seconds(arrived_at);
        let RigidTransform {
            rotation,
            translation,
        } = transmitter_from_sensor;
        if rotation.is_finite() && translation.is_finite() {
            keep(&mut self.readings, (at, transmitter_from_sensor), |r| r.0);
        }
    }

    /// The camera stood so in a picture.
    pub fn pose(&mut self, captured_at: MonotonicTime, world_from_camera: DQuat) {
        let to = self.seen(captured_at);
        let before = self.last_pose.replace((to, world_from_camera));
        let Some((from, rotation)) = before.filter(|(from, _)| neighbours(*from, to)) else {
            return;
        };
        let rotation = (rotation.inverse() * world_from_camera).normalize();
        let turn = CameraTurn { from, to, rotation };
        let angle = super::shortest(rotation).to_scaled_axis().length();
        if angle < FASTEST * (to - from) {
            keep(&mut self.turns, turn, |t| t.to);
        }
    }

    /// A picture without a pose; small ones are enough.
    pub fn picture(&mut self, captured_at: MonotonicTime, picture: &Grey) {
        let to = self.seen(captured_at);
        let flow = self.flow.next(picture);
        let before = self.last_picture.replace(to);
        if let (Some(flow), Some(from)) = (flow, before)
            && neighbours(from, to)
        {
            keep(&mut self.motions, CameraMotion { from, to, flow }, |m| m.to);
        }
    }

    /// Whether enough is new.
    #[must_use]
    pub fn due(&self) -> bool {
        self.now - self.asked >= EVERY
    }

    /// What the last seconds say, taken into what was known before.
    pub fn estimate(&mut self) -> Followed {
        let new = self.now - std::mem::replace(&mut self.asked, self.now);
        if new > 0.0 {
            self.trim();
            self.walk.wait(new);
            match self.ask() {
                Ok((found, means)) => {
                    let share = (new / WINDOW).min(1.0);
                    let believed = self.walk.take(&found, means.systematic(), share);
                    self.by = self.zero.filter(|_| believed).map_or(self.by, |zero| {
                        Some((means, zero.offset_nanos((self.now * 1e9) as i64)))
                    });
                    self.refusal = None;
                }
                Err(refusal) => self.refusal = Some(refusal),
            }
        }
        self.known()
    }

    /// As [`Self::estimate`] last said.
    #[must_use]
    pub fn known(&self) -> Followed {
        let offset = self.walk.offset.zip(self.by);
        Followed {
            measured: offset.map(|((seconds, variance), (by, at))| Measured {
                seconds,
                sigma: variance.sqrt().hypot(by.systematic()),
                by,
                at,
            }),
            refusal: self.refusal,
        }
    }

    fn ask(&self) -> Result<(ClockOffset, Means), LatencyError> {
        if self.rests() {
            return Err(LatencyError::AtRest);
        }
        let track = TrackerTrack::of_poses(self.readings.iter().copied(), SMOOTHING);
        let turns: Vec<CameraTurn> = self.turns.iter().copied().collect();
        let motions: Vec<CameraMotion> = self.motions.iter().copied().collect();
        let poses = from_rotations(&track, &turns, RANGE).map(|found| (found, Means::Poses));
        poses.or_else(|refusal| {
            let flow = by_motion(&track, &motions, self.mounted.as_ref(), RANGE);
            // What is said of poses says more, where there are enough of them.
            flow.map_err(|of_flow| match refusal {
                LatencyError::TooShort { .. } => of_flow,
                _ => refusal,
            })
        })
    }

    fn rests(&self) -> bool {
        let Some((_, first)) = self.readings.front() else {
            return false;
        };
        let angle = |pose: &RigidTransform| {
            super::shortest(first.rotation.inverse() * pose.rotation)
                .to_scaled_axis()
                .length()
        };
        self.readings.iter().all(|(_, pose)| angle(pose) < RESTING)
    }

    fn trim(&mut self) {
        let oldest = self.now - WINDOW;
        // Beside the oldest picture the tracker is asked earlier, too.
        drop_before(&mut self.readings, oldest - RANGE, |r| r.0);
        drop_before(&mut self.turns, oldest, |t| t.from);
        drop_before(&mut self.motions, oldest, |m| m.from);
    }

    fn seen(&mut self, captured_at: MonotonicTime) -> f64 {
        self.now = self.now.max(self.seconds(captured_at));
        self.seconds(captured_at)
    }

    fn seconds(&mut self, at: MonotonicTime) -> f64 {
        at.seconds_since(*self.zero.get_or_insert(at))
    }
}

/// By the pictures' own motion: with the camera's mounting, if it is known and does not contradict what
/// is found without.
///
/// # Errors
/// As [`super::from_rotations`].
pub fn by_motion(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    mounted: Option<&Mounted>,
    range: f64,
) -> Result<(ClockOffset, Means), LatencyError> {
    let whole = from_motion(track, motions, range).map(|found| (found, Means::Flow));
    let patches = mounted.and_then(|m| from_patches(track, motions, m, range).ok());
    let patches = patches.map(|found| (found, Means::Patches));
    let sigma = |(found, means): &(ClockOffset, Means)| found.sigma.hypot(means.systematic());
    match (whole, patches) {
        (Ok(whole), Some(patches)) => {
            let apart = (whole.0.seconds - patches.0.seconds).abs();
            let agree = apart < GATE * sigma(&whole).hypot(sigma(&patches));
            let finer = agree && sigma(&patches) < sigma(&whole);
            Ok(if finer { patches } else { whole })
        }
        (whole, patches) => whole.or_else(|why| patches.ok_or(why)),
    }
}

fn neighbours(from: f64, to: f64) -> bool {
    to > from && to - from < NEIGHBOURS
}

/// Adds what is newer than the last.
fn keep<T>(kept: &mut VecDeque<T>, new: T, time: impl Fn(&T) -> f64) {
    if kept.back().is_some_and(|last| time(last) >= time(&new)) {
        return;
    }
    if kept.len() == MOST {
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
// │ in one dimension). Of a window that overlaps the one before, only a share is news: its      │
// └ variance counts σ² / share.                                                                 ┘
#[derive(Clone, Debug, Default)]
struct Walk {
    /// It, and its variance.
    offset: Option<(f64, f64)>,
    /// The last that was not believed, and how many before it said the same.
    other: Option<(f64, u32)>,
}

impl Walk {
    fn wait(&mut self, seconds: f64) {
        if let Some((_, variance)) = &mut self.offset {
            *variance += DRIFT * seconds;
        }
    }

    /// Whether it was believed.
    fn take(&mut self, found: &ClockOffset, systematic: f64, share: f64) -> bool {
        let (z, own) = (found.seconds, found.sigma * found.sigma);
        let Some((x, variance)) = self.offset else {
            self.offset = Some((z, own));
            return true;
        };
        let of_window = own / share;
        let gate = GATE * (variance + of_window + systematic * systematic).sqrt();
        if (z - x).abs() > gate {
            let near = |last: f64| (z - last).abs() < gate;
            let before = self.other.filter(|(last, _)| near(*last));
            let count = before.map_or(0, |(_, count)| count) + 1;
            self.other = Some((z, count));
            if count < OTHERWISE {
                return false;
            }
            self.offset = Some((z, own));
        } else {
            let gain = variance / (variance + of_window);
            self.offset = Some((x + gain * (z - x), (1.0 - gain) * variance));
        }
        self.other = None;
        true
    }
}

#[cfg(test)]
mod tests;
