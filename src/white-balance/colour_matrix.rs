//! Fits a 3×3 colour matrix where two cameras differ by more than gains.

use glam::{DMat3, DVec3};
use penumbra_numerics::root_mean_square;

/// The same surface, linear, in both cameras.
#[derive(Clone, Copy, Debug)]
pub(super) struct ColourPair {
    pub scene: DVec3,
    pub environment: DVec3,
}

/// Maximum ratio of the matrix's error on unseen patches to that of the gains.
const MIN_IMPROVEMENT: f64 = 0.8;
/// Relative error of the gains below which no matrix is fitted.
const GOOD_ENOUGH: f64 = 0.005;
/// Minimum number of patches for the nine elements.
const MIN_PATCHES: usize = 6;
/// Strengths of the regularisation towards the gains among which cross-validation selects.
const RIDGES: [f64; 5] = [1e-5, 1e-4, 1e-3, 1e-2, 1e-1];

/// Fits a ridge-regularised matrix, with the strength selected by leave-one-out
/// cross-validation; `None` where it is no better than the gains alone.
pub(super) fn fit(pairs: &[ColourPair], gains: DVec3) -> Option<DMat3> {
    if pairs.len() < MIN_PATCHES {
        return None;
    }
    let gains_error = root_mean_square(pairs.iter().map(|p| relative_error(p, diagonal(gains))));
    let (ridge, matrix_error) = RIDGES
        .iter()
        .map(|&ridge| (ridge, cross_validate(pairs, gains, ridge)))
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let worth_it = gains_error > GOOD_ENOUGH && matrix_error < MIN_IMPROVEMENT * gains_error;
    worth_it
        .then(|| solve(pairs.iter(), gains, ridge))
        .flatten()
}

fn diagonal(gains: DVec3) -> DMat3 {
    DMat3::from_diagonal(gains)
}

fn cross_validate(pairs: &[ColourPair], gains: DVec3, ridge: f64) -> f64 {
    root_mean_square(pairs.iter().enumerate().map(|(left_out, pair)| {
        let others = pairs.iter().enumerate();
        let others = others.filter(|(i, _)| *i != left_out).map(|(_, p)| p);
        solve(others, gains, ridge).map_or(f64::INFINITY, |m| relative_error(pair, m))
    }))
}

fn relative_error(pair: &ColourPair, matrix: DMat3) -> f64 {
    pair.scene.distance(matrix * pair.environment) / pair.scene.length().max(1e-6)
}

// ┌ minimise Σᵢ ‖sᵢ − M eᵢ‖² / ‖sᵢ‖² + λ t ‖M − G‖², G = diag(gains),                    ┐
// │ A = Σ eᵢ eᵢᵀ/‖sᵢ‖², B = Σ sᵢ eᵢᵀ/‖sᵢ‖², t = tr A / 3                                  │
// └ ⇒ M (A + λ t I) = B + λ t G                                                          ┘
fn solve<'a>(
    pairs: impl Iterator<Item = &'a ColourPair>,
    gains: DVec3,
    ridge: f64,
) -> Option<DMat3> {
    let (mut a, mut b) = (DMat3::ZERO, DMat3::ZERO);
    for ColourPair { scene, environment } in pairs {
        let weight = 1.0 / scene.length_squared().max(1e-12);
        a += outer(*environment, *environment) * weight;
        b += outer(*scene, *environment) * weight;
    }
    let pull = ridge * (a.x_axis.x + a.y_axis.y + a.z_axis.z) / 3.0;
    let regularised = a + DMat3::IDENTITY * pull;
    let matrix = (b + diagonal(gains) * pull) * regularised.inverse();
    (regularised.determinant().abs() > 1e-15 && matrix.is_finite()).then_some(matrix)
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {

    use super::*;

    #[test]
    fn recovers_an_exact_matrix() {
        let ground_truth = DMat3::from_cols(
            DVec3::new(2.0, 0.1, -0.2),
            DVec3::new(-0.3, 1.5, 0.1),
            DVec3::new(0.1, -0.2, 1.8),
        );
        let pairs: Vec<ColourPair> = (0..12)
            .map(|i| {
                let x = f64::from(i);
                let environment = DVec3::new(
                    0.3 + 0.2 * x.sin(),
                    0.3 + 0.2 * (1.3 * x).cos(),
                    0.3 + 0.2 * (2.1 * x).sin(),
                );
                ColourPair {
                    scene: ground_truth * environment,
                    environment,
                }
            })
            .collect();
        let found = fit(&pairs, DVec3::new(2.0, 1.5, 1.8)).unwrap();
        assert!(
            (found - ground_truth)
                .to_cols_array()
                .iter()
                .all(|d| d.abs() < 0.01)
        );
        assert_eq!(fit(&pairs[..5], DVec3::ONE), None);
    }

    #[test]
    fn equal_patches_yield_no_matrix() {
        let pair = ColourPair {
            scene: DVec3::splat(0.5),
            environment: DVec3::splat(0.25),
        };
        assert_eq!(fit(&[pair; 12], DVec3::splat(2.0)), None);
    }
}
