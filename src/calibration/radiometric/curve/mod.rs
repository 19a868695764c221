//! A camera's tone curve from pictures of the same thing under different exposures.
//!
//! As Debevec and Malik (SIGGRAPH 1997): g(z₁) − g(z₂) = ln (t₁ / t₂) for the codes of a
//! place under two exposures, g the logarithm of the curve. What is solved for is not g but its
//! slope over ln z, the local exponent p: constant for a pure gamma, rising from 1 to 2.3 for
//! sRGB, so that "smooth" means a plausible camera, and p > 0 makes the curve rise. How smooth is
//! told by the data's own likelihood (MacKay, Neural Computation 4, 1992). The exposures may be
//! known only roughly: then they are unknowns with a prior (Mitsunaga and Nayar, CVPR 1999, have
//! to assume as much).

mod gather;
mod solve;

pub use gather::{Sample, SeriesGatherer};

use penumbra_camera::Response;
use penumbra_numerics::median;
use solve::Problem;
use thiserror::Error;

/// How far p may change from knot to knot, to choose from.
const SMOOTHNESS: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.4, 0.8];
/// Places that are needed.
const FEWEST: usize = 60;
/// The code to which errors are told.
const ANCHOR: usize = 128;
/// What compression does to a curve, relative; no number of samples removes it.
const SYSTEMATIC: f64 = 0.01;

/// A tone curve.
#[derive(Clone, Debug)]
pub struct Curve {
    /// It.
    pub response: Response,
    /// Standard error of every code's linear value over that of code 128, relative; of code 0
    /// infinite. What all have in common is part of the exposure.
    pub relative_sigma: Vec<f64>,
    /// Codes that were seen, least and greatest.
    pub seen: (f64, f64),
    /// Places behind it, after outliers were thrown out.
    pub used: usize,
    /// Root mean square of what is left, in logarithms of light.
    pub rms: f64,
    /// Stops by which the exposures turned out to differ from what was said.
    pub exposure_off: Vec<f64>,
    /// Mean of what is left in red, green and blue, in logarithms of light: one curve for all.
    pub by_channel: [f64; 3],
    /// Code and what is left there, in logarithms of light.
    pub residuals: Vec<(f64, f64)>,
}

/// Why there is none.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum NoCurve {
    /// Nothing differs.
    #[error("all pictures have the same exposure; vary it by two stops or more")]
    OneExposure,
    /// Not enough places.
    #[error(
        "{places} even places are well exposed in two pictures, 60 are needed; step the exposure \
         less, or show something with more shades"
    )]
    TooFew {
        /// How many are.
        places: usize,
    },
    /// The codes did not follow the exposure.
    #[error(
        "the pictures hardly change with the exposure they are said to have; switch automatic \
         exposure off, or correct the exposures"
    )]
    Alike,
    /// Darker where longer.
    #[error("longer exposures give darker pictures; name the exposures in the pictures' order")]
    Reversed,
    /// Not a curve of one camera in steady light.
    #[error(
        "the pictures contradict each other by {percent:.0} %; keep camera and light still during \
         the series"
    )]
    Inconsistent {
        /// Root mean square of what is left.
        percent: f64,
    },
}

/// What is left may not be more, relative.
const WORST_RMS: f64 = 0.12;

/// Fits the curve; `exposure_sigma` is how well the exposures are known, relative.
///
/// # Errors
/// The samples cannot tell one: see [`NoCurve`].
pub fn fit(gathered: &SeriesGatherer, exposure_sigma: f64) -> Result<Curve, NoCurve> {
    if gathered.exposures.len() < 2 {
        return Err(NoCurve::OneExposure);
    }
    let samples = gathered.samples();
    if samples.len() < FEWEST {
        return Err(NoCurve::TooFew {
            places: samples.len(),
        });
    }
    follows(samples)?;
    let problem = Problem::new(gathered, exposure_sigma);
    let fits = SMOOTHNESS.iter().filter_map(|&tau| problem.solve(tau));
    let best = fits.max_by(|a, b| a.evidence.total_cmp(&b.evidence));
    let best = best.ok_or(NoCurve::TooFew {
        places: samples.len(),
    })?;
    let curve = problem.curve(&best);
    if curve.rms > WORST_RMS {
        return Err(NoCurve::Inconsistent {
            percent: 100.0 * curve.rms,
        });
    }
    Ok(curve)
}

/// Whether codes rise with exposure at all.
fn follows(samples: &[Sample]) -> Result<(), NoCurve> {
    let ratios = samples.iter().map(|s| (s.longer.0 / s.shorter.0).ln());
    let middle = median(ratios).unwrap_or(0.0);
    if middle < -0.02 {
        return Err(NoCurve::Reversed);
    }
    if middle < 0.02 {
        return Err(NoCurve::Alike);
    }
    Ok(())
}

impl Curve {
    /// How far another curve lies from this one: root mean square over the codes that were seen,
    /// relative, and the most in units of this one's own error.
    #[must_use]
    pub fn apart(&self, other: &Response) -> (f64, f64) {
        let (low, high) = (
            self.seen.0.max(8.0) as usize,
            (self.seen.1 as usize).min(254),
        );
        let (own, other) = (self.response.linear_from_code(), other.linear_from_code());
        let (mut n, mut sum, mut worst) = (0.0, 0.0, 0.0f64);
        // What differs by a factor is no other curve.
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

    /// The largest standard error over the codes from 16 to 250, relative.
    #[must_use]
    pub fn largest_sigma(&self) -> f64 {
        self.relative_sigma[16..=250]
            .iter()
            .copied()
            .fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests;
