//! Initial outline of a sphere by RANSAC over steps of brightness.

use super::super::rays::{EdgeStep, RandomIndices};
use super::cone::{distance, shape};
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_numerics::median_absolute;

/// Number of random triples of steps.
const TRIES: usize = 8000;

/// Approximate position of the sphere in the picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoughSphere {
    /// A point on it, ideally its centre.
    pub centre: DVec2,
    /// Its radius, if known.
    pub radius: Option<f64>,
}

/// Ratio of neighbouring radii that are tried about a position without a radius.
const RADIUS_STEP: f64 = 1.4;

impl RoughSphere {
    /// Returns the positions at which to search in a picture of `size`: with this radius, or with all
    /// that fit into the picture. One search over all radii would find only the outermost edges.
    #[must_use]
    pub fn candidates(self, size: DVec2) -> Vec<Self> {
        let radii = |first: f64, last: f64| {
            std::iter::successors(Some(first), |r| Some(r * RADIUS_STEP))
                .take_while(move |r| *r <= last)
        };
        let mut all = vec![self];
        if self.radius.is_none() {
            let tried = radii(0.04 * size.min_element(), 0.75 * size.max_element());
            all.extend(tried.map(|r| Self {
                radius: Some(r),
                ..self
            }));
        }
        all
    }
}

/// Returns the cone that most steps lie on, counting one per ray.
pub(super) fn sample(
    all: &[EdgeStep],
    camera: &PinholeCamera,
    rough: &RoughSphere,
    near: f64,
) -> Option<DVec3> {
    let bearings: Vec<DVec3> = all.iter().map(|s| camera.unproject(s.at)).collect();
    let focal = camera.focal.min_element();
    let typical = median_absolute(all.iter().map(|s| s.height)).max(1.0);
    let click = camera.unproject(rough.centre);
    let mut random = RandomIndices::new();
    let (mut best, mut most) = (None, 0.0);
    for _ in 0..TRIES {
        let pick: [usize; 3] = std::array::from_fn(|_| random.below(all.len()));
        let [Some(a), Some(b), Some(c)] = pick.map(|i| bearings.get(i).copied()) else {
            return None;
        };
        let matrix = DMat3::from_cols(a, b, c).transpose();
        if matrix.determinant().abs() < 1e-9 {
            continue;
        }
        let x = matrix.inverse() * DVec3::ONE;
        let Some((axis, half)) = shape(x) else {
            continue;
        };
        let size = half * focal;
        let angle = axis.angle_between(click);
        let fits = match rough.radius {
            Some(r) => (0.8 * r..1.25 * r).contains(&size) && angle * focal < 0.3 * r,
            None => size > 3.0 * near && angle < half,
        };
        if !fits || half > 1.2 {
            continue;
        }
        let votes = votes(all, &bearings, x, focal, 0.5 * near, typical);
        if votes > most {
            (most, best) = (votes, Some(x));
        }
    }
    best
}

fn votes(
    all: &[EdgeStep],
    bearings: &[DVec3],
    x: DVec3,
    focal: f64,
    near: f64,
    typical: f64,
) -> f64 {
    let (mut sum, mut ray, mut most) = (0.0, usize::MAX, 0.0_f64);
    for (step, bearing) in all.iter().zip(bearings) {
        if step.ray != ray {
            sum += most;
            (ray, most) = (step.ray, 0.0);
        }
        if distance(x, *bearing, focal).abs() < near {
            most = most.max((step.height / (2.0 * typical)).min(1.0).sqrt());
        }
    }
    sum + most
}
