//! A measured tone curve.

use penumbra_camera::Response;
use penumbra_numerics::median;

/// The code that the errors are relative to.
pub(super) const ANCHOR: usize = 128;
/// Systematic error of a curve by compression, relative, which no number of samples reduces.
const SYSTEMATIC: f64 = 0.01;

/// A tone curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// The curve.
    pub response: Response,
    /// Relative standard error of the ratio of every code's linear value to that of code 128; infinite
    /// for code 0. A common factor is part of the exposure.
    pub relative_sigma: Vec<f64>,
    /// Minimum and maximum code of the samples.
    pub code_range: (f64, f64),
    /// Number of samples without outliers.
    pub used: usize,
    /// Root mean square of the residuals, logarithms of light.
    pub rms: f64,
    /// Code and residual of some samples, logarithms of light, for the report.
    pub residuals: Vec<(f64, f64)>,
}

impl Curve {
    /// Returns the difference of another curve from this one: root mean square over the codes of the
    /// samples, relative, and the maximum in units of this curve's standard error.
    #[must_use]
    pub fn difference(&self, other: &Response) -> (f64, f64) {
        let (low, high) = (
            self.code_range.0.max(8.0) as usize,
            (self.code_range.1 as usize).min(254),
        );
        let (own, other) = (self.response.linear_from_code(), other.linear_from_code());
        let (mut n, mut sum, mut worst) = (0.0, 0.0, 0.0f64);
        // A constant factor is part of the exposure.
        let ratio = |z: usize| f64::from(other[z] / own[z]).ln();
        let factor = median((low..=high).map(ratio)).unwrap_or(0.0);
        for z in low..=high {
            let difference = ratio(z) - factor;
            n += 1.0;
            sum += difference * difference;
            let from_anchor = (ratio(z) - ratio(ANCHOR)).abs();
            worst = worst.max(from_anchor / self.relative_sigma[z].hypot(SYSTEMATIC));
        }
        ((sum / f64::max(n, 1.0)).sqrt(), worst)
    }

    /// Returns the largest relative standard error over the codes from 16 to 250.
    #[must_use]
    pub fn largest_sigma(&self) -> f64 {
        self.relative_sigma[16..=250]
            .iter()
            .copied()
            .fold(0.0, f64::max)
    }
}
