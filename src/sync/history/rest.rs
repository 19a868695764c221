//! The pose of a sensor at rest: the mean of readings over a much longer time.
//!
//! What the tracker's noise leaves after smoothing makes virtual objects tremble against a picture
//! that stands still. So the pose follows the mean over longer and longer windows, as long as each
//! mean differs from all results before by no more than their noise (as the windows of the smoothing
//! do; Goldenshluger & Nemirovski 1997). What it may lag behind a slow motion is bounded by the same
//! noise. The transition is gradual, so that nothing jumps where a motion begins.

use super::{PoseHistory, angle};
use crate::fit::{Fit, mean, noise_variance};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::smoothstep;

/// Lengths of the windows before the instant, in half windows of the smoothing.
const LENGTHS: [i64; 4] = [2, 4, 8, 16];
/// Difference from a shorter window's result up to which the sensor rests, and from which it moves;
/// standard deviations of that result over all axes.
const REST_TO_MOTION: (f64, f64) = (2.0, 4.0);
/// Share of its length over which a window must hold readings.
const MIN_FILLED: f64 = 0.8;

/// A pose with the variances of its noise, metres² and radians².
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    pub pose: RigidTransform,
    pub variance: [f64; 2],
}

impl Estimate {
    pub(super) fn of(fit: &Fit, noise: [f64; 2]) -> Self {
        Self {
            pose: fit.pose,
            variance: noise.map(|variance| fit.noise_gain * variance),
        }
    }

    /// Distance of `other`, in standard deviations of this estimate; a tolerance keeps a stream
    /// without noise at rest.
    fn departure(&self, other: &Self) -> f64 {
        let [moved, turned] = self.variance.map(|variance| variance.sqrt() + 1e-6);
        let distance = self.pose.translation.distance(other.pose.translation);
        (distance / moved).max(angle(&self.pose, &other.pose) / turned)
    }

    /// The pose at `share` of the way to `other`, with the variances between.
    fn toward(&self, other: &Self, share: f64) -> Self {
        let (from, to) = (self.pose, other.pose);
        Self {
            pose: RigidTransform::new(
                from.rotation.slerp(to.rotation, share),
                from.translation.lerp(to.translation, share),
            ),
            variance: [0, 1].map(|k| {
                let (a, b) = (self.variance[k], other.variance[k]);
                a + share * (b - a)
            }),
        }
    }
}

impl PoseHistory {
    /// Returns `local`, an estimate of the pose at `time` from the readings around it, improved by
    /// those since many times `half_window` nanoseconds before, where the sensor rests; and how much
    /// it rests, from 0 to 1. Readings after `newest` are ignored.
    pub(super) fn at_rest(
        &self,
        (time, newest): (MonotonicTime, MonotonicTime),
        half_window: i64,
        local: Estimate,
    ) -> (Estimate, f64) {
        let end = time.offset_nanos(half_window).min(newest);
        let mut known = [local; LENGTHS.len()];
        let (mut best, mut share, mut rest) = (local, 1.0_f64, 0.0_f64);
        for (count, length) in (1..).zip(LENGTHS) {
            let Some(wide) = self.mean_over((time, end), length * half_window, &local) else {
                break;
            };
            let departures = known[..count].iter().map(|k| k.departure(&wide));
            let departure = departures.fold(0.0, f64::max);
            let (low, high) = REST_TO_MOTION;
            share = share.min(1.0 - smoothstep(low, high, departure));
            if share <= 0.0 {
                break;
            }
            best = best.toward(&wide, share);
            rest = rest.max(share);
            if let Some(next) = known.get_mut(count) {
                *next = wide;
            }
        }
        (best, rest)
    }

    /// The mean of the readings from `length` nanoseconds before `time` up to `newest`; `None` where
    /// they do not reach back as far.
    fn mean_over(
        &self,
        (time, newest): (MonotonicTime, MonotonicTime),
        length: i64,
        near: &Estimate,
    ) -> Option<Estimate> {
        let readings = self.samples_between(time.offset_nanos(-length), newest);
        let oldest = readings.clone().next()?;
        let reach = time.nanos_since(oldest.measured_at) as f64;
        if reach < MIN_FILLED * length as f64 {
            return None;
        }
        let noise = noise_variance(readings.clone().map(|s| s.relative_pose(time)))?;
        let fit = mean(readings.map(|s| &s.pose), near.pose.rotation)?;
        Some(Estimate::of(&fit, noise))
    }
}
