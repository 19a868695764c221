//! The distance of a lamp that is seen from several points.
//!
//! ```text
//!  From the observer o, the lamp lies in the direction u at the distance 1/κ; from another point oᵢ
//!  therefore in the direction of
//!      vᵢ = u + κ (o − oᵢ),
//!  where it is seen in the direction dᵢ with an error of σᵢ radians. u and κ are those with the least
//!      Σ |dᵢ/(dᵢ·v̂ᵢ) − v̂ᵢ|² / σᵢ²,   v̂ᵢ = vᵢ/|vᵢ|.
//! ```
//!
//! With the reciprocal of the distance, a lamp that is far is the limit, and the error is as good as normally
//! distributed (Civera, Davison and Montiel 2008, "Inverse Depth Parametrization for Monocular SLAM").

use super::place::LampDistance;
use glam::{DMat2, DMat3, DVec3};

/// Distance between two points, metres, up to which they count as one, with the mean of what is seen there.
const ONE_PLACE: f64 = 0.02;
/// Largest number of places; with more, places that are farther apart count as one.
const PLACES: usize = 24;
/// Share of the variance of a direction that repetition does not reduce: calibration, poses.
const LASTING: f64 = 0.4;
/// Least number of sightings from elsewhere than the most usual place.
const ENOUGH: u32 = 3;
/// Squared error of a sighting, in units of its variance, above which the lamp has moved.
const MOVED: f64 = 36.0;
/// Limit of the sum of squared errors, in units of their variance: for each degree of freedom, and once. Above it, the
/// lamp has moved, or something else was taken for it.
const INCONSISTENT: (f64, f64) = (4.0, 32.0);
/// Squared error of two sightings, in units of its variance, up to which they may be of the same lamp.
const SAME: f64 = 9.0;
/// Standard deviation of the reciprocal of a distance that nothing is known of, 1/m.
const UNKNOWN: f64 = 5.0;
/// Largest reciprocal, 1/m.
const NEAREST: f64 = 10.0;
/// Reciprocals at the best of which the least-squares solution begins, 1/m.
const STARTS: [f64; 10] = [0.0, 0.3, 0.6, 1.0, 1.5, 2.2, 3.3, 5.0, 7.0, NEAREST];
/// Steps of the least-squares solution.
const STEPS: usize = 8;

/// A lamp as it is seen from a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// The point, world, metres.
    pub from: DVec3,
    /// Unit vector from there to the lamp.
    pub direction: DVec3,
    /// Standard deviation of the direction per axis, radians.
    pub sigma: f64,
}

/// What has been seen from about the same point.
#[derive(Clone, Copy, Debug)]
struct Place {
    mean: Sighting,
    count: u32,
}

impl Place {
    fn add(&mut self, other: &Self) {
        let count = self.count + other.count;
        let share = f64::from(other.count) / f64::from(count);
        let (a, b) = (&self.mean, &other.mean);
        self.mean = Sighting {
            from: a.from.lerp(b.from, share),
            direction: a
                .direction
                .lerp(b.direction, share)
                .normalize_or(a.direction),
            sigma: a.sigma + (b.sigma - a.sigma) * share,
        };
        self.count = count;
    }

    /// The variance of the mean direction.
    fn variance(&self) -> f64 {
        let of_one = self.mean.sigma * self.mean.sigma;
        of_one * (LASTING + (1.0 - LASTING) / f64::from(self.count))
    }
}

/// The sightings of a lamp that stands still. Its memory is bounded.
#[derive(Clone, Debug)]
pub struct Sightings {
    places: Vec<Place>,
    /// Distance up to which points count as one, metres.
    apart: f64,
}

impl Default for Sightings {
    fn default() -> Self {
        Self {
            places: Vec::with_capacity(PLACES + 1),
            apart: ONE_PLACE,
        }
    }
}

/// Direction and distance of a lamp by triangulation.
#[derive(Clone, Copy, Debug)]
struct Solution {
    inverse: f64,
    /// Standard deviation of the reciprocal, 1/m.
    sigma: f64,
    /// Sum of the squared errors, in units of their variances.
    square: f64,
    /// Whether that is more than can be.
    is_inconsistent: bool,
}

impl Solution {
    const fn distance(&self) -> LampDistance {
        LampDistance {
            inverse: self.inverse as f32,
            sigma: self.sigma as f32,
        }
    }
}

/// Returns the distance of a lamp from where `a` sees it, if `b` may show the same lamp; `None` if not.
#[must_use]
pub fn of_two(a: Sighting, b: Sighting) -> Option<LampDistance> {
    let place = |mean| Place { mean, count: 1 };
    let both = Sightings {
        places: vec![place(a), place(b)],
        apart: ONE_PLACE,
    };
    let solution = both.solve(a.from, a.direction)?;
    let is_same = solution.square < SAME && solution.inverse < NEAREST;
    is_same.then_some(solution.distance())
}

impl Sightings {
    /// Adds a sighting. Returns false if it does not agree with the others: the lamp has moved, and only the new
    /// sighting is kept.
    pub fn add(&mut self, sighting: Sighting) -> bool {
        let place = Place {
            mean: sighting,
            count: 1,
        };
        let has_moved = self.nearest(&place).is_some_and(|k| {
            let old = &self.places[k];
            let between = old.mean.from.distance(sighting.from);
            let parallax = between * NEAREST;
            let turned = old.mean.direction.angle_between(sighting.direction);
            let apart = (turned - parallax).max(0.0);
            let variance = old.variance() + sighting.sigma * sighting.sigma;
            apart * apart > MOVED * variance
        });
        if has_moved {
            self.places.clear();
        }
        self.put(place);
        while self.places.len() > PLACES {
            self.apart *= 1.5;
            let all = std::mem::take(&mut self.places);
            all.into_iter().for_each(|place| self.put(place));
        }
        let is_wrong = self
            .solve(sighting.from, sighting.direction)
            .is_some_and(|s| s.is_inconsistent);
        if is_wrong {
            self.places.clear();
            self.put(place);
        }
        !has_moved && !is_wrong
    }

    fn nearest(&self, place: &Place) -> Option<usize> {
        let from = |p: &Place| p.mean.from.distance(place.mean.from);
        let near = |(k, p): (usize, &Place)| (from(p) < self.apart).then_some((k, from(p)));
        let all = self.places.iter().enumerate().filter_map(near);
        all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
    }

    fn put(&mut self, place: Place) {
        match self.nearest(&place) {
            Some(k) => self.places[k].add(&place),
            None => self.places.push(place),
        }
    }

    /// Number of places from which the lamp was seen.
    #[must_use]
    pub fn places(&self) -> usize {
        self.places.len()
    }

    /// Returns the lamp's distance from `observer` (world, metres), from which it is seen in `direction` (unit
    /// vector); `None` if too little was seen from elsewhere. The reciprocal is the most probable one, which may
    /// be 0, with its standard deviation.
    #[must_use]
    pub fn distance(&self, observer: DVec3, direction: DVec3) -> Option<LampDistance> {
        let count = |p: &Place| p.count;
        let most = self.places.iter().map(count).max().unwrap_or(0);
        let all: u32 = self.places.iter().map(count).sum();
        let solution = self.solve(observer, direction)?;
        (all - most >= ENOUGH).then_some(solution.distance())
    }

    /// Solves for a small rotation of `direction` and the reciprocal distance by Gauss–Newton steps.
    fn solve(&self, observer: DVec3, direction: DVec3) -> Option<Solution> {
        if self.places.len() < 2 {
            return None;
        }
        let (right, up) = direction.any_orthonormal_pair();
        let error = |x: DVec3| self.normal_equations(observer, direction, (right, up), x).2;
        let starts = STARTS.map(|inverse| DVec3::Z * inverse);
        let mut x = *starts
            .iter()
            .min_by(|a, b| error(**a).total_cmp(&error(**b)))?;
        for _ in 0..STEPS {
            let (normal, gradient, _) = self.normal_equations(observer, direction, (right, up), x);
            x += within_limits(normal, gradient, -x.z, NEAREST - x.z)?;
        }
        let (normal, _, square) = self.normal_equations(observer, direction, (right, up), x);
        let freedom = (2 * self.places.len() - 3) as f64;
        let variance = invertible(normal)?.z_axis.z * (square / freedom).max(1.0);
        variance.is_finite().then(|| Solution {
            inverse: x.z,
            sigma: variance.sqrt(),
            square,
            is_inconsistent: square > INCONSISTENT.0 * freedom + INCONSISTENT.1,
        })
    }

    /// The normal matrix, the right-hand side, and the sum of squares at x: the displacement of the direction along two
    /// tangents, and κ.
    fn normal_equations(
        &self,
        observer: DVec3,
        direction: DVec3,
        (right, up): (DVec3, DVec3),
        x: DVec3,
    ) -> (DMat3, DVec3, f64) {
        let prior = (UNKNOWN * UNKNOWN).recip();
        let mut normal = DMat3::from_diagonal(DVec3::new(1e-9, 1e-9, prior));
        let (mut gradient, mut square) = (DVec3::new(0.0, 0.0, -prior * x.z), 0.0);
        let towards = direction + right * x.x + up * x.y;
        for place in &self.places {
            let v = towards + (observer - place.mean.from) * x.z;
            let length = v.length().max(1e-6);
            let unit = v / length;
            let cosine = place.mean.direction.dot(unit).max(0.1);
            let error = place.mean.direction / cosine - unit;
            let across = |c: DVec3| (c - unit * unit.dot(c)) / length;
            let columns = [right, up, observer - place.mean.from].map(across);
            let weight = place.variance().recip();
            let row = |c: DVec3| DVec3::from_array(columns.map(|other| c.dot(other))) * weight;
            normal += DMat3::from_cols(row(columns[0]), row(columns[1]), row(columns[2]));
            gradient += DVec3::from_array(columns.map(|c| c.dot(error))) * weight;
            square += error.length_squared() * weight;
        }
        (normal, gradient, square)
    }
}

/// Solves the normal equations with the last unknown between two limits.
fn within_limits(normal: DMat3, gradient: DVec3, low: f64, high: f64) -> Option<DVec3> {
    let free = invertible(normal)? * gradient;
    let last = free.z.clamp(low, high);
    if last == free.z {
        return Some(free);
    }
    let rest = (gradient - normal.z_axis * last).truncate();
    let of_rest = DMat2::from_cols(normal.x_axis.truncate(), normal.y_axis.truncate());
    let solution = (of_rest.inverse() * rest).extend(last);
    solution.is_finite().then_some(solution)
}

fn invertible(m: DMat3) -> Option<DMat3> {
    let inverse = m.inverse();
    inverse.is_finite().then_some(inverse)
}

/// Returns the mean of two independent estimates of a reciprocal distance, weighted by their variances.
#[must_use]
pub fn fused(a: LampDistance, b: LampDistance) -> LampDistance {
    let weight = |d: &LampDistance| (d.sigma.max(1e-4) * d.sigma.max(1e-4)).recip();
    let (wa, wb) = (weight(&a), weight(&b));
    LampDistance {
        inverse: (a.inverse * wa + b.inverse * wb) / (wa + wb),
        sigma: (wa + wb).recip().sqrt(),
    }
}

#[cfg(test)]
mod tests;
