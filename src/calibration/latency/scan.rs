//! Finds the offset with the least squared residuals, and its standard deviation.

/// Step of the coarse search, seconds.
const COARSE_STEP: f64 = 0.004;
/// Minimum depth of a second minimum that makes the offset ambiguous, relative to the best.
const MIN_RIVAL_DEPTH: f64 = 0.85;
/// Minimum height of the ridge between the two minima, relative to the depth of the best.
const MIN_RIDGE: f64 = 0.3;

/// Distances from the minimum at which its curvature is measured, seconds.
const CURVATURE_STEPS: [f64; 4] = [0.006, 0.012, 0.024, 0.048];

/// Residuals at one offset.
pub(super) struct Fit {
    residuals: Vec<f64>,
    squares: f64,
    /// The expected sum of squares of unrelated motions.
    power: f64,
}

impl Fit {
    pub fn new(residuals: Vec<f64>, power: f64) -> Self {
        Self {
            squares: residuals.iter().map(|r| r * r).sum(),
            residuals,
            power,
        }
    }
}

/// A minimum of the sum of squares; times in seconds.
pub(super) struct Minimum {
    pub offset: f64,
    pub sigma: f64,
    pub correlation: f64,
    /// Whether the minimum is at the limit of the search.
    pub at_edge: bool,
    /// Another offset that fits nearly as well, seconds.
    pub rival: Option<f64>,
    /// The sum of squares at the worst offset, relative to that of unrelated motions.
    pub worst: f64,
}

/// Finds the minimum of the sum of squares over −`range`..`range` seconds; `dimensions` residuals
/// belong to one instant. `None` if no offset can be evaluated.
pub(super) fn scan(
    fit: impl Fn(f64) -> Option<Fit>,
    range: f64,
    dimensions: usize,
) -> Option<Minimum> {
    let steps = (range / COARSE_STEP).ceil() as i32;
    let offset = |i: i32| range * f64::from(i) / f64::from(steps);
    let samples: Vec<(f64, Fit)> = (-steps..=steps)
        .filter_map(|i| Some((offset(i), fit(offset(i))?)))
        .collect();
    let best = (0..samples.len())
        .min_by(|&a, &b| samples[a].1.squares.total_cmp(&samples[b].1.squares))?;
    let at_edge = best == 0 || best + 1 == samples.len();
    let start = samples[best].0;
    let (offset, at_minimum) = if at_edge {
        (start, fit(start)?)
    } else {
        golden_section(&fit, start)?
    };
    let correlation = (1.0 - at_minimum.squares / at_minimum.power.max(1e-300))
        .clamp(0.0, 1.0)
        .sqrt();
    Some(Minimum {
        sigma: sigma(&fit, offset, &at_minimum, dimensions).unwrap_or(f64::INFINITY),
        rival: rival(&samples, best),
        worst: samples.iter().map(|l| l.1.squares).fold(0.0, f64::max)
            / at_minimum.power.max(1e-300),
        offset,
        correlation,
        at_edge,
    })
}

/// Golden-section search between the neighbours of the best step.
fn golden_section(fit: &impl Fn(f64) -> Option<Fit>, start: f64) -> Option<(f64, Fit)> {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    let (mut low, mut high) = (start - COARSE_STEP, start + COARSE_STEP);
    let squares = |x: f64| fit(x).map(|f| f.squares);
    let (mut a, mut b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut at_a, mut at_b) = (squares(a)?, squares(b)?);
    while high - low > 1e-6 {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - GOLDEN * (high - low);
            at_a = squares(a)?;
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + GOLDEN * (high - low);
            at_b = squares(b)?;
        }
    }
    let minimum = 0.5 * (low + high);
    Some((minimum, fit(minimum)?))
}

// ┌ J(τ) = Σ r²; near its minimum τ₀ − τ ≈ Σ r r' / h with h = J'' / 2, so                    ┐
// │ σ² = Var(Σ r r') / h². The variance is that of gᵢ = rᵢ rᵢ' with their correlation in      │
// │ time (Newey & West 1987); r' contains the tracker's noise too, which moves with τ. That   │
// │ noise adds ripples to J, and the minimum lies in the trough of a ripple, whose curvature  │
// └ exceeds that of the motions: h is the least curvature over several distances.             ┘
fn sigma(
    fit: &impl Fn(f64) -> Option<Fit>,
    offset: f64,
    at_minimum: &Fit,
    dimensions: usize,
) -> Option<f64> {
    let step = CURVATURE_STEPS[0];
    let (before, after) = (fit(offset - step)?, fit(offset + step)?);
    let curvature_of = |step: f64, before: f64, after: f64| {
        (before + after - 2.0 * at_minimum.squares) / (2.0 * step * step)
    };
    let mut curvature = curvature_of(step, before.squares, after.squares);
    for step in &CURVATURE_STEPS[1..] {
        let (before, after) = (fit(offset - step)?, fit(offset + step)?);
        curvature = curvature.min(curvature_of(*step, before.squares, after.squares));
    }
    let slopes = before.residuals.iter().zip(&after.residuals);
    let products: Vec<f64> = slopes
        .zip(&at_minimum.residuals)
        .map(|((b, a), r)| r * (a - b) / (2.0 * step))
        .collect();
    let instants: Vec<f64> = products
        .chunks(dimensions)
        .map(|c| c.iter().sum())
        .collect();
    (curvature > 0.0).then(|| long_run_variance(&instants).sqrt() / curvature)
}

/// Returns the variance of the sum of correlated values: Σ over lags of the autocovariance,
/// weighted by a triangle (Newey & West 1987).
fn long_run_variance(values: &[f64]) -> f64 {
    let n = values.len();
    let mean = values.iter().sum::<f64>() / n.max(1) as f64;
    let lags = (n / 8).clamp(1, 30);
    let mut sum = 0.0;
    for lag in 0..lags {
        let product: f64 = values
            .iter()
            .zip(&values[lag.min(n)..])
            .map(|(a, b)| (a - mean) * (b - mean))
            .sum();
        let weight = if lag == 0 {
            1.0
        } else {
            2.0 * (1.0 - lag as f64 / lags as f64)
        };
        sum += weight * product;
    }
    sum.max(0.0)
}

/// Returns another local minimum that is nearly as low.
fn rival(samples: &[(f64, Fit)], best: usize) -> Option<f64> {
    let at = |i: usize| samples[i].1.squares;
    let highest = (0..samples.len()).map(at).fold(0.0, f64::max);
    let threshold = highest - MIN_RIVAL_DEPTH * (highest - at(best));
    (1..samples.len().saturating_sub(1))
        .filter(|&i| i != best && at(i) <= at(i - 1) && at(i) < at(i + 1))
        .filter(|&i| at(i) < threshold)
        .filter(|&i| {
            let between = (i.min(best)..i.max(best)).map(at).fold(0.0, f64::max);
            between > at(best) + MIN_RIDGE * (highest - at(best))
        })
        .min_by(|&a, &b| at(a).total_cmp(&at(b)))
        .map(|i| samples[i].0)
}
