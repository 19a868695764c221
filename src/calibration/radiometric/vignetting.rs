//! Fits vignetting to readings of surfaces of unknown brightness, by variable projection over the
//! surfaces' brightness and iteratively reweighted Gauss–Newton steps.

use penumbra_camera::vignetting::polynomial;
use penumbra_numerics::{Matrix, median, tukey_weight};

/// A reading of a surface point whose unknown brightness is the same everywhere in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Index of the surface point.
    pub group: usize,
    /// Index of the picture: light and exposure may differ between pictures.
    pub picture: usize,
    /// Squared distance from the centre, ρ², relative to half the diagonal.
    pub q: f64,
    /// Logarithm of the linear value.
    pub log: f64,
    /// Expected variance of `log`.
    pub variance: f64,
}

/// A fitted vignetting.
#[derive(Clone, Debug, PartialEq)]
pub struct VignettingFit {
    /// k1, k2, k3; zero where not significant.
    pub coefficients: [f64; 3],
    /// Standard errors of the coefficients.
    pub sigma: [f64; 3],
    /// Standard error of the relative brightness at the largest ρ of a reading.
    pub edge_sigma: f64,
    /// Largest ρ² of a reading.
    pub max_rho_squared: f64,
    /// Share of readings that are not outliers.
    pub used: f64,
    /// Root mean square of the residuals, relative.
    pub rms: f64,
}

impl VignettingFit {
    /// Returns the relative brightness at the largest ρ of a reading.
    #[must_use]
    pub fn edge_brightness(&self) -> f64 {
        polynomial(&self.coefficients, self.max_rho_squared)
    }
}

/// Scale of Tukey's weights, in standard deviations.
const TUKEY: f64 = 4.685;
/// Minimum ratio of a term to its standard error for the term to be kept.
const SIGNIFICANT: f64 = 3.0;
/// Minimum range of ρ² that the readings must cover.
const MIN_RANGE: f64 = 0.15;
/// Standard deviation of the prior of the pictures' brightness, logarithms: keeps the equations
/// solvable where the readings do not determine it.
const PICTURE_SIGMA: f64 = 2.0;

/// Fits vignetting; `None` for too few readings or too small a range of ρ². Insignificant terms are
/// dropped, the highest first.
#[must_use]
pub fn fit(readings: &[Reading]) -> Option<VignettingFit> {
    let reach = (f64::MAX, f64::MIN);
    let (low, high) = readings
        .iter()
        .fold(reach, |(low, high), r| (low.min(r.q), high.max(r.q)));
    if readings.len() < 30 || high - low < MIN_RANGE {
        return None;
    }
    for terms in (1..=3).rev() {
        let found = fit_terms(readings, terms, high)?;
        let last = terms - 1;
        if found.coefficients[last].abs() > SIGNIFICANT * found.sigma[last] || terms == 1 {
            return Some(found);
        }
    }
    None
}

fn fit_terms(readings: &[Reading], terms: usize, max_q: f64) -> Option<VignettingFit> {
    let groups = readings.iter().map(|r| r.group).max()? + 1;
    let mut model = Model {
        k: [0.0; 3],
        pictures: vec![0.0; readings.iter().map(|r| r.picture).max()? + 1],
    };
    let mut scale = f64::MAX;
    let mut solved = None;
    for _ in 0..12 {
        let means = group_means(readings, groups, &model, scale);
        let residual = |r: &Reading| r.log - model.log(r) - means[r.group].0;
        let scaled = readings
            .iter()
            .map(|r| (residual(r) / r.variance.sqrt()).abs());
        scale = (1.4826 * median(scaled)?).max(1e-3);
        let (step, covariance, used, sum) = solve(readings, &model, &means, scale, terms)?;
        model.advance(&step, terms);
        let freedom = used.saturating_sub(groups + step.len()).max(1) as f64;
        solved = Some((covariance, used, (sum / freedom).sqrt()));
    }
    let (covariance, used, chi) = solved?;
    let inflate = chi.max(1.0);
    let mut sigma = [0.0; 3];
    for (i, s) in sigma.iter_mut().enumerate().take(terms) {
        *s = inflate * covariance[(i, i)].sqrt();
    }
    let mut powers = vec![0.0; terms + model.pictures.len()];
    for (i, power) in powers.iter_mut().enumerate().take(terms) {
        *power = max_q.powi(i as i32 + 1);
    }
    let along = covariance.times_vector(&powers);
    let variance: f64 = along.iter().zip(&powers).map(|(a, b)| a * b).sum();
    let typical = readings.iter().map(|r| r.variance).sum::<f64>() / readings.len() as f64;
    Some(VignettingFit {
        coefficients: model.k,
        sigma,
        edge_sigma: inflate * variance.sqrt(),
        max_rho_squared: max_q,
        used: used as f64 / readings.len() as f64,
        rms: chi * typical.sqrt(),
    })
    .filter(|f| f.coefficients.iter().chain(&f.sigma).all(|v| v.is_finite()))
}

/// Vignetting, and the relative brightness of each picture, logarithms.
struct Model {
    k: [f64; 3],
    pictures: Vec<f64>,
}

impl Model {
    /// Returns the logarithm of a reading, less that of the surface's brightness.
    fn log(&self, r: &Reading) -> f64 {
        polynomial(&self.k, r.q).max(1e-3).ln() + self.pictures[r.picture]
    }

    fn advance(&mut self, step: &[f64], terms: usize) {
        let (lens, pictures) = step.split_at(terms);
        self.k.iter_mut().zip(lens).for_each(|(k, s)| *k += s);
        let pictures = self.pictures.iter_mut().zip(pictures);
        pictures.for_each(|(picture, s)| *picture += s);
    }
}

/// Returns the robust weighted mean of each group's logarithm, and its weight.
fn group_means(readings: &[Reading], groups: usize, model: &Model, scale: f64) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); groups];
    let mut means: Vec<(f64, f64)> = vec![(0.0, 0.0); groups];
    // The first pass uses all readings; the second downweights outliers from the first mean.
    for pass in 0..2 {
        sums.fill((0.0, 0.0));
        for r in readings {
            let value = r.log - model.log(r);
            let residual = (value - means[r.group].0) / (scale * r.variance.sqrt());
            let trust = if pass == 0 {
                1.0
            } else {
                tukey_weight(residual / TUKEY)
            };
            let weight = trust / r.variance;
            sums[r.group].0 += weight * value;
            sums[r.group].1 += weight;
        }
        for (mean, (sum, weight)) in means.iter_mut().zip(&sums) {
            if *weight > 0.0 {
                *mean = (sum / weight, *weight);
            }
        }
    }
    means
}

/// Returns a Gauss–Newton step of coefficients and pictures with the groups' means eliminated, its
/// covariance, the number of readings used and their weighted sum of squares.
fn solve(
    readings: &[Reading],
    model: &Model,
    means: &[(f64, f64)],
    scale: f64,
    terms: usize,
) -> Option<(Vec<f64>, Matrix, usize, f64)> {
    let unknowns = terms + model.pictures.len();
    let mut normal = Matrix::zeros(unknowns, unknowns);
    let mut right = vec![0.0; unknowns];
    let mut group_sums = vec![(vec![0.0; unknowns], 0.0, 0.0); means.len()];
    let (mut used, mut sum) = (0, 0.0);
    for r in readings {
        let v = polynomial(&model.k, r.q).max(1e-3);
        let residual = r.log - model.log(r) - means[r.group].0;
        let weight = tukey_weight(residual / (TUKEY * scale * r.variance.sqrt())) / r.variance;
        if weight <= 0.0 {
            continue;
        }
        let mut row = vec![0.0; unknowns];
        for (i, slot) in row.iter_mut().enumerate().take(terms) {
            *slot = r.q.powi(i as i32 + 1) / v;
        }
        row[terms + r.picture] = 1.0;
        normal.add_outer(weight, &row, &row);
        for (slot, j) in right.iter_mut().zip(&row) {
            *slot += weight * residual * j;
        }
        let group = &mut group_sums[r.group];
        for (slot, j) in group.0.iter_mut().zip(&row) {
            *slot += weight * j;
        }
        group.1 += weight;
        group.2 += weight * residual;
        used += 1;
        sum += weight * residual * residual;
    }
    for (row, weight, residuals) in &group_sums {
        if *weight > 0.0 {
            normal.add_outer(-1.0 / weight, row, row);
            for (slot, j) in right.iter_mut().zip(row) {
                *slot -= residuals * j / weight;
            }
        }
    }
    for i in 0..terms {
        // Groups with one reading each contain no information.
        if normal[(i, i)] <= 1e-9 {
            return None;
        }
    }
    for (i, picture) in model.pictures.iter().enumerate() {
        normal[(terms + i, terms + i)] += PICTURE_SIGMA.powi(-2);
        right[terms + i] -= PICTURE_SIGMA.powi(-2) * picture;
    }
    let solved = normal.cholesky()?;
    Some((solved.solve(&right), solved.inverse(), used, sum))
}

#[cfg(test)]
mod tests;
