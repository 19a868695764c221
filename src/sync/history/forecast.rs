//! Prediction of poses beyond the newest reading.
//!
//! A line lags behind curved motion; a parabola and a cubic overshoot straight motion and amplify the
//! tracker's noise. Which one is best depends on the motion. So each new reading is compared with the
//! forecast of each polynomial, and the forecasts are combined by the covariance of their errors
//! (Bates & Granger, "The Combination of Forecasts", 1969), separately for position and orientation
//! and for several lengths of prediction.

use super::{PoseAt, PoseHistory, Provenance, Sample, Smoothing};
use crate::fit::{Degree, Reading, noise_variance, value_at_zero};
use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::rotation_vector;
use std::collections::VecDeque;

/// A polynomial through the newest readings.
struct Polynomial {
    degree: Degree,
    /// Time over which its readings extend, nanoseconds.
    window_nanos: i64,
    /// Minimum time that they must span, nanoseconds; with less, the extrapolation is unstable.
    min_span_nanos: i64,
    /// Minimum number of readings; the window is extended if it has fewer.
    min_readings: usize,
}

const POLYNOMIALS: [Polynomial; 3] = [
    Polynomial {
        degree: Degree::Linear,
        window_nanos: 60_000_000,
        min_span_nanos: 15_000_000,
        min_readings: 2,
    },
    Polynomial {
        degree: Degree::Quadratic,
        window_nanos: 160_000_000,
        min_span_nanos: 130_000_000,
        min_readings: 4,
    },
    Polynomial {
        degree: Degree::Cubic,
        window_nanos: 160_000_000,
        min_span_nanos: 130_000_000,
        min_readings: 6,
    },
];
/// Maximum interval of readings from which motion is estimated, nanoseconds.
const MAX_INTERVAL_NANOS: i64 = 100_000_000;
/// Number of readings for the estimate of their noise.
const NOISE_READINGS: usize = 16;
/// Weights of the polynomials without known errors, and the prior of the weights otherwise: halfway
/// between line and parabola, whose errors mostly have opposite signs.
const PRIOR_WEIGHTS: DVec3 = DVec3::new(0.5, 0.5, 0.0);
/// Strength of the prior, in mean variances of the polynomials.
const PRIOR_STRENGTH: f64 = 0.03;

/// Weights of the polynomials, for position and orientation; each sums to 1.
type Weights = [DVec3; 2];

impl PoseHistory {
    /// Predicts the pose at `time` from the readings before index `after`.
    pub(super) fn predict(
        &self,
        time: MonotonicTime,
        after: usize,
        max_age_nanos: i64,
    ) -> Option<PoseAt> {
        let last = self.samples.get(after.checked_sub(1)?)?;
        let age_nanos = time.nanos_since(last.measured_at);
        if age_nanos > max_age_nanos {
            return None;
        }
        let forecasts = self.forecasts(time, after, last);
        let errors = self.errors.known_at(last.measured_at);
        let pose = combined(&forecasts, errors.weights(age_nanos));
        let pose = self.steadied(pose, last);
        Some(PoseAt {
            transmitter_from_sensor: pose,
            provenance: Provenance::Predicted,
            age_nanos,
            sigma: errors.at(age_nanos),
        })
    }

    /// Returns the prediction `pose`, or the pose at rest where the sensor rests at its `last` reading.
    fn steadied(&self, pose: RigidTransform, last: &Sample) -> RigidTransform {
        let Smoothing::Local {
            half_window_nanos,
            degree,
        } = self.config.smoothing
        else {
            return pose;
        };
        let now = (last.measured_at, last.measured_at);
        let Some(local) = self.smooth(now, (half_window_nanos, degree), last) else {
            return pose;
        };
        let (rest, share) = self.at_rest(now, half_window_nanos, local);
        let translation = pose.translation.lerp(rest.pose.translation, share);
        RigidTransform::new(pose.rotation.slerp(rest.pose.rotation, share), translation)
    }

    /// Updates the error statistics with the errors that predictions of this reading would have had.
    pub(super) fn learn(&mut self, sample: &Sample) {
        for (k, horizon) in HORIZONS_NANOS.into_iter().enumerate() {
            let until = sample.measured_at.offset_nanos(-horizon);
            let after = self.samples.partition_point(|s| s.measured_at <= until);
            let Some(last) = after.checked_sub(1).and_then(|i| self.samples.get(i)) else {
                continue;
            };
            let mut ahead = sample.measured_at.nanos_since(last.measured_at);
            let mut reference = Some((sample.pose, [0.0; 2]));
            // No reading at this horizon; the sample's error would be that of a longer prediction.
            if ahead > horizon + horizon / 2 + 5_000_000 {
                ahead = horizon;
                reference = (after == self.samples.len())
                    .then(|| self.interpolated(last.measured_at.offset_nanos(ahead), sample))
                    .flatten();
            }
            let Some((pose, hidden)) = reference else {
                continue;
            };
            let forecasts = self.forecasts(last.measured_at.offset_nanos(ahead), after, last);
            self.errors.now.bins[k].add(ahead, &forecasts, (&pose, hidden));
        }
        self.errors.remember(sample.measured_at);
    }

    /// Returns the forecast of each polynomial for `time`, from the readings before index `after`.
    /// With too few readings, a polynomial's forecast is that of the lower degree, the line's the
    /// last pose.
    pub(super) fn forecasts(
        &self,
        time: MonotonicTime,
        after: usize,
        last: &Sample,
    ) -> [RigidTransform; 3] {
        let mut lower = last.pose;
        POLYNOMIALS.map(|polynomial| {
            if let Some(pose) = self.forecast(&polynomial, time, after, last) {
                lower = pose;
            }
            lower
        })
    }

    fn forecast(
        &self,
        polynomial: &Polynomial,
        time: MonotonicTime,
        after: usize,
        last: &Sample,
    ) -> Option<RigidTransform> {
        let start = last.measured_at.offset_nanos(-polynomial.window_nanos);
        let within = self.samples.partition_point(|s| s.measured_at < start);
        let first = within.min(after.checked_sub(polynomial.min_readings)?);
        let span = last
            .measured_at
            .nanos_since(self.samples.get(first)?.measured_at);
        let intervals = polynomial.min_readings as i64 - 1;
        let max_span = polynomial.window_nanos.max(intervals * MAX_INTERVAL_NANOS);
        if span < polynomial.min_span_nanos || span > max_span {
            return None;
        }
        let readings = self.samples.range(first..after);
        let readings = readings.map(|sample| sample.relative_to(time));
        value_at_zero(readings, polynomial.degree, last.pose.rotation).map(|fit| fit.pose)
    }

    /// Returns the pose at `time`, between the newest stored reading and the `next` one, on the cubic
    /// through these and the two before, and the variances of the readings' noise (metres²,
    /// radians²): predictions share this noise, so that their errors do not show it.
    fn interpolated(
        &self,
        time: MonotonicTime,
        next: &Sample,
    ) -> Option<(RigidTransform, [f64; 2])> {
        let first = self.samples.len().checked_sub(3)?;
        let readings = self.samples.range(first..).chain(std::iter::once(next));
        let span = next
            .measured_at
            .nanos_since(self.samples.get(first)?.measured_at);
        if span > 3 * MAX_INTERVAL_NANOS {
            return None;
        }
        let readings = readings.map(|sample| sample.relative_to(time));
        let fit = value_at_zero(readings, Degree::Cubic, next.pose.rotation)?;
        let recent = self.samples.len().saturating_sub(NOISE_READINGS);
        let noise = noise_variance(self.samples.range(recent..).map(|s| s.relative_pose(time)))?;
        Some((fit.pose, noise))
    }
}

impl Sample {
    fn relative_to(&self, time: MonotonicTime) -> Reading {
        Reading {
            time: self.measured_at.seconds_since(time),
            weight: 1.0,
            pose: self.pose,
        }
    }
}

/// Combines forecasts by weights; orientations relative to the first one's.
fn combined(forecasts: &[RigidTransform; 3], [position, orientation]: Weights) -> RigidTransform {
    let reference = forecasts[0].rotation;
    let (mut translation, mut rotation) = (DVec3::ZERO, DVec3::ZERO);
    for (k, forecast) in forecasts.iter().enumerate() {
        translation += position[k] * forecast.translation;
        rotation += orientation[k] * rotation_vector(reference.inverse() * forecast.rotation);
    }
    let rotation = (reference * DQuat::from_scaled_axis(rotation)).normalize();
    RigidTransform::new(rotation, translation)
}

/// Lengths of prediction with error statistics, nanoseconds.
const HORIZONS_NANOS: [i64; 6] = [
    5_000_000,
    10_000_000,
    20_000_000,
    40_000_000,
    80_000_000,
    160_000_000,
];
/// Number of readings after which the weight of an error decays to 37 %: one or two seconds.
const DECAY_READINGS: f64 = 200.0;
/// Minimum weight of the errors for a statistic.
const MIN_ERRORS: f64 = 20.0;

/// Number of readings whose error statistics are kept: half a second of most trackers. Predictions as
/// of an earlier time use the oldest.
const MAX_SNAPSHOTS: usize = 128;

/// Error statistics of predictions, now and at recent readings.
#[derive(Clone, Debug)]
pub(super) struct ErrorHistory {
    now: PredictionErrors,
    /// Statistics after the reading of that time.
    snapshots: VecDeque<(MonotonicTime, PredictionErrors)>,
}

impl Default for ErrorHistory {
    fn default() -> Self {
        Self {
            now: PredictionErrors::default(),
            snapshots: VecDeque::with_capacity(MAX_SNAPSHOTS),
        }
    }
}

impl ErrorHistory {
    fn remember(&mut self, at: MonotonicTime) {
        if self.snapshots.len() == MAX_SNAPSHOTS {
            self.snapshots.pop_front();
        }
        self.snapshots.push_back((at, self.now));
    }

    /// Returns the statistics as of the time when the reading of that time was the newest.
    fn known_at(&self, at: MonotonicTime) -> &PredictionErrors {
        let after = self.snapshots.partition_point(|(then, _)| *then <= at);
        let known = self.snapshots.get(after.saturating_sub(1));
        known.map_or(&self.now, |(_, errors)| errors)
    }

    /// Starts a new time line: keeps the statistics, drops their times.
    pub(super) fn restart(&mut self) {
        self.snapshots.clear();
    }
}

/// Statistics of recent prediction errors by length of prediction.
#[derive(Clone, Copy, Debug, Default)]
struct PredictionErrors {
    bins: [ErrorBin; HORIZONS_NANOS.len()],
}

/// Sums for one length of prediction.
#[derive(Clone, Copy, Debug)]
struct ErrorBin {
    weight: f64,
    /// Sum of the lengths, seconds.
    ahead: f64,
    /// Sums of products of the polynomials' errors, metres² and radians².
    products: [DMat3; 2],
}

impl Default for ErrorBin {
    fn default() -> Self {
        Self {
            weight: 0.0,
            ahead: 0.0,
            products: [DMat3::ZERO; 2],
        }
    }
}

impl ErrorBin {
    fn is_known(&self) -> bool {
        self.weight >= MIN_ERRORS
    }

    /// Mean length of the predictions, seconds.
    fn seconds(&self) -> f64 {
        self.ahead / self.weight
    }

    fn weights(&self) -> Weights {
        if self.is_known() {
            self.products
                .map(|products| min_variance_weights(&products))
        } else {
            [PRIOR_WEIGHTS; 2]
        }
    }

    /// Variances of the combination's errors, metres² and radians².
    fn variances(&self) -> [f64; 2] {
        let weights = self.weights();
        [0, 1].map(|k| weights[k].dot(self.products[k] * weights[k]) / self.weight)
    }

    /// Adds the errors of the forecasts of a reading. `hidden`: variances that the errors do not show.
    fn add(
        &mut self,
        ahead_nanos: i64,
        forecasts: &[RigidTransform; 3],
        (read, hidden): (&RigidTransform, [f64; 2]),
    ) {
        let error = |forecast: &RigidTransform| {
            let rotation = rotation_vector(read.rotation.inverse() * forecast.rotation);
            [forecast.translation - read.translation, rotation]
        };
        let errors = forecasts.each_ref().map(error);
        let keep = 1.0 - 1.0 / DECAY_READINGS;
        self.weight = self.weight * keep + 1.0;
        self.ahead = self.ahead * keep + ahead_nanos as f64 * 1e-9;
        for (k, products) in self.products.iter_mut().enumerate() {
            let both = |a: usize, b: usize| errors[a][k].dot(errors[b][k]) + hidden[k];
            let column = |a: usize| DVec3::new(both(a, 0), both(a, 1), both(a, 2));
            *products = *products * keep + DMat3::from_cols(column(0), column(1), column(2));
        }
    }
}

/// Returns the weights, with sum 1, of the combination of minimum variance with the prior
/// [`PRIOR_WEIGHTS`].
///
/// > minimise wᵀSw + m|w − b|² with 1ᵀw = 1:  (S + m)w = mb + λ1,  λ from the sum
///
/// The reading's own noise adds equally to all elements of S and does not change the result.
fn min_variance_weights(products: &DMat3) -> DVec3 {
    let trace = products.x_axis.x + products.y_axis.y + products.z_axis.z;
    let strength = PRIOR_STRENGTH * trace / 3.0;
    let matrix = *products + DMat3::from_diagonal(DVec3::splat(strength));
    let inverse = matrix.inverse();
    let (prior, even) = (inverse * (strength * PRIOR_WEIGHTS), inverse * DVec3::ONE);
    let weights = prior + even * (1.0 - prior.element_sum()) / even.element_sum();
    if weights.is_finite() {
        weights
    } else {
        PRIOR_WEIGHTS
    }
}

impl PredictionErrors {
    /// Returns the known lengths on both sides of this one and its logarithmic position between
    /// them. Below the shortest and above the longest length, both are that one.
    fn around(&self, ahead_nanos: i64) -> Option<(&ErrorBin, &ErrorBin, f64)> {
        let wanted = (ahead_nanos as f64 * 1e-9).max(1e-9);
        let mut known = self.bins.iter().filter(|bin| bin.is_known());
        let mut below = known.next()?;
        // The error of the shortest length is an upper bound for shorter ones.
        if wanted <= below.seconds() {
            return Some((below, below, 0.0));
        }
        for above in known {
            if wanted <= above.seconds() {
                let all = (above.seconds() / below.seconds()).ln().max(1e-9);
                return Some((below, above, (wanted / below.seconds()).ln() / all));
            }
            below = above;
        }
        Some((below, below, 0.0))
    }

    fn weights(&self, ahead_nanos: i64) -> Weights {
        let Some((below, above, share)) = self.around(ahead_nanos) else {
            return [PRIOR_WEIGHTS; 2];
        };
        let (below, above) = (below.weights(), above.weights());
        [0, 1].map(|k| below[k].lerp(above[k], share))
    }

    /// Returns the root mean square error of a prediction of this length, interpolated between the
    /// known lengths. It includes the readings' noise.
    fn at(&self, ahead_nanos: i64) -> Option<[f64; 2]> {
        let (below, above, share) = self.around(ahead_nanos)?;
        let (near, far) = (below.variances(), above.variances());
        // Beyond the longest length the error grows quadratically, as by an unknown acceleration.
        let wanted = ahead_nanos as f64 * 1e-9;
        let grown = (wanted / above.seconds().max(1e-3)).max(1.0).powi(2);
        // Errors grow as a power of the time; linear interpolation would overestimate them.
        let variance = |k: usize| near[k].powf(1.0 - share) * far[k].powf(share);
        Some([variance(0).sqrt() * grown, variance(1).sqrt() * grown])
    }
}
