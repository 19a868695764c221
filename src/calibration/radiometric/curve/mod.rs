//! A camera's tone curve from pictures of a static scene under different exposures.
//!
//! As in Debevec and Malik (SIGGRAPH 1997), g(z₁) − g(z₂) = ln (t₁ / t₂) for the codes of a point
//! under two exposures, where g is the logarithm of the curve. The unknown is not g but its slope over
//! ln z, the local exponent p: constant for a pure gamma, rising from 1 to 2.3 for sRGB, so that a
//! smooth p is a plausible camera and p > 0 makes the curve monotonic. The smoothness is chosen by the
//! evidence of the data (MacKay, Neural Computation 4, 1992). Approximate exposures are unknowns with a
//! prior (Mitsunaga and Nayar, CVPR 1999, refine them as well).
//!
//! `gather` collects samples, `solve` fits the exponents, `model` is the result; `agreement` holds a
//! known curve against the samples.

mod agreement;
mod gather;
mod model;
mod solve;

pub use agreement::{disagreement, simplest};
pub use gather::{Sample, SeriesGatherer};
pub use model::Curve;

use penumbra_numerics::median;
use solve::Problem;
use thiserror::Error;

/// Standard deviations of the change of p from knot to knot; the evidence selects one.
const SMOOTHNESS: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.8];
/// Minimum number of samples.
const MIN_SAMPLES: usize = 60;
/// Maximum RMS of the residuals, relative.
const MAX_RMS: f64 = 0.12;

/// Why no tone curve was found.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum NoCurve {
    /// There is only one exposure.
    #[error("all pictures have the same exposure; vary it by two stops or more")]
    OneExposure,
    /// There are too few samples.
    #[error(
        "{samples} uniform areas are well exposed in two pictures, 60 are needed; use smaller steps \
         of exposure, or a scene with more shades"
    )]
    TooFew {
        /// Number of samples.
        samples: usize,
    },
    /// The codes do not change with the exposure.
    #[error(
        "the pictures hardly change with the stated exposures; switch automatic exposure off, or \
         correct the exposures"
    )]
    Unchanged,
    /// Longer exposures are darker.
    #[error("longer exposures give darker pictures; list the exposures in the pictures' order")]
    Reversed,
    /// The samples do not fit one curve.
    #[error(
        "the pictures are inconsistent by {percent:.0} %; keep camera and light constant during the \
         series"
    )]
    Inconsistent {
        /// Root mean square of the residuals, percent.
        percent: f64,
    },
}

/// Fits the curve; `exposure_sigma` is the relative standard deviation of the exposures.
///
/// # Errors
/// There are too few exposures or samples, the codes do not rise with the exposure, or the samples do
/// not fit one curve.
pub fn fit(gathered: &SeriesGatherer, exposure_sigma: f64) -> Result<Curve, NoCurve> {
    if gathered.exposures.len() < 2 {
        return Err(NoCurve::OneExposure);
    }
    let samples = gathered.samples();
    if samples.len() < MIN_SAMPLES {
        return Err(NoCurve::TooFew {
            samples: samples.len(),
        });
    }
    check_order(samples)?;
    let problem = Problem::new(gathered, exposure_sigma);
    let fits = SMOOTHNESS.iter().filter_map(|&tau| problem.solve(tau));
    let best = fits.max_by(|a, b| a.evidence.total_cmp(&b.evidence));
    let best = best.ok_or(NoCurve::TooFew {
        samples: samples.len(),
    })?;
    let curve = problem.curve(&best);
    if curve.rms > MAX_RMS {
        return Err(NoCurve::Inconsistent {
            percent: 100.0 * curve.rms,
        });
    }
    Ok(curve)
}

/// Checks that codes rise with exposure.
fn check_order(samples: &[Sample]) -> Result<(), NoCurve> {
    let ratios = samples.iter().map(|s| (s.longer.0 / s.shorter.0).ln());
    let median_ratio = median(ratios).unwrap_or(0.0);
    if median_ratio < -0.02 {
        return Err(NoCurve::Reversed);
    }
    if median_ratio < 0.02 {
        return Err(NoCurve::Unchanged);
    }
    Ok(())
}

#[cfg(test)]
mod tests;
