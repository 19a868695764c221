//! Colour errors of one camera on a chart.

use glam::{DMat3, DVec3};
use penumbra_numerics::NormalEquations;
use penumbra_rig_model::radiometric_file::ColoursRecord;
use penumbra_white_balance::chart::Patch;
use penumbra_white_balance::colour::delta_e_linear;

/// Differences between a camera's colours of a chart and the reference, CIEDE2000, by patch; `None`
/// where a patch is clipped or too dark.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Colours {
    /// With the exposure corrected.
    pub as_shown: Vec<Option<f64>>,
    /// With the exposure corrected and white balanced on the grey row.
    pub balanced: Vec<Option<f64>>,
    /// With the best 3×3 matrix.
    pub matrixed: Vec<Option<f64>>,
    /// That matrix: reference = matrix × camera, linear.
    pub matrix: DMat3,
}

impl Colours {
    /// Compares a chart's patches with its reference; `None` for fewer than twelve patches.
    pub fn new(patches: &[Patch], reference: &[DVec3; 24]) -> Option<Self> {
        let read: Vec<Option<DVec3>> = patches.iter().map(mean).collect();
        let both = || pairs(&read, reference);
        if both().count() < 12 {
            return None;
        }
        let greys = || pairs(&read[18..], &reference[18..]);
        let gains = DVec3::from_array([0, 1, 2].map(|c| ratio(greys(), c)));
        let matrix = matrix(both(), gains)?;
        let green = DVec3::splat(gains.y);
        let with = |map: DMat3| -> Vec<Option<f64>> {
            let error = |(m, r): (&Option<DVec3>, &DVec3)| Some(delta_e_linear(map * (*m)?, *r));
            read.iter().zip(reference).map(error).collect()
        };
        Some(Self {
            as_shown: with(DMat3::from_diagonal(green)),
            balanced: with(DMat3::from_diagonal(gains)),
            matrixed: with(matrix),
            matrix,
        })
    }

    /// Returns the mean differences and the matrix for the calibration file.
    pub fn record(&self) -> ColoursRecord {
        ColoursRecord {
            delta_e_as_shown: Self::mean(&self.as_shown),
            delta_e_balanced: Self::mean(&self.balanced),
            delta_e_matrix: Self::mean(&self.matrixed),
            matrix: self.matrix.transpose().to_cols_array_2d(),
        }
    }

    /// Returns the mean over the patches with a value.
    pub fn mean(values: &[Option<f64>]) -> f64 {
        let (n, sum) = values
            .iter()
            .flatten()
            .fold((0.0, 0.0), |(n, s), v| (n + 1.0, s + v));
        sum / f64::max(n, 1.0)
    }
}

/// Returns the readings with their references, without unreadable patches.
fn pairs<'a>(
    read: &'a [Option<DVec3>],
    reference: &'a [DVec3],
) -> impl Iterator<Item = (DVec3, DVec3)> + Clone + 'a {
    let pairs = read.iter().zip(reference);
    pairs.filter_map(|(m, r)| Some(((*m)?, *r)))
}

/// Returns the ratio of reference to reading by least squares, which weights bright patches most.
fn ratio(pairs: impl Iterator<Item = (DVec3, DVec3)>, c: usize) -> f64 {
    let (mr, mm) = pairs.fold((0.0, 0.0), |(mr, mm), (m, r)| {
        (mr + m[c] * r[c], mm + m[c] * m[c])
    });
    if mm > 0.0 { mr / mm } else { 1.0 }
}

/// Fits reference ≈ M × reading row by row, relative to the patches' brightness.
fn matrix(pairs: impl Iterator<Item = (DVec3, DVec3)> + Clone, gains: DVec3) -> Option<DMat3> {
    let mut rows = [DVec3::ZERO; 3];
    for (c, slot) in rows.iter_mut().enumerate() {
        let mut normal = NormalEquations::new(3);
        for (m, r) in pairs.clone() {
            let weight = 1.0 / (r.length_squared() + 0.01);
            normal.add(-r[c], &(m * gains).to_array(), weight);
        }
        let right: Vec<f64> = normal.gradient.iter().map(|g| -g).collect();
        let x = normal.hessian.cholesky()?.solve(&right);
        *slot = DVec3::new(x[0], x[1], x[2]) * gains;
    }
    Some(DMat3::from_cols(rows[0], rows[1], rows[2]).transpose())
}

fn mean(patch: &Patch) -> Option<DVec3> {
    let [r, g, b] = patch.0;
    Some(DVec3::new(r?.mean, g?.mean, b?.mean))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometric::reference::Edition;
    use penumbra_white_balance::chart::Reading;

    #[test]
    fn white_balance_and_matrix_reduce_colour_errors() {
        let reference = Edition::default().linear();
        let cross = DMat3::from_cols(
            DVec3::new(0.70, 0.06, 0.02),
            DVec3::new(0.12, 0.80, 0.10),
            DVec3::new(0.02, 0.08, 0.55),
        );
        let patches: Vec<Patch> = reference
            .iter()
            .map(|r| {
                Patch((cross * *r).to_array().map(|mean| {
                    Some(Reading {
                        mean,
                        variance_of_mean: 1e-8,
                        variance: 1e-6,
                    })
                }))
            })
            .collect();
        let colours = Colours::new(&patches, &reference).unwrap();
        let [shown, balanced, matrixed] =
            [&colours.as_shown, &colours.balanced, &colours.matrixed].map(|v| Colours::mean(v));
        assert!(
            shown > 1.3 * balanced && balanced > 1.0 && matrixed < 0.1,
            "{shown} {balanced} {matrixed}"
        );
        assert_eq!(Colours::new(&patches[..11], &reference), None);
    }
}
