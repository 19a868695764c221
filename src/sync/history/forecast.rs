//! A motion drawn on beyond its last reading.
//!
//! A line lags where the motion bends, a parabola and a cubic overshoot where it does not and
//! swell the tracker's noise: which is best is the motion's matter. So each reading that
//! comes in is held against what each way had said of it, and the ways are mixed as their
//! errors, and how those go together, advise (Bates and Granger, The Combination of
//! Forecasts, 1969), for the place and for the direction, for short and for long predictions.

use super::super::fit::{Degree, Reading, noise_variance, rotation_vector, value_at_zero};
use super::{PoseAt, PoseHistory, Provenance, Sample};
use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::{MonotonicTime, RigidTransform};
use std::collections::VecDeque;

/// A polynomial through the newest readings.
struct Way {
    degree: Degree,
    /// How far they reach back, nanoseconds.
    window_nanos: i64,
    /// What they must span of it: a polynomial through less runs off.
    least_nanos: i64,
    /// So many are needed: where they are rare they reach back further.
    fewest: usize,
}

const WAYS: [Way; 3] = [
    Way {
        degree: Degree::Linear,
        window_nanos: 60_000_000,
        least_nanos: 15_000_000,
        fewest: 2,
    },
    Way {
        degree: Degree::Quadratic,
        window_nanos: 160_000_000,
        least_nanos: 130_000_000,
        fewest: 4,
    },
    Way {
        degree: Degree::Cubic,
        window_nanos: 160_000_000,
        least_nanos: 130_000_000,
        fewest: 6,
    },
];
/// Rarer readings than this tell of no motion, nanoseconds between them.
const RAREST_NANOS: i64 = 100_000_000;
/// Readings that their noise is taken from.
const NOISE_READINGS: usize = 16;
/// Shares of the ways while nothing is known of their errors, and what they are drawn to by
/// [`DRAWN`]: half way between line and parabola, whose errors are mostly of opposite sign.
const BEFOREHAND: DVec3 = DVec3::new(0.5, 0.5, 0.0);
/// How strongly, in mean variances of the ways.
const DRAWN: f64 = 0.03;

/// Shares of the ways, for place and direction; each sums to 1.
type Shares = [DVec3; 2];

impl PoseHistory {
    /// The motion before index `after`, drawn on to `time`.
    pub(super) fn predict(
        &self,
        time: MonotonicTime,
        after: usize,
        longest_nanos: i64,
    ) -> Option<PoseAt> {
        let last = self.samples.get(after.checked_sub(1)?)?;
        let age_nanos = time.nanos_since(last.measured_at);
        if age_nanos > longest_nanos {
            return None;
        }
        let ways = self.ways(time, after, last);
        let errors = self.errors.known_at(last.measured_at);
        Some(PoseAt {
            transmitter_from_sensor: mixed(&ways, errors.shares(age_nanos)),
            provenance: Provenance::Predicted,
            age_nanos,
            sigma: errors.at(age_nanos),
        })
    }

    /// Sees how far predictions of this reading would have been off.
    pub(super) fn learn(&mut self, sample: &Sample) {
        for (k, horizon) in HORIZONS_NANOS.into_iter().enumerate() {
            let until = sample.measured_at.offset_nanos(-horizon);
            let after = self.samples.partition_point(|s| s.measured_at <= until);
            let Some(last) = after.checked_sub(1).and_then(|i| self.samples.get(i)) else {
                continue;
            };
            let mut ahead = sample.measured_at.nanos_since(last.measured_at);
            let mut truth = Some((sample.pose, [0.0; 2]));
            // That far there is no reading: it would be the error of a longer prediction.
            if ahead > horizon + horizon / 2 + 5_000_000 {
                ahead = horizon;
                truth = (after == self.samples.len())
                    .then(|| self.passed(last.measured_at.offset_nanos(ahead), sample))
                    .flatten();
            }
            let Some((pose, hidden)) = truth else {
                continue;
            };
            let ways = self.ways(last.measured_at.offset_nanos(ahead), after, last);
            self.errors.now.bins[k].add(ahead, &ways, (&pose, hidden));
        }
        self.errors.remember(sample.measured_at);
    }

    /// What each way says of `time`, by the readings before index `after`: a way that has too
    /// few says what the one before it says, the first that all stays where it was.
    pub(super) fn ways(
        &self,
        time: MonotonicTime,
        after: usize,
        last: &Sample,
    ) -> [RigidTransform; 3] {
        let mut before = last.pose;
        WAYS.map(|way| {
            if let Some(pose) = self.by_way(&way, time, after, last) {
                before = pose;
            }
            before
        })
    }

    fn by_way(
        &self,
        way: &Way,
        time: MonotonicTime,
        after: usize,
        last: &Sample,
    ) -> Option<RigidTransform> {
        let start = last.measured_at.offset_nanos(-way.window_nanos);
        let within = self.samples.partition_point(|s| s.measured_at < start);
        let first = within.min(after.checked_sub(way.fewest)?);
        let span = last
            .measured_at
            .nanos_since(self.samples.get(first)?.measured_at);
        let longest = way.window_nanos.max((way.fewest as i64 - 1) * RAREST_NANOS);
        if span < way.least_nanos || span > longest {
            return None;
        }
        let readings = self.samples.range(first..after);
        let readings = readings.map(|sample| sample.seen_from(time));
        value_at_zero(readings, way.degree, last.pose.rotation).map(|fit| fit.pose)
    }

    /// Where the sensor was at `time`, after the newest reading kept, now that the next one is
    /// known: on the cubic through them and the two before. And the variances of their noise,
    /// metres² and radians²: predictions share it, so that it hides in what they are off by.
    fn passed(&self, time: MonotonicTime, next: &Sample) -> Option<(RigidTransform, [f64; 2])> {
        let first = self.samples.len().checked_sub(3)?;
        let readings = self.samples.range(first..).chain(std::iter::once(next));
        let span = next
            .measured_at
            .nanos_since(self.samples.get(first)?.measured_at);
        if span > 3 * RAREST_NANOS {
            return None;
        }
        let readings = readings.map(|sample| sample.seen_from(time));
        let fit = value_at_zero(readings, Degree::Cubic, next.pose.rotation)?;
        let lately = self.samples.len().saturating_sub(NOISE_READINGS);
        let noise = noise_variance(self.samples.range(lately..).map(|sample| &sample.pose))?;
        Some((fit.pose, noise))
    }
}

impl Sample {
    fn seen_from(&self, time: MonotonicTime) -> Reading {
        Reading {
            time: self.measured_at.seconds_since(time),
            weight: 1.0,
            pose: self.pose,
        }
    }
}

/// The ways' poses, each by its share; directions about the first one's.
fn mixed(ways: &[RigidTransform; 3], [of_place, of_direction]: Shares) -> RigidTransform {
    let reference = ways[0].rotation;
    let (mut place, mut turn) = (DVec3::ZERO, DVec3::ZERO);
    for (k, way) in ways.iter().enumerate() {
        place += of_place[k] * way.translation;
        turn += of_direction[k] * rotation_vector(reference.inverse() * way.rotation);
    }
    let rotation = (reference * DQuat::from_scaled_axis(turn)).normalize();
    RigidTransform::new(rotation, place)
}

/// Lengths of prediction whose errors are followed, nanoseconds.
const HORIZONS_NANOS: [i64; 6] = [
    5_000_000,
    10_000_000,
    20_000_000,
    40_000_000,
    80_000_000,
    160_000_000,
];
/// Readings after which an error counts only 37 %: a second or two.
const FORGETTING: f64 = 200.0;
/// Errors that tell nothing yet.
const FEWEST_ERRORS: f64 = 20.0;

/// Readings for which it is remembered what was known of the errors by then: half a second of
/// most trackers. Who asks for a prediction of longer ago gets the shares of the oldest.
const REMEMBERED: usize = 128;

/// How far predictions were off, as known now and a little before.
#[derive(Clone, Debug)]
pub(super) struct ErrorHistory {
    now: PredictionErrors,
    /// After which reading.
    then: VecDeque<(MonotonicTime, PredictionErrors)>,
}

impl Default for ErrorHistory {
    fn default() -> Self {
        Self {
            now: PredictionErrors::default(),
            then: VecDeque::with_capacity(REMEMBERED),
        }
    }
}

impl ErrorHistory {
    fn remember(&mut self, at: MonotonicTime) {
        if self.then.len() == REMEMBERED {
            self.then.pop_front();
        }
        self.then.push_back((at, self.now));
    }

    /// As known when the reading of that time was the newest.
    fn known_at(&self, at: MonotonicTime) -> &PredictionErrors {
        let after = self.then.partition_point(|(then, _)| *then <= at);
        let known = self.then.get(after.saturating_sub(1));
        known.map_or(&self.now, |(_, errors)| errors)
    }

    /// Another time has begun: what was learnt holds on, when it was does not.
    pub(super) fn restart(&mut self) {
        self.then.clear();
    }
}

/// How far predictions were off lately, by their length.
#[derive(Clone, Copy, Debug, Default)]
struct PredictionErrors {
    bins: [ErrorBin; HORIZONS_NANOS.len()],
}

/// Sums of one length.
#[derive(Clone, Copy, Debug)]
struct ErrorBin {
    weight: f64,
    /// Of their lengths, seconds.
    ahead: f64,
    /// Of the ways' errors with one another, metres² and radians².
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
    fn known(&self) -> bool {
        self.weight >= FEWEST_ERRORS
    }

    /// Predicted over this length.
    fn seconds(&self) -> f64 {
        self.ahead / self.weight
    }

    fn shares(&self) -> Shares {
        if self.known() {
            self.products.map(|products| least_variance(&products))
        } else {
            [BEFOREHAND; 2]
        }
    }

    /// Variances of the mixture's errors, metres² and radians².
    fn variances(&self) -> [f64; 2] {
        let shares = self.shares();
        [0, 1].map(|k| shares[k].dot(self.products[k] * shares[k]) / self.weight)
    }

    /// One more reading, with the variances that do not show in it, and what the ways had said.
    fn add(
        &mut self,
        ahead_nanos: i64,
        ways: &[RigidTransform; 3],
        (read, hidden): (&RigidTransform, [f64; 2]),
    ) {
        let error = |said: &RigidTransform| {
            let turn = rotation_vector(read.rotation.inverse() * said.rotation);
            [said.translation - read.translation, turn]
        };
        let errors = ways.each_ref().map(error);
        let keep = 1.0 - 1.0 / FORGETTING;
        self.weight = self.weight * keep + 1.0;
        self.ahead = self.ahead * keep + ahead_nanos as f64 * 1e-9;
        for (k, products) in self.products.iter_mut().enumerate() {
            let both = |a: usize, b: usize| errors[a][k].dot(errors[b][k]) + hidden[k];
            let column = |a: usize| DVec3::new(both(a, 0), both(a, 1), both(a, 2));
            *products = *products * keep + DMat3::from_cols(column(0), column(1), column(2));
        }
    }
}

/// The shares, of sum 1, whose mixture has the least variance, drawn to [`BEFOREHAND`].
///
/// > minimise wᵀSw + m|w − b|² with 1ᵀw = 1:  (S + m)w = mb + λ1,  λ by the sum
///
/// The reading's own noise is in all of S alike, so that it changes nothing.
fn least_variance(products: &DMat3) -> DVec3 {
    let trace = products.x_axis.x + products.y_axis.y + products.z_axis.z;
    let drawn = DRAWN * trace / 3.0;
    let matrix = *products + DMat3::from_diagonal(DVec3::splat(drawn));
    let inverse = matrix.inverse();
    let (towards, even) = (inverse * (drawn * BEFOREHAND), inverse * DVec3::ONE);
    let shares = towards + even * (1.0 - towards.element_sum()) / even.element_sum();
    if shares.is_finite() {
        shares
    } else {
        BEFOREHAND
    }
}

impl PredictionErrors {
    /// The known lengths on both sides of this one, and how far from the first to the second
    /// it lies, by ratios. Both are the shortest before it, and the longest beyond.
    fn around(&self, ahead_nanos: i64) -> Option<(&ErrorBin, &ErrorBin, f64)> {
        let wanted = (ahead_nanos as f64 * 1e-9).max(1e-9);
        let mut known = self.bins.iter().filter(|bin| bin.known());
        let mut below = known.next()?;
        // A prediction of no length would be as wrong as the shortest at most.
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

    fn shares(&self, ahead_nanos: i64) -> Shares {
        let Some((below, above, share)) = self.around(ahead_nanos) else {
            return [BEFOREHAND; 2];
        };
        let (below, above) = (below.shares(), above.shares());
        [0, 1].map(|k| below[k].lerp(above[k], share))
    }

    /// Root mean square error of a prediction of this length, between those that are known.
    /// The readings' own noise is in it.
    fn at(&self, ahead_nanos: i64) -> Option<[f64; 2]> {
        let (below, above, share) = self.around(ahead_nanos)?;
        let (near, far) = (below.variances(), above.variances());
        // Longer than any: as if by a missed acceleration.
        let wanted = ahead_nanos as f64 * 1e-9;
        let grown = (wanted / above.seconds().max(1e-3)).max(1.0).powi(2);
        // Errors grow as a power of the time: a line between two would lie above them.
        let mixed = |k: usize| near[k].powf(1.0 - share) * far[k].powf(share);
        Some([mixed(0).sqrt() * grown, mixed(1).sqrt() * grown])
    }
}
