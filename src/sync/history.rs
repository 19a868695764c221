//! The pose history of a tracked sensor: readings, and poses between them. `forecast` predicts poses
//! beyond the newest reading, `rest` steadies those of a sensor that does not move.

mod forecast;
mod rest;

use super::fit::{Degree, Fit, Reading, noise_variance, value_at_zero};
use forecast::ErrorHistory;
use glam::{DQuat, DVec3};
use penumbra_interface::{MonotonicTime, RigidTransform};
use rest::Estimate;
use std::collections::VecDeque;

/// How the pose at an instant is computed from readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Smoothing {
    /// Interpolation between the two neighbours (linear, spherical linear), which keeps all of the
    /// tracker's noise.
    None,
    /// Local least squares through the readings around the instant.
    Local {
        /// Half the maximum window, nanoseconds. Fast motion narrows it.
        half_window_nanos: i64,
        /// Degree of the polynomial where there are readings on both sides of the instant.
        degree: Degree,
    },
}

/// Settings of a [`PoseHistory`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryConfig {
    /// Maximum number of readings; the oldest are dropped.
    pub capacity: usize,
    /// See [`Smoothing`].
    pub smoothing: Smoothing,
    /// Maximum gap between readings for interpolation, nanoseconds.
    pub max_gap_nanos: i64,
    /// Maximum length of a prediction beyond the newest reading, nanoseconds.
    pub max_prediction_nanos: i64,
    /// Time stamps that go back by more than this restart the history, nanoseconds.
    pub jump_back_nanos: i64,
    /// Maximum speed of a hand-held sensor, metres per second.
    pub max_speed: f64,
    /// Maximum angular speed of a hand-held sensor, radians per second.
    pub max_turn_rate: f64,
    /// Maximum acceleration of a hand-held sensor, m/s².
    pub max_acceleration: f64,
    /// Maximum angular acceleration of a hand-held sensor, rad/s².
    pub max_turn_acceleration: f64,
}

impl Default for HistoryConfig {
    fn default() -> Self {
        Self {
            capacity: 1024,
            smoothing: Smoothing::Local {
                half_window_nanos: 100_000_000,
                degree: Degree::Quadratic,
            },
            max_gap_nanos: 100_000_000,
            max_prediction_nanos: 100_000_000,
            jump_back_nanos: 500_000_000,
            max_speed: 10.0,
            max_turn_rate: 25.0,
            max_acceleration: 60.0,
            max_turn_acceleration: 600.0,
        }
    }
}

/// How a pose was determined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Provenance {
    /// There is a reading at the instant.
    Exact,
    /// There are readings before and after.
    Interpolated,
    /// There are only readings before.
    Predicted,
}

/// The pose of the sensor at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseAt {
    /// `transmitter_from_sensor`, metres.
    pub transmitter_from_sensor: RigidTransform,
    /// How it was determined.
    pub provenance: Provenance,
    /// Time between the instant and the nearest reading, nanoseconds.
    pub age_nanos: i64,
    /// Standard deviations over all axes, metres and radians: between readings from their noise, of
    /// a prediction from the errors of recent predictions of equal length. `None` until there are
    /// enough readings. Systematic errors of the tracker are not included.
    pub sigma: Option<[f64; 2]>,
}

/// Result of adding a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// The reading was added.
    Kept,
    /// The reading is not finite or has no unit quaternion.
    Invalid,
    /// The reading is not newer than the newest one.
    Late,
    /// The reading is too far from the previous one; rejected unless the next ones are consistent with it.
    Outlier,
    /// Time or position jumped; the history restarts with this reading.
    Restarted,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    measured_at: MonotonicTime,
    pose: RigidTransform,
}

impl Sample {
    /// The time since `time`, seconds, and the pose.
    fn relative_pose(&self, time: MonotonicTime) -> (f64, &RigidTransform) {
        (self.measured_at.seconds_since(time), &self.pose)
    }
}

/// Number of successive consistent outliers that restart the history.
const MIN_CONSISTENT_OUTLIERS: u32 = 4;
/// Tolerance of the speed limits for noise and quantisation: metres and radians.
const SLACK: (f64, f64) = (0.01, 0.02);
/// Time over which the velocity before a reading is measured, minimum and maximum, seconds.
const MOTION_SECONDS: (f64, f64) = (0.02, 0.06);
/// Uncertainty of a reading's time, seconds: trackers are stamped on arrival.
const JITTER_SECONDS: f64 = 0.008;
/// Minimum number of readings on each side for the configured degree.
const MIN_READINGS_PER_SIDE: usize = 2;
/// Maximum deviation of a wider window's result, standard deviations.
const MAX_DEVIATION_SIGMAS: f64 = 2.0;

/// The recent readings of one station, in order of time. Does not allocate after `new`.
#[derive(Clone, Debug)]
pub struct PoseHistory {
    config: HistoryConfig,
    samples: VecDeque<Sample>,
    outlier: Option<Sample>,
    consistent_outliers: u32,
    errors: ErrorHistory,
}

impl PoseHistory {
    /// Creates an empty history.
    #[must_use]
    pub fn new(config: HistoryConfig) -> Self {
        Self {
            config,
            samples: VecDeque::with_capacity(config.capacity.max(2)),
            outlier: None,
            consistent_outliers: 0,
            errors: ErrorHistory::default(),
        }
    }

    /// Number of readings.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Returns whether there are no readings.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Time of the newest reading.
    #[must_use]
    pub fn newest(&self) -> Option<MonotonicTime> {
        self.samples.back().map(|sample| sample.measured_at)
    }

    /// Time of the first reading at or after an instant.
    #[must_use]
    pub fn first_since(&self, time: MonotonicTime) -> Option<MonotonicTime> {
        let before = self.samples.partition_point(|s| s.measured_at < time);
        self.samples.get(before).map(|sample| sample.measured_at)
    }

    /// Removes all readings.
    pub fn clear(&mut self) {
        self.samples.clear();
        self.outlier = None;
        self.consistent_outliers = 0;
        self.errors.restart();
    }

    /// Adds a reading.
    pub fn push(&mut self, measured_at: MonotonicTime, pose: RigidTransform) -> Pushed {
        let unit = (pose.rotation.length() - 1.0).abs() < 1e-3;
        if !pose.translation.is_finite() || !pose.rotation.is_finite() || !unit {
            return Pushed::Invalid;
        }
        let sample = Sample { measured_at, pose };
        let Some(newest) = self.samples.back().copied() else {
            return self.keep(sample, Pushed::Kept);
        };
        let step = measured_at.nanos_since(newest.measured_at);
        if step < -self.config.jump_back_nanos {
            self.clear();
            return self.keep(sample, Pushed::Restarted);
        }
        if step <= 0 {
            return Pushed::Late;
        }
        if self.is_possible(&newest, &sample) && self.continues(&newest, &sample) {
            self.learn(&sample);
            return self.keep(sample, Pushed::Kept);
        }
        self.reject(sample)
    }

    /// Rejects an outlier. After enough successive consistent outliers, restarts the history instead.
    fn reject(&mut self, sample: Sample) -> Pushed {
        let is_consistent = self.outlier.is_some_and(|outlier| {
            sample.measured_at > outlier.measured_at && self.is_possible(&outlier, &sample)
        });
        let consistent = if is_consistent {
            self.consistent_outliers
        } else {
            0
        };
        self.consistent_outliers = consistent + 1;
        self.outlier = Some(sample);
        if self.consistent_outliers < MIN_CONSISTENT_OUTLIERS {
            return Pushed::Outlier;
        }
        self.clear();
        self.keep(sample, Pushed::Restarted)
    }

    fn keep(&mut self, sample: Sample, outcome: Pushed) -> Pushed {
        if self.samples.len() >= self.config.capacity.max(2) {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
        self.outlier = None;
        self.consistent_outliers = 0;
        outcome
    }

    /// Returns whether a hand can move the sensor from one reading to the other.
    fn is_possible(&self, from: &Sample, to: &Sample) -> bool {
        let seconds = to.measured_at.seconds_since(from.measured_at);
        let moved = from.pose.translation.distance(to.pose.translation);
        let turned = angle(&from.pose, &to.pose);
        moved <= self.config.max_speed * seconds + SLACK.0
            && turned <= self.config.max_turn_rate * seconds + SLACK.1
    }

    /// Returns whether a hand can move the sensor from its recent motion to a reading.
    ///
    /// ```text
    ///   mean velocity v over Δ before the newest reading; h later, at acceleration a:
    ///   |p − (p_newest + v·h)| ≤ a·h·(Δ + h)/2
    /// ```
    /// Far closer than the speed alone: at 120 Hz it is a tenth of it.
    fn continues(&self, newest: &Sample, sample: &Sample) -> bool {
        let since = |s: &Sample| newest.measured_at.seconds_since(s.measured_at);
        let earlier = self
            .samples
            .iter()
            .rev()
            .find(|s| since(s) >= MOTION_SECONDS.0);
        let ahead = sample.measured_at.seconds_since(newest.measured_at);
        let Some(earlier) = earlier.filter(|s| since(s) <= MOTION_SECONDS.1) else {
            return true;
        };
        let base = since(earlier);
        let share = ahead / base;
        let moved = newest.pose.translation - earlier.pose.translation;
        let turned = scaled_axis(earlier.pose.rotation.inverse() * newest.pose.rotation);
        let expected = RigidTransform::new(
            newest.pose.rotation * DQuat::from_scaled_axis(turned * share),
            newest.pose.translation + moved * share,
        );
        let reach = 0.5 * ahead * (base + ahead);
        let off = expected.translation.distance(sample.pose.translation);
        let turned_off = angle(&expected, &sample.pose);
        let jitter = JITTER_SECONDS / base;
        off <= SLACK.0 + self.config.max_acceleration * reach + moved.length() * jitter
            && turned_off
                <= SLACK.1 + self.config.max_turn_acceleration * reach + turned.length() * jitter
    }

    /// Returns the pose at an instant; `None` before the first reading, in a gap, and too long after
    /// the last reading.
    #[must_use]
    pub fn at(&self, time: MonotonicTime) -> Option<PoseAt> {
        let after = self.samples.partition_point(|s| s.measured_at < time);
        let next = self.samples.get(after);
        let previous = after.checked_sub(1).and_then(|i| self.samples.get(i));
        match (previous, next) {
            (_, Some(next)) if next.measured_at == time => {
                Some(self.between(time, next, next, Provenance::Exact))
            }
            (Some(previous), Some(next)) => {
                let gap = next.measured_at.nanos_since(previous.measured_at);
                if gap <= self.config.max_gap_nanos {
                    Some(self.between(time, previous, next, Provenance::Interpolated))
                } else {
                    self.predict(time, after, self.config.max_prediction_nanos)
                }
            }
            (Some(_), None) => self.predict(time, after, self.config.max_prediction_nanos),
            (None, _) => None,
        }
    }

    /// Returns the pose at an instant as predicted when `known` was the newest reading: later ones
    /// are ignored. `None` if that is more than `max_age_nanos` before the instant.
    #[must_use]
    pub fn expected(
        &self,
        time: MonotonicTime,
        known: MonotonicTime,
        max_age_nanos: i64,
    ) -> Option<PoseAt> {
        if time <= known {
            return self.at(time);
        }
        let after = self.samples.partition_point(|s| s.measured_at <= known);
        self.predict(time, after, max_age_nanos)
    }

    /// Returns the pose between two readings: smoothed if configured and possible, else interpolated.
    fn between(
        &self,
        time: MonotonicTime,
        previous: &Sample,
        next: &Sample,
        provenance: Provenance,
    ) -> PoseAt {
        let newest = MonotonicTime::from_nanos(i64::MAX);
        let smoothed = match self.config.smoothing {
            Smoothing::None => None,
            Smoothing::Local {
                half_window_nanos,
                degree,
            } => self
                .smooth((time, newest), (half_window_nanos, degree), previous)
                .map(|local| self.at_rest((time, newest), half_window_nanos, local).0),
        };
        let before = time.nanos_since(previous.measured_at);
        let after = next.measured_at.nanos_since(time);
        PoseAt {
            transmitter_from_sensor: smoothed
                .map_or_else(|| interpolate(time, previous, next), |found| found.pose),
            provenance,
            age_nanos: before.min(after),
            sigma: smoothed.map(|found| found.variance.map(f64::sqrt)),
        }
    }

    /// Least squares over the widest window that the motion allows.
    ///
    /// A wider window removes more noise but distorts fast motion. So the window is doubled as long
    /// as the wider one's result is within the remaining noise of the narrower one's (Goldenshluger
    /// & Nemirovski 1997, intersection of confidence intervals, with two neighbours only).
    ///
    /// Readings after `newest` are ignored.
    fn smooth(
        &self,
        (time, newest): (MonotonicTime, MonotonicTime),
        (half_window, degree): (i64, Degree),
        near: &Sample,
    ) -> Option<Estimate> {
        let widest = self.samples_within((time, newest), half_window);
        let noise = noise_variance(widest.map(|s| s.relative_pose(time)))?;
        let mut best: Option<Fit> = None;
        for narrowing in [4, 2, 1] {
            let fit = self.fit_window((time, newest), half_window / narrowing, degree, near);
            match (best, fit) {
                (Some(narrow), Some(wide)) if !is_consistent(&narrow, &wide, noise) => break,
                (_, Some(_)) => best = fit,
                (_, None) => {}
            }
        }
        best.map(|fit| Estimate::of(&fit, noise))
    }

    /// Least squares over one window. At the newest end, where readings are on one side only, a line
    /// is fitted, because a parabola would triple the noise.
    fn fit_window(
        &self,
        (time, newest): (MonotonicTime, MonotonicTime),
        half_window: i64,
        degree: Degree,
        near: &Sample,
    ) -> Option<Fit> {
        let window = self.samples_within((time, newest), half_window);
        let newer = window.clone().filter(|s| s.measured_at > time).count();
        let older = window.clone().filter(|s| s.measured_at < time).count();
        let degree = match (older, newer) {
            (0, _) => return None,
            (older, newer) if older.min(newer) < MIN_READINGS_PER_SIDE => Degree::Linear,
            _ => degree,
        };
        let readings = window.map(|sample| {
            let nanos = sample.measured_at.nanos_since(time);
            // Epanechnikov's kernel: a reading that enters the window causes no jump.
            let share = nanos as f64 / (half_window + 1) as f64;
            Reading {
                time: nanos as f64 * 1e-9,
                weight: 1.0 - share * share,
                pose: sample.pose,
            }
        });
        value_at_zero(readings, degree, near.pose.rotation)
    }

    fn samples_within(
        &self,
        (time, newest): (MonotonicTime, MonotonicTime),
        half_window: i64,
    ) -> impl Iterator<Item = &Sample> + Clone {
        let end = time.offset_nanos(half_window).min(newest);
        self.samples_between(time.offset_nanos(-half_window), end)
    }

    fn samples_between(
        &self,
        start: MonotonicTime,
        end: MonotonicTime,
    ) -> impl Iterator<Item = &Sample> + Clone {
        let first = self.samples.partition_point(|s| s.measured_at < start);
        let last = self.samples.partition_point(|s| s.measured_at <= end);
        self.samples.range(first..last.max(first))
    }
}

/// Returns whether two fits differ by no more than the narrower one's noise, plus a tolerance for a
/// stream without noise.
fn is_consistent(narrow: &Fit, wide: &Fit, [moved, turned]: [f64; 2]) -> bool {
    let distance = narrow.pose.translation.distance(wide.pose.translation);
    let rotation = angle(&narrow.pose, &wide.pose);
    let within = |difference: f64, variance: f64| {
        difference <= MAX_DEVIATION_SIGMAS * (narrow.noise_gain * variance).sqrt() + 1e-6
    };
    within(distance, moved) && within(rotation, turned)
}

/// Returns the angle between two orientations, radians; unlike `acos`, accurate for small angles.
fn angle(from: &RigidTransform, to: &RigidTransform) -> f64 {
    let turn = from.rotation.inverse() * to.rotation;
    2.0 * turn.xyz().length().atan2(turn.w.abs())
}

/// Axis times angle, radians, the short way round.
fn scaled_axis(turn: DQuat) -> DVec3 {
    let turn = if turn.w < 0.0 { -turn } else { turn };
    turn.to_scaled_axis()
}

fn interpolate(time: MonotonicTime, previous: &Sample, next: &Sample) -> RigidTransform {
    let span = next.measured_at.seconds_since(previous.measured_at);
    if span <= 0.0 {
        return previous.pose;
    }
    let share = time.seconds_since(previous.measured_at) / span;
    let (from, to) = (previous.pose, next.pose);
    RigidTransform::new(
        from.rotation.slerp(to.rotation, share),
        from.translation.lerp(to.translation, share),
    )
}

#[cfg(test)]
mod tests;
