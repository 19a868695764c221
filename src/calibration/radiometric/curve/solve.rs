//! Fits the exponents and the exposures to all samples by iteratively reweighted least squares.

use super::gather::{Sample, SeriesGatherer};
use super::model::{ANCHOR, Curve};
use penumbra_camera::Response;
use penumbra_numerics::{Matrix, median_absolute, tukey_weight};

/// Knots between which p is linear in ln z, codes; below the first it is constant.
const KNOTS: [f64; 15] = [
    5.0, 9.0, 15.0, 24.0, 36.0, 52.0, 72.0, 96.0, 124.0, 154.0, 184.0, 210.0, 230.0, 244.0, 255.0,
];
/// Mean of the prior of p: that of any camera.
const PRIOR_MEAN: f64 = 1.9;
/// Standard deviation of the prior of p.
const PRIOR_SIGMA: f64 = 1.0;
/// Relative error of two readings of a point by compression, stray light and uneven surfaces.
const FLOOR: f64 = 0.01;
/// Number of samples that count as one independent sample, as neighbours' errors are correlated.
const CORRELATED_SAMPLES: f64 = 12.0;
/// Weight of the constraints on the exposures' errors.
const CONSTRAINT: f64 = 1e8;
/// Scale of Tukey's weights, in standard deviations.
const TUKEY: f64 = 4.685;

/// Returns the integral of each knot's hat function over ln z from `low` to `high`.
fn slopes(low: f64, high: f64) -> [f64; KNOTS.len()] {
    let (a, b) = (primitive(low), primitive(high));
    std::array::from_fn(|j| b[j] - a[j])
}

/// Returns the integral of each hat function from the first knot to `code`.
fn primitive(code: f64) -> [f64; KNOTS.len()] {
    let v = code.max(0.25).ln();
    let mut sums = [0.0; KNOTS.len()];
    let first = KNOTS[0].ln();
    if v <= first {
        sums[0] = v - first;
        return sums;
    }
    for (j, pair) in KNOTS.windows(2).enumerate() {
        let (a, b) = (pair[0].ln(), pair[1].ln());
        let t = ((v - a) / (b - a)).clamp(0.0, 1.0);
        // A hat falls and the next one rises within each interval.
        sums[j] += (b - a) * (t - 0.5 * t * t);
        sums[j + 1] += (b - a) * 0.5 * t * t;
    }
    sums
}

/// Returns p at a code.
fn exponent(p: &[f64], code: f64) -> f64 {
    let v = code.max(1.0).ln();
    let interval = KNOTS.windows(2).position(|pair| v < pair[1].ln());
    let Some(j) = interval else {
        return p[KNOTS.len() - 1];
    };
    let (a, b) = (KNOTS[j].ln(), KNOTS[j + 1].ln());
    let t = ((v - a) / (b - a)).clamp(0.0, 1.0);
    p[j] * (1.0 - t) + p[j + 1] * t
}

/// The samples as linear equations of the exponents and the exposures' errors.
pub(super) struct Problem<'a> {
    samples: &'a [Sample],
    exposures: &'a [f64],
    /// Variance of the exposures' logarithms.
    exposure_variance: f64,
    rows: Vec<Vec<f64>>,
}

/// A solution for one smoothness.
pub(super) struct Solved {
    x: Vec<f64>,
    covariance: Matrix,
    weights: Vec<f64>,
    pub evidence: f64,
}

impl<'a> Problem<'a> {
    pub fn new(gathered: &'a SeriesGatherer, exposure_sigma: f64) -> Self {
        let unknowns = KNOTS.len() + gathered.exposures.len();
        let row = |s: &Sample| {
            let mut row = vec![0.0; unknowns];
            row[..KNOTS.len()].copy_from_slice(&slopes(s.shorter.0, s.longer.0));
            row[KNOTS.len() + s.pair.0] = -1.0;
            row[KNOTS.len() + s.pair.1] = 1.0;
            row
        };
        Self {
            samples: gathered.samples(),
            exposures: &gathered.exposures,
            exposure_variance: exposure_sigma.max(1e-6).powi(2),
            rows: gathered.samples().iter().map(row).collect(),
        }
    }

    /// Returns the logarithm of the ratio of a sample's exposures.
    fn ratio(&self, s: &Sample) -> f64 {
        self.exposures[s.pair.0] - self.exposures[s.pair.1]
    }

    /// Returns the prior as normal equations; `tau` is the standard deviation of the change of p from
    /// knot to knot.
    fn prior(&self, tau: f64) -> (Matrix, Vec<f64>) {
        let n = KNOTS.len() + self.exposures.len();
        let (mut a, mut b) = (Matrix::zeros(n, n), vec![0.0; n]);
        let anchor = PRIOR_SIGMA.powi(-2) / KNOTS.len() as f64;
        for j in 0..KNOTS.len() {
            a[(j, j)] += anchor;
            b[j] += anchor * PRIOR_MEAN;
        }
        for j in 1..KNOTS.len() {
            let mut row = vec![0.0; n];
            (row[j - 1], row[j]) = (-1.0, 1.0);
            a.add_outer(tau.powi(-2), &row, &row);
        }
        for i in KNOTS.len()..n {
            a[(i, i)] += 1.0 / self.exposure_variance;
        }
        // All exponents and exposures could shrink together, and every residual with them. The
        // exposures' errors are constrained to have no such component; its possible magnitude is
        // added to the curve's error.
        let (mean, _) = self.exposure_spread();
        let (mut sum, mut scale) = (vec![0.0; n], vec![0.0; n]);
        for (i, e) in self.exposures.iter().enumerate() {
            sum[KNOTS.len() + i] = 1.0;
            scale[KNOTS.len() + i] = e - mean;
        }
        a.add_outer(CONSTRAINT, &sum, &sum);
        a.add_outer(CONSTRAINT, &scale, &scale);
        (a, b)
    }

    /// Returns the mean of the exposures' logarithms, and the root of the sum of squares about it.
    fn exposure_spread(&self) -> (f64, f64) {
        let count = self.exposures.len() as f64;
        let mean = self.exposures.iter().sum::<f64>() / count;
        let squares = self.exposures.iter().map(|e| (e - mean).powi(2));
        (mean, squares.sum::<f64>().sqrt())
    }

    /// Solves with the smoothness `tau`; `None` if the equations are singular.
    pub fn solve(&self, tau: f64) -> Option<Solved> {
        let (prior, right) = self.prior(tau);
        let mut x = vec![0.0; right.len()];
        x[..KNOTS.len()].fill(PRIOR_MEAN);
        let mut solved = None;
        for _ in 0..8 {
            let weights = self.weights(&x);
            let (mut a, mut b) = (prior.clone(), right.clone());
            for ((s, row), &w) in self.samples.iter().zip(&self.rows).zip(&weights) {
                if w > 0.0 {
                    a.add_outer(w, row, row);
                    for (slot, j) in b.iter_mut().zip(row) {
                        *slot += w * j * self.ratio(s);
                    }
                }
            }
            let factor = a.cholesky()?;
            x = factor.solve(&b);
            solved = Some((factor.inverse(), a, weights));
        }
        let (covariance, a, weights) = solved?;
        let evidence = self.evidence(&x, &prior, &a, &weights)?;
        Some(Solved {
            x,
            covariance,
            weights,
            evidence,
        })
    }

    fn residual(&self, x: &[f64], i: usize) -> f64 {
        let predicted: f64 = self.rows[i].iter().zip(x).map(|(r, x)| r * x).sum();
        self.ratio(&self.samples[i]) - predicted
    }

    fn variance(&self, x: &[f64], s: &Sample) -> f64 {
        let one = |(code, variance): (f64, f64)| {
            (exponent(x, code).clamp(0.3, 6.0) / code).powi(2) * variance
        };
        one(s.longer) + one(s.shorter) + FLOOR * FLOOR
    }

    /// Returns the inverse variances times Tukey's weights, reduced for the samples' correlation.
    fn weights(&self, x: &[f64]) -> Vec<f64> {
        let scaled: Vec<f64> = self
            .samples
            .iter()
            .enumerate()
            .map(|(i, s)| self.residual(x, i) / self.variance(x, s).sqrt())
            .collect();
        let scale = (1.4826 * median_absolute(scaled.iter().copied())).max(1.0);
        let weight = |(s, r): (&Sample, &f64)| {
            let variance = self.variance(x, s) * scale * scale * CORRELATED_SAMPLES;
            tukey_weight(r / (scale * TUKEY)) / variance
        };
        self.samples.iter().zip(&scaled).map(weight).collect()
    }

    /// Returns the logarithm of the marginal likelihood, less terms that do not depend on the prior.
    fn evidence(&self, x: &[f64], prior: &Matrix, a: &Matrix, weights: &[f64]) -> Option<f64> {
        let misfit: f64 = (0..weights.len())
            .map(|i| weights[i] * self.residual(x, i).powi(2))
            .sum();
        let mut from_mean = x.to_vec();
        from_mean[..KNOTS.len()]
            .iter_mut()
            .for_each(|p| *p -= PRIOR_MEAN);
        let product = prior.times_vector(&from_mean);
        let prior_misfit: f64 = product.iter().zip(&from_mean).map(|(a, b)| a * b).sum();
        Some(
            0.5 * (prior.cholesky()?.log_determinant()
                - a.cholesky()?.log_determinant()
                - misfit
                - prior_misfit),
        )
    }

    /// Returns the curve of a solution.
    pub fn curve(&self, solved: &Solved) -> Curve {
        let p: Vec<f64> = solved.x[..KNOTS.len()]
            .iter()
            .map(|p| p.max(0.05))
            .collect();
        let g = |row: &[f64]| -row.iter().zip(&p).map(|(r, p)| r * p).sum::<f64>();
        let rows: Vec<[f64; KNOTS.len()]> = (0..256)
            .map(|z| slopes(f64::from(z).max(0.25), 255.0))
            .collect();
        let mut table = [0.0f32; 256];
        for (slot, row) in table.iter_mut().zip(&rows).skip(1) {
            *slot = g(row).exp() as f32;
        }
        make_strictly_increasing(&mut table);
        let anchor = rows[ANCHOR];
        let common = (self.exposure_variance.sqrt() / self.exposure_spread().1).min(1.0);
        let sigma = |row: &[f64; KNOTS.len()]| {
            let mut difference: Vec<f64> = row.iter().zip(anchor).map(|(r, a)| r - a).collect();
            difference.resize(solved.x.len(), 0.0);
            let projected = solved.covariance.times_vector(&difference);
            let variance: f64 = projected.iter().zip(&difference).map(|(a, b)| a * b).sum();
            (variance.max(0.0) + (common * (g(row) - g(&anchor))).powi(2)).sqrt()
        };
        let mut relative_sigma: Vec<f64> = rows.iter().map(sigma).collect();
        relative_sigma[0] = f64::INFINITY;
        self.describe(solved, table, relative_sigma)
    }

    fn describe(&self, solved: &Solved, table: [f32; 256], relative_sigma: Vec<f64>) -> Curve {
        let kept = || (0..self.samples.len()).filter(|i| solved.weights[*i] > 0.0);
        let codes = |f: fn(f64, f64) -> f64, start: f64| {
            kept().fold(start, |a, i| {
                f(f(a, self.samples[i].longer.0), self.samples[i].shorter.0)
            })
        };
        let used = kept().count();
        let residual = |i: usize| self.residual(&solved.x, i);
        let every = used.div_ceil(600).max(1);
        Curve {
            // The table increases by construction, so that sRGB never replaces it.
            response: Response::from_table(&table).unwrap_or_else(|_| Response::srgb()),
            relative_sigma,
            code_range: (codes(f64::min, 255.0), codes(f64::max, 0.0)),
            used,
            rms: (kept().map(|i| residual(i).powi(2)).sum::<f64>() / used.max(1) as f64).sqrt(),
            residuals: kept()
                .step_by(every)
                .map(|i| (self.samples[i].longer.0, residual(i)))
                .collect(),
        }
    }
}

/// Makes a non-decreasing table strictly increasing in single precision.
fn make_strictly_increasing(table: &mut [f32; 256]) {
    table[255] = 1.0;
    for i in (0..255).rev() {
        if table[i] >= table[i + 1] {
            table[i] = table[i + 1].next_down();
        }
        table[i] = table[i].max(0.0);
    }
    for i in 1..255 {
        if table[i] <= table[i - 1] {
            table[i] = table[i - 1].next_up();
        }
    }
}
