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
        let [one, two] = self.coordinates.each_ref().map(|c| {
            let moved: f64 = c.derivative.iter().zip(x).map(|(d, x)| d * x).sum();
            c.residual - moved
        });
        if self.is_edge() {
            one.abs()
        } else {
            one.hypot(two) * FRAC_1_SQRT_2
        }
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

/// Adjusts a pose. `sigmas`: the prior's standard deviations per axis, radians and metres. `lengths`
/// is scratch memory. `None` if the system cannot be solved.
pub(super) fn adjust(
    sightings: &[Sighting],
    sigmas: [f64; 2],
    lengths: &mut Vec<f64>,
) -> Option<Adjustment> {
    let mut x = [0.0; 6];
    let mut scale = MIN_SCALE;
    for _ in 0..ITERATIONS {
        scale = scale_of(sightings, &x, lengths);
        let (normal, right) = normal_equations(sightings, &x, scale, sigmas);
        x = solve(&normal, &right)?;
    }
    Some(Adjustment { x, scale })
}

/// Robust scale of the residuals, standard deviations: half of normal residuals are smaller than 0.75.
fn scale_of(sightings: &[Sighting], x: &[f64; 6], lengths: &mut Vec<f64>) -> f64 {
    lengths.clear();
    lengths.extend(sightings.iter().map(|s| s.off(x)));
    if lengths.is_empty() {
        return MIN_SCALE;
    }
    let middle = lengths.len() / 2;
    let (_, median, _) = lengths.select_nth_unstable_by(middle, f64::total_cmp);
    (*median / 0.75).max(MIN_SCALE)
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
