//! Where a tracked sensor was, is, and will be in a moment.
//!
//! Here is what was: readings, and poses between them. `forecast` draws the motion on.

mod forecast;

use super::fit::{Degree, Fit, Reading, noise_variance, value_at_zero};
use forecast::ErrorHistory;
use penumbra_interface::{MonotonicTime, RigidTransform};
use std::collections::VecDeque;

/// How readings become the pose at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Smoothing {
    /// Between the two neighbours: straight line and great arc. All the tracker's noise
    /// comes through.
    None,
    /// Local least squares through the readings around the instant.
    Local {
        /// Half the widest window, nanoseconds. Quick motion narrows it.
        half_window_nanos: i64,
        /// Degree where there are readings on both sides of the instant.
        degree: Degree,
    },
}

/// What a [`PoseHistory`] keeps and believes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryConfig {
    /// Readings kept; the oldest go first.
    pub capacity: usize,
    /// See [`Smoothing`].
    pub smoothing: Smoothing,
    /// Between two readings further apart than this nothing is interpolated, nanoseconds.
    pub max_gap_nanos: i64,
    /// Beyond the newest reading the pose is predicted for so long, then unknown,
    /// nanoseconds.
    pub max_prediction_nanos: i64,
    /// Time that goes back by more than this is another time: the history begins anew.
    pub jump_back_nanos: i64,
    /// Nothing is moved faster by hand, metres a second.
    pub max_speed: f64,
    /// Nothing is turned faster by hand, radians a second.
    pub max_turn_rate: f64,
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
        }
    }
}

/// How a pose is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Provenance {
    /// A reading was taken at this very instant.
    Exact,
    /// There are readings before and after.
    Interpolated,
    /// There are only readings before.
    Predicted,
}

/// The answer to where the sensor was at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseAt {
    /// `transmitter_from_sensor`, metres.
    pub transmitter_from_sensor: RigidTransform,
    /// How it is known.
    pub provenance: Provenance,
    /// Nanoseconds between the instant and the nearest reading.
    pub age_nanos: i64,
    /// Standard deviations over all axes, metres and radians: of a pose between readings by
    /// their noise, of a predicted one by how far predictions as long were off lately. `None`
    /// until there are enough readings to tell. What the tracker is off by all the time is not
    /// in it.
    pub sigma: Option<[f64; 2]>,
}

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pushed {
    /// It is in the history.
    Kept,
    /// Not finite, or no rotation.
    Invalid,
    /// Not newer than the newest one.
    Late,
    /// Impossibly far from the one before; kept out unless the next ones agree with it.
    Outlier,
    /// Time or place jumped; the history begins anew with it.
    Restarted,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    measured_at: MonotonicTime,
    pose: RigidTransform,
}

/// So many readings that agree with one another overrule the history.
const OVERRULING: u32 = 4;
/// Noise and quantisation that the speed limit allows for: metres and radians.
const SLACK: (f64, f64) = (0.01, 0.02);
/// Readings on both sides that a fit through a window must have at least.
const FEWEST_ON_A_SIDE: usize = 2;
/// Standard deviations by which a wider window may disagree.
const AGREEMENT: f64 = 2.0;
/// The recent readings of one station, in order of time. Does not allocate after `new`.
#[derive(Clone, Debug)]
pub struct PoseHistory {
    config: HistoryConfig,
    samples: VecDeque<Sample>,
    suspect: Option<Sample>,
    agreeing: u32,
    errors: ErrorHistory,
}

impl PoseHistory {
    /// An empty history.
    #[must_use]
    pub fn new(config: HistoryConfig) -> Self {
        Self {
            config,
            samples: VecDeque::with_capacity(config.capacity.max(2)),
            suspect: None,
            agreeing: 0,
            errors: ErrorHistory::default(),
        }
    }

    /// Readings held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// When the newest reading was taken.
    #[must_use]
    pub fn newest(&self) -> Option<MonotonicTime> {
        self.samples.back().map(|sample| sample.measured_at)
    }

    /// When the first reading at or after an instant was taken.
    #[must_use]
    pub fn first_since(&self, time: MonotonicTime) -> Option<MonotonicTime> {
        let before = self.samples.partition_point(|s| s.measured_at < time);
        self.samples.get(before).map(|sample| sample.measured_at)
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.samples.clear();
        self.suspect = None;
        self.agreeing = 0;
        self.errors.restart();
    }

    /// Takes a reading.
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
        if self.possible(&newest, &sample) {
            self.learn(&sample);
            return self.keep(sample, Pushed::Kept);
        }
        self.doubt(sample)
    }

    /// An impossible step. If the next readings go on from it, the history was wrong.
    fn doubt(&mut self, sample: Sample) -> Pushed {
        let agrees = self.suspect.is_some_and(|suspect| {
            sample.measured_at > suspect.measured_at && self.possible(&suspect, &sample)
        });
        self.agreeing = if agrees { self.agreeing + 1 } else { 1 };
        self.suspect = Some(sample);
        if self.agreeing < OVERRULING {
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
        self.suspect = None;
        self.agreeing = 0;
        outcome
    }

    fn possible(&self, from: &Sample, to: &Sample) -> bool {
        let seconds = to.measured_at.seconds_since(from.measured_at);
        let moved = from.pose.translation.distance(to.pose.translation);
        let turned = angle(&from.pose, &to.pose);
        moved <= self.config.max_speed * seconds + SLACK.0
            && turned <= self.config.max_turn_rate * seconds + SLACK.1
    }

    /// The pose at an instant; `None` before the first reading, inside a gap, and too long
    /// after the last one.
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

    /// The pose at an instant as it was expected when `known` was the newest reading: later ones
    /// count for nothing. `None` if that is more than `longest_nanos` before the instant.
    #[must_use]
    pub fn expected(
        &self,
        time: MonotonicTime,
        known: MonotonicTime,
        longest_nanos: i64,
    ) -> Option<PoseAt> {
        if time <= known {
            return self.at(time);
        }
        let after = self.samples.partition_point(|s| s.measured_at <= known);
        self.predict(time, after, longest_nanos)
    }

    /// Smoothed where asked for and possible, else on the line between the neighbours.
    fn between(
        &self,
        time: MonotonicTime,
        previous: &Sample,
        next: &Sample,
        provenance: Provenance,
    ) -> PoseAt {
        let smoothed = match self.config.smoothing {
            Smoothing::None => None,
            Smoothing::Local {
                half_window_nanos,
                degree,
            } => self.smooth(time, half_window_nanos, degree, previous),
        };
        let before = time.nanos_since(previous.measured_at);
        let after = next.measured_at.nanos_since(time);
        PoseAt {
            transmitter_from_sensor: smoothed
                .map_or_else(|| interpolate(time, previous, next), |(fit, _)| fit.pose),
            provenance,
            age_nanos: before.min(after),
            sigma: smoothed
                .map(|(fit, noise)| noise.map(|variance| (fit.noise_gain * variance).sqrt())),
        }
    }

    /// Least squares over the widest window that the motion allows.
    ///
    /// A wider window takes more noise away, but bends a quick motion straight. So windows
    /// grow by doubling for as long as the wider one's answer agrees with the narrower
    /// one's to within the noise that the narrower one lets through (Goldenshluger and
    /// Nemirovski's intersection of confidence intervals, with two neighbours only).
    fn smooth(
        &self,
        time: MonotonicTime,
        half_window: i64,
        degree: Degree,
        near: &Sample,
    ) -> Option<(Fit, [f64; 2])> {
        let widest = self.samples_within(time, half_window);
        let noise = noise_variance(widest.map(|sample| &sample.pose))?;
        let mut best: Option<Fit> = None;
        for narrowing in [4, 2, 1] {
            let fit = self.fit_window(time, half_window / narrowing, degree, near);
            match (best, fit) {
                (Some(narrow), Some(wide)) if !agree(&narrow, &wide, noise) => break,
                (_, Some(_)) => best = fit,
                (_, None) => {}
            }
        }
        best.map(|fit| (fit, noise))
    }

    /// Least squares over one window. At the newest end, where readings are on one side
    /// only, a line is fitted: a parabola there would triple the noise.
    fn fit_window(
        &self,
        time: MonotonicTime,
        half_window: i64,
        degree: Degree,
        near: &Sample,
    ) -> Option<Fit> {
        let window = self.samples_within(time, half_window);
        let newer = window.clone().filter(|s| s.measured_at > time).count();
        let older = window.clone().filter(|s| s.measured_at < time).count();
        let degree = match (older, newer) {
            (0, _) => return None,
            (older, newer) if older.min(newer) < FEWEST_ON_A_SIDE => Degree::Linear,
            _ => degree,
        };
        let readings = window.map(|sample| {
            let nanos = sample.measured_at.nanos_since(time);
            // Epanechnikov's kernel: a reading that enters the window does not jolt it.
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
        time: MonotonicTime,
        half_window: i64,
    ) -> impl Iterator<Item = &Sample> + Clone {
        let start = time.offset_nanos(-half_window);
        let end = time.offset_nanos(half_window);
        let first = self.samples.partition_point(|s| s.measured_at < start);
        let last = self.samples.partition_point(|s| s.measured_at <= end);
        self.samples.range(first..last.max(first))
    }
}

/// Whether two fits differ by no more than the narrower one's noise, and a hair for a stream
/// without any.
fn agree(narrow: &Fit, wide: &Fit, [moved, turned]: [f64; 2]) -> bool {
    let apart = narrow.pose.translation.distance(wide.pose.translation);
    let turn = angle(&narrow.pose, &wide.pose);
    let within = |apart: f64, variance: f64| {
        apart <= AGREEMENT * (narrow.noise_gain * variance).sqrt() + 1e-6
    };
    within(apart, moved) && within(turn, turned)
}

/// Radians between two orientations; unlike `acos`, exact for small ones.
fn angle(from: &RigidTransform, to: &RigidTransform) -> f64 {
    let turn = from.rotation.inverse() * to.rotation;
    2.0 * turn.xyz().length().atan2(turn.w.abs())
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
