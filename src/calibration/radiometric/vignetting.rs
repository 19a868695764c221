//! Fits vignetting to readings of surfaces of unknown brightness.

use penumbra_camera::vignetting::polynomial;
use penumbra_numerics::Matrix;

/// One reading of a thing whose brightness is unknown but the same wherever in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Which thing.
    pub group: usize,
    /// In which picture: light and exposure may differ from one to the other.
    pub picture: usize,
    /// ρ².
    pub q: f64,
    /// Logarithm of the linear value.
    pub log: f64,
    /// Expected variance of `log`.
    pub variance: f64,
}

/// What readings say.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// k1, k2, k3; zero where readings do not call for them.
    pub coefficients: [f64; 3],
    /// Standard errors.
    pub sigma: [f64; 3],
    /// Standard error of the fall-off at the largest ρ that was seen.
    pub edge_sigma: f64,
    /// Largest ρ² that was seen.
    pub farthest: f64,
    /// Share of readings that were not thrown out.
    pub used: f64,
    /// Root mean square of what is left, relative.
    pub rms: f64,
}

impl Fit {
    /// Brightness at the farthest place seen.
    #[must_use]
    pub fn edge(&self) -> f64 {
        polynomial(&self.coefficients, self.farthest)
    }
}

/// Tukey's constant.
const TUKEY: f64 = 4.685;
/// A term must be as many times its error.
const SIGNIFICANT: f64 = 3.0;
/// Readings must reach over as much of ρ².
const REACH: f64 = 0.15;

/// Fits the fall-off; `None` if there are too few readings or they are all as far from the
/// centre. Terms are left out, the highest first, while they say nothing.
#[must_use]
pub fn fit(readings: &[Reading]) -> Option<Fit> {
    let reach = (f64::MAX, f64::MIN);
    let (low, high) = readings
        .iter()
        .fold(reach, |(low, high), r| (low.min(r.q), high.max(r.q)));
    if readings.len() < 30 || high - low < REACH {
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

fn fit_terms(readings: &[Reading], terms: usize, farthest: f64) -> Option<Fit> {
    let groups = readings.iter().map(|r| r.group).max()? + 1;
    let mut model = Model {
        k: [0.0; 3],
        pictures: vec![0.0; readings.iter().map(|r| r.picture).max()? + 1],
    };
    let mut scale = f64::MAX;
    let mut solved = None;
    for _ in 0..12 {
        let means = group_means(readings, groups, &model, scale);
        let left = |r: &Reading| r.log - model.log(r) - means[r.group].0;
        let mut off: Vec<f64> = readings
            .iter()
            .map(|r| (left(r) / r.variance.sqrt()).abs())
            .collect();
        off.sort_by(f64::total_cmp);
        scale = (1.4826 * off[off.len() / 2]).max(1e-3);
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
        *power = farthest.powi(i as i32 + 1);
    }
    let along = covariance.times_vector(&powers);
    let variance: f64 = along.iter().zip(&powers).map(|(a, b)| a * b).sum();
    let typical = readings.iter().map(|r| r.variance).sum::<f64>() / readings.len() as f64;
    Some(Fit {
        coefficients: model.k,
        sigma,
        edge_sigma: inflate * variance.sqrt(),
        farthest,
        used: used as f64 / readings.len() as f64,
        rms: chi * typical.sqrt(),
    })
    .filter(|f| f.coefficients.iter().chain(&f.sigma).all(|v| v.is_finite()))
}

/// The fall-off, and how much brighter each picture is than the others, logarithms.
struct Model {
    k: [f64; 3],
    pictures: Vec<f64>,
}

impl Model {
    /// What it makes of a reading but for the thing's own brightness.
    fn log(&self, r: &Reading) -> f64 {
        polynomial(&self.k, r.q).max(1e-3).ln() + self.pictures[r.picture]
    }

    fn advance(&mut self, step: &[f64], terms: usize) {
        let (of_lens, of_pictures) = step.split_at(terms);
        self.k.iter_mut().zip(of_lens).for_each(|(k, s)| *k += s);
        let pictures = self.pictures.iter_mut().zip(of_pictures);
        pictures.for_each(|(picture, s)| *picture += s);
    }
}

/// Weighted mean of each group's logarithm, and its weight.
fn group_means(readings: &[Reading], groups: usize, model: &Model, scale: f64) -> Vec<(f64, f64)> {
    let mut sums = vec![(0.0, 0.0); groups];
    let mut means: Vec<(f64, f64)> = vec![(0.0, 0.0); groups];
    // The first pass takes all; the second leaves out what is far from the first's mean.
    for pass in 0..2 {
        sums.fill((0.0, 0.0));
        for r in readings {
            let value = r.log - model.log(r);
            let off = (value - means[r.group].0) / (scale * r.variance.sqrt());
            let trust = if pass == 0 { 1.0 } else { biweight(off) };
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

fn biweight(x: f64) -> f64 {
    let t = 1.0 - (x / TUKEY).powi(2);
    if t > 0.0 { t * t } else { 0.0 }
}

/// How far pictures may differ in brightness, logarithms: keeps solvable what no reading tells.
const PICTURES: f64 = 2.0;

/// One Gauss–Newton step of coefficients and pictures, the groups' means eliminated.
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
    let mut of_group = vec![(vec![0.0; unknowns], 0.0, 0.0); means.len()];
    let (mut used, mut sum) = (0, 0.0);
    for r in readings {
        let v = polynomial(&model.k, r.q).max(1e-3);
        let left = r.log - model.log(r) - means[r.group].0;
        let weight = biweight(left / (scale * r.variance.sqrt())) / r.variance;
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
            *slot += weight * left * j;
        }
        let group = &mut of_group[r.group];
        for (slot, j) in group.0.iter_mut().zip(&row) {
            *slot += weight * j;
        }
        group.1 += weight;
        group.2 += weight * left;
        used += 1;
        sum += weight * left * left;
    }
    for (row, weight, left) in &of_group {
        if *weight > 0.0 {
            normal.add_outer(-1.0 / weight, row, row);
            for (slot, j) in right.iter_mut().zip(row) {
                *slot -= left * j / weight;
            }
        }
    }
    for i in 0..terms {
        // All groups with one reading each say nothing.
        if normal[(i, i)] <= 1e-9 {
            return None;
        }
    }
    for (i, picture) in model.pictures.iter().enumerate() {
        normal[(terms + i, terms + i)] += PICTURES.powi(-2);
        right[terms + i] -= PICTURES.powi(-2) * picture;
    }
    let solved = normal.cholesky()?;
    Some((solved.solve(&right), solved.inverse(), used, sum))
}

#[cfg(test)]
mod tests;
