//! The mean of the tracker's poses relative to those by landmarks, and the tracker's noise.

use crate::TrackerPose;
use crate::motion::{difference, moved};
use glam::DVec3;
use penumbra_interface::RigidTransform;

/// Factor of the tracker's stated standard deviations: what remains of its noise after smoothing is
/// correlated from picture to picture.
const STATED_FACTOR: f64 = 2.0;
/// Smallest standard deviations: radians, metres.
const MIN_SIGMAS: [f64; 2] = [1e-4, 1e-4];
/// Standard deviation of the time offset of tracker and picture, seconds. It only matters while the
/// camera moves.
const TIMING_SIGMA_SECONDS: f64 = 0.001;
/// Time over which the tracker's poses are averaged, seconds.
const MEMORY_SECONDS: f64 = 2.0;
/// Share of a picture in the recent mean of the departures, and the square of its length, variances, from
/// which it isn't noise and the memory becomes shorter: the known surfaces are not where they are, or
/// the tracker's error changes.
const BIAS_SHARE: f64 = 0.1;
const MAX_BIAS: f64 = 0.5;
/// How much shorter, for each variance.
const SHORTENING: f64 = 20.0;
/// Largest distance of the mean from the tracker's pose, standard deviations over all six axes, of
/// which normal noise exceeds one in a hundred thousand. What is larger is an error that changes, such
/// as the distortion of an electromagnetic field, and is followed.
const MAX_DEPARTURE: f64 = 5.7;
/// Share of a picture in the learned variance, and the largest step that is believed, variances.
const LEARNING_SHARE: f64 = 0.2;
const MAX_SQUARE: f64 = 25.0;
/// Largest factor on the variances.
const MAX_EXCESS: f64 = 400.0;

/// The tracker's error, common to the pictures since the landmarks were made.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrackerMean {
    /// G: `world_from_map`.
    world_from_map: RigidTransform,
    /// Pictures in the mean.
    count: u32,
    /// Factor on the variances, learned from the steps of the tracker's error.
    excess: f64,
    /// Recent mean of the departures of the tracker's pose (rotation, translation), standard deviations.
    bias: [DVec3; 2],
    /// The last departure, standard deviations by the statement.
    last: Option<[f64; 6]>,
}

impl TrackerMean {
    pub const fn new() -> Self {
        Self {
            world_from_map: RigidTransform::IDENTITY,
            count: 1,
            excess: 1.0,
            bias: [DVec3::ZERO; 2],
            last: None,
        }
    }

    /// Begins with new landmarks, made from the tracker's pose.
    pub fn restart(&mut self) {
        *self = Self {
            excess: self.excess,
            ..Self::new()
        };
    }

    /// The pose of the map that is expected: G⁻¹ · tracked.
    pub fn expected(&self, tracked: RigidTransform) -> RigidTransform {
        self.world_from_map.inverse() * tracked
    }

    /// The pose in the world: G · V.
    pub fn apply(&self, by_landmarks: RigidTransform) -> RigidTransform {
        self.world_from_map * by_landmarks
    }

    /// Standard deviations per axis of the tracker's pose (radians, metres) at a camera's speed (radians
    /// and metres per second).
    pub fn sigmas(&self, tracked: &TrackerPose, speed: [f64; 2]) -> [f64; 2] {
        stated(tracked, speed).map(|sigma| sigma * self.excess.sqrt())
    }

    /// Learns the tracker's noise from the departure `x` (rotation vector and translation) of a
    /// picture's pose by landmarks from the expected one. Its steps are noise, its mean is not.
    pub fn learn(&mut self, x: &[f64; 6], tracked: &TrackerPose, speed: [f64; 2]) {
        let sigmas = stated(tracked, speed);
        let now: [f64; 6] = std::array::from_fn(|i| x[i] / sigmas[i / 3]);
        if let Some(last) = self.last.replace(now) {
            let steps = now.iter().zip(last).map(|(now, last)| (now - last).powi(2));
            let square = (steps.sum::<f64>() / 12.0).min(MAX_SQUARE * self.excess);
            let excess = self.excess + LEARNING_SHARE * (square - self.excess);
            self.excess = excess.clamp(1.0, MAX_EXCESS);
        }
    }

    /// Moves G by this picture's share towards tracked · V⁻¹; `sigmas` as by [`Self::sigmas`].
    pub fn average(
        &mut self,
        by_landmarks: RigidTransform,
        tracked: RigidTransform,
        sigmas: [f64; 2],
        seconds: f64,
    ) {
        self.count = self.count.saturating_add(1);
        let now = self.apply(by_landmarks);
        let (rotation, translation) = difference(&now, &tracked);
        let departure = [rotation / sigmas[0], translation / sigmas[1]];
        for (bias, now) in self.bias.iter_mut().zip(departure) {
            *bias += BIAS_SHARE * (now - *bias);
        }
        let length = |[a, b]: [DVec3; 2]| a.length_squared() + b.length_squared();
        let excess = (length(self.bias) - MAX_BIAS).max(0.0);
        let memory = MEMORY_SECONDS / (1.0 + SHORTENING * excess);
        let limit = 1.0 - MAX_DEPARTURE / length(departure).sqrt().max(1e-9);
        let share = f64::from(self.count)
            .recip()
            .max(seconds / memory)
            .max(limit)
            .min(1.0);
        let averaged = moved(now, rotation * share, translation * share);
        self.world_from_map = averaged * by_landmarks.inverse();
    }
}

/// Standard deviations per axis as the tracker states them, with the error of its timing: radians,
/// metres.
fn stated(tracked: &TrackerPose, speed: [f64; 2]) -> [f64; 2] {
    let [metres, radians] = tracked.noise;
    let noise = [radians, metres];
    std::array::from_fn(|i| {
        let sigma = (STATED_FACTOR * noise[i]).max(MIN_SIGMAS[i]);
        sigma.hypot(speed[i] * TIMING_SIGMA_SECONDS)
    })
}
