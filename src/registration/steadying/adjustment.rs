//! The pose that fits the places of landmarks in a picture: robust least squares with a prior.
//!
//! ```text
//!   min over x of  Σᵢ ρ(|rᵢ − Jᵢ x| / s) + xᵀ P⁻¹ x
//! ```
//! x: rotation vector and translation from the prior's pose, camera axes; rᵢ: measured less predicted
//! pixel, in standard deviations; Jᵢ: its derivative; P: covariance of the prior; s: scale of the residuals, from their median;
//! ρ: Geman & McClure's, by reweighting. The prior is good to pixels, so that the linear form suffices.

use penumbra_numerics::fixed_size::{Matrix, solve};
use std::f64::consts::FRAC_1_SQRT_2;

const ITERATIONS: usize = 8;
/// Smallest scale of the residuals, standard deviations.
const MIN_SCALE: f64 = 1.0;
/// Residual with a weight of a quarter, in scales.
const TUNING: f64 = 2.0;
/// Largest residual of a landmark that agrees, in scales.
const AGREES: f64 = 4.0;

/// One measured coordinate of a landmark's place in a picture.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Coordinate {
    /// Measured less predicted value, standard deviations.
    pub residual: f64,
    /// Its derivative by the rotation vector and the translation.
    pub derivative: [f64; 6],
    /// Standard deviation, pixels.
    pub sigma: f64,
}

/// A landmark's place in a picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    /// Index of the landmark.
    pub landmark: usize,
    /// The second is zero where only one was measured, across an edge.
    pub coordinates: [Coordinate; 2],
}

impl Sighting {
    /// Length of the remaining residual, standard deviations per coordinate.
    fn off(&self, x: &[f64; 6]) -> f64 {
        let [one, two] = self.remaining(x);
        if self.is_edge() {
            one.abs()
        } else {
            one.hypot(two) * FRAC_1_SQRT_2
        }
    }

    /// Length of the remaining residual, pixels.
    fn pixels(&self, x: &[f64; 6]) -> f64 {
        let [one, two] = self.remaining(x);
        let [a, b] = &self.coordinates;
        (one * a.sigma).hypot(two * b.sigma)
    }

    /// The remaining residual, standard deviations.
    fn remaining(&self, x: &[f64; 6]) -> [f64; 2] {
        self.coordinates.each_ref().map(|c| {
            let moved: f64 = c.derivative.iter().zip(x).map(|(d, x)| d * x).sum();
            c.residual - moved
        })
    }

    fn is_edge(&self) -> bool {
        self.coordinates[1].sigma == 0.0
    }
}

/// The result.
#[derive(Clone, Copy, Debug)]
pub(super) struct Adjustment {
    /// Rotation vector (radians) and translation (metres) from the prior's pose, camera axes.
    pub x: [f64; 6],
    /// Scale of the residuals, in standard deviations.
    pub scale: f64,
    /// Median length of the residuals, pixels.
    pub pixels: f64,
}

impl Adjustment {
    /// Residual of a landmark, standard deviations.
    pub fn residual(&self, sighting: &Sighting) -> f64 {
        sighting.off(&self.x)
    }

    /// Whether a landmark with this residual agrees with the pose.
    pub fn agrees(&self, residual: f64) -> bool {
        residual <= AGREES * self.scale
    }
}

/// Adjusts a pose. `sigmas`: the prior's standard deviations per axis, radians and metres. `scratch`
/// is memory. `None` if the system cannot be solved.
pub(super) fn adjust(
    sightings: &[Sighting],
    sigmas: [f64; 2],
    scratch: &mut Vec<f64>,
) -> Option<Adjustment> {
    let mut x = [0.0; 6];
    let mut scale = MIN_SCALE;
    for _ in 0..ITERATIONS {
        scale = scale_of(sightings, &x, scratch);
        let (normal, right) = normal_equations(sightings, &x, scale, sigmas);
        x = solve(&normal, &right)?;
    }
    let pixels = median(sightings.iter().map(|s| s.pixels(&x)), scratch);
    Some(Adjustment { x, scale, pixels })
}

/// Robust scale of the residuals, standard deviations: half of normal residuals are smaller than 0.75.
fn scale_of(sightings: &[Sighting], x: &[f64; 6], scratch: &mut Vec<f64>) -> f64 {
    let median = median(sightings.iter().map(|s| s.off(x)), scratch);
    (median / 0.75).max(MIN_SCALE)
}

/// The median, 0 without values.
fn median(values: impl Iterator<Item = f64>, scratch: &mut Vec<f64>) -> f64 {
    scratch.clear();
    scratch.extend(values);
    if scratch.is_empty() {
        return 0.0;
    }
    let middle = scratch.len() / 2;
    *scratch.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn normal_equations(
    sightings: &[Sighting],
    x: &[f64; 6],
    scale: f64,
    sigmas: [f64; 2],
) -> (Matrix<6>, [f64; 6]) {
    let mut normal = [[0.0; 6]; 6];
    let mut right = [0.0; 6];
    for (i, row) in normal.iter_mut().enumerate() {
        row[i] = sigmas[i / 3].powi(-2);
    }
    for sighting in sightings {
        let share = sighting.off(x) / (TUNING * scale);
        let weight = (1.0 + share * share).powi(-2) / (scale * scale);
        for coordinate in &sighting.coordinates {
            for (i, row) in normal.iter_mut().enumerate() {
                let di = coordinate.derivative[i] * weight;
                for (value, dj) in row.iter_mut().zip(&coordinate.derivative) {
                    *value += di * dj;
                }
                right[i] += di * coordinate.residual;
            }
        }
    }
    (normal, right)
}
