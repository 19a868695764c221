//! Irradiance by spherical harmonics of degree 2 (Ramamoorthi & Hanrahan 2001).
//!
//! ```text
//!  L_lm = ∫ L(ω) Y_lm(ω) dω,   E(n) = Σ A_l L_lm Y_lm(n),   A = π, 2π/3, π/4.
//!  With Y_lm = k_lm · p_lm, p the plain polynomials of `Harmonics`, both constants fold
//!  into one factor per coefficient: c_lm = A_l k_lm² ∫ L p_lm dω.
//! ```

use super::light::Harmonics;
use glam::Vec3;
use std::f32::consts::PI;

/// A_l k_lm² for the polynomials 1, y, z, x, xy, yz, 3z²−1, xz, x²−y².
const FACTORS: [f32; 9] = [
    1.0 / 4.0,
    1.0 / 2.0,
    1.0 / 2.0,
    1.0 / 2.0,
    15.0 / 16.0,
    15.0 / 16.0,
    5.0 / 64.0,
    15.0 / 16.0,
    15.0 / 64.0,
];

/// The polynomials p of [`FACTORS`].
pub(crate) fn polynomials(n: Vec3) -> [f32; 9] {
    [
        1.0,
        n.y,
        n.z,
        n.x,
        n.x * n.y,
        n.y * n.z,
        3.0 * n.z * n.z - 1.0,
        n.x * n.z,
        n.x * n.x - n.y * n.y,
    ]
}

/// Σ L p Ω of a fixed set of directions, with precomputed polynomials.
#[derive(Clone, Debug)]
pub struct HarmonicsTable {
    weights: Vec<[f32; 9]>,
}

impl HarmonicsTable {
    /// Creates the table for directions that cover the sphere with the given solid angles,
    /// steradians.
    #[must_use]
    pub fn new(directions: &[Vec3], solid_angles: &[f32]) -> Self {
        let mut weights: Vec<[f32; 9]> = directions
            .iter()
            .zip(solid_angles)
            .map(|(&d, &w)| polynomials(d).map(|p| p * w))
            .collect();
        // The quadrature of a finite grid is slightly inexact; make it exact for constants.
        let total: f64 = weights.iter().map(|p| f64::from(p[0])).sum();
        let scale = (4.0 * std::f64::consts::PI / total) as f32;
        for (row, factor) in weights.iter_mut().flat_map(|w| w.iter_mut().zip(FACTORS)) {
            *row *= scale * factor;
        }
        Self { weights }
    }

    /// Projects the radiance `texels`, in the order of the directions, to irradiance.
    #[must_use]
    pub fn project(&self, texels: &[Vec3]) -> Harmonics {
        let mut coefficients = [Vec3::ZERO; 9];
        for (l, weights) in texels.iter().zip(&self.weights) {
            for (c, w) in coefficients.iter_mut().zip(weights) {
                *c += *l * *w;
            }
        }
        Harmonics { coefficients }
    }
}

/// Adds a difference of irradiance at the normal +Z, falling to zero at −Z, as Δ (1 + z)² / 4,
/// which is within degree 2. Degree 2 differs from the true irradiance of a non-uniform sky by a
/// few percent; the ground, on which shadows fall, should be exact.
pub fn pin_upward(harmonics: &mut Harmonics, difference: Vec3) {
    let [one, _, z, _, _, _, zz, _, _] = &mut harmonics.coefficients;
    *one += difference / 3.0;
    *z += difference / 2.0;
    *zz += difference / 12.0;
}

/// Irradiance by numerical integration: ∫ L max(n·ω, 0) dω.
#[must_use]
pub fn irradiance_of(n: Vec3, directions: &[Vec3], solid_angles: &[f32], texels: &[Vec3]) -> Vec3 {
    directions
        .iter()
        .zip(solid_angles)
        .zip(texels)
        .map(|((d, w), l)| *l * (d.dot(n).max(0.0) * w))
        .sum()
}

/// The paper's irradiance, for comparison: the environment map blurred by a Gaussian (Supan 2006,
/// section VI 1) instead of the cosine lobe, scaled so that a constant L still gives πL. On the
/// sphere a Gaussian of standard deviation `sigma` (radians) multiplies band l by
/// exp(−σ² l (l + 1) / 2). From σ = 0.75 on, bands above 2, which degree 2 omits, keep less than a
/// fifth of their strength.
#[must_use]
pub fn blurred(table: &HarmonicsTable, texels: &[Vec3], sigma: f32) -> Harmonics {
    let mut harmonics = table.project(texels);
    let cosine_bands = [PI, 2.0 * PI / 3.0, PI / 4.0];
    for (i, c) in harmonics.coefficients.iter_mut().enumerate() {
        let l = [0, 1, 1, 1, 2, 2, 2, 2, 2][i];
        let gaussian = PI * (-0.5 * sigma * sigma * (l * (l + 1)) as f32).exp();
        *c *= gaussian / cosine_bands[l];
    }
    harmonics
}

#[cfg(test)]
mod tests {
    use super::super::cube::CubeGrid;
    use super::*;

    fn table(size: u32) -> (CubeGrid, HarmonicsTable) {
        let grid = CubeGrid::new(size);
        let table = HarmonicsTable::new(&grid.directions, &grid.solid_angles);
        (grid, table)
    }

    #[test]
    fn radiance_of_degree_2_is_returned() {
        let (grid, table) = table(64);
        let sky = |d: Vec3| 1.0 + 0.5 * d.x + 0.2 * (3.0 * d.z * d.z - 1.0) - 0.3 * d.x * d.y;
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| Vec3::splat(sky(*d)))
            .collect();
        let h = table.project(&texels);
        for d in [Vec3::X, Vec3::Z, Vec3::new(0.6, -0.64, 0.48)] {
            let error = (h.radiance(d).x - sky(d)).abs();
            assert!(error < 2e-3, "{d}: {error}");
        }
    }

    #[test]
    fn constant_radiance_gives_pi_times_it() {
        let (grid, table) = table(64);
        let h = table.project(&vec![Vec3::new(0.5, 1.0, 2.0); grid.directions.len()]);
        for n in [Vec3::X, Vec3::Z, Vec3::new(0.6, -0.64, 0.48)] {
            let relative = h.irradiance(n) / (Vec3::new(0.5, 1.0, 2.0) * PI) - 1.0;
            assert!(relative.abs().max_element() < 1e-4, "{relative}");
        }
        let b = blurred(&table, &vec![Vec3::ONE; grid.directions.len()], 0.9);
        assert!((b.irradiance(Vec3::X).x - PI).abs() < 1e-3);
    }

    #[test]
    fn linear_sky_is_exact() {
        // L = 1 + d·a: E(n) = π + (2π/3) a·n.
        let (grid, table) = table(64);
        let a = Vec3::new(0.3, -0.4, 0.5);
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| Vec3::splat(1.0 + d.dot(a)))
            .collect();
        let h = table.project(&texels);
        for n in [Vec3::X, -Vec3::Y, Vec3::new(0.0, 0.6, 0.8)] {
            let expected = PI + 2.0 * PI / 3.0 * a.dot(n);
            assert!((h.irradiance(n).x - expected).abs() < 2e-3);
        }
    }

    #[test]
    fn degree_two_is_within_nine_percent_of_a_half_lit_sphere() {
        let (grid, table) = table(64);
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| Vec3::splat(if d.x > 0.0 { 1.0 } else { 0.0 }))
            .collect();
        let h = table.project(&texels);
        for n in [Vec3::X, Vec3::Z, Vec3::new(0.8, 0.0, 0.6)] {
            let exact = irradiance_of(n, &grid.directions, &grid.solid_angles, &texels);
            assert!((h.irradiance(n).x - exact.x).abs() < 0.09 * PI);
        }
    }

    #[test]
    fn pinning_changes_upward_irradiance_by_the_difference() {
        let mut h = Harmonics::default();
        pin_upward(&mut h, Vec3::splat(0.4));
        assert!((h.irradiance(Vec3::Z).x - 0.4).abs() < 1e-6);
        assert!((h.irradiance(Vec3::X).x - 0.1).abs() < 1e-6);
        assert!(h.irradiance(-Vec3::Z).x.abs() < 1e-6);
    }
}
