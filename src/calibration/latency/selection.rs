//! Selects the pairs of pictures to compare, and accepts or rejects the minimum found.

use super::model::{ClockOffset, LatencyError};
use super::scan;
use super::track::TrackerTrack;

/// Minimum number of samples.
const MIN_SAMPLES: usize = 40;
/// Interval over which rotations are compared, seconds: over one frame they are hardly larger than
/// the tracker's noise.
pub(super) const SPAN: f64 = 0.25;
/// Maximum error of the rough offset, seconds.
const MAX_ROUGH_ERROR: f64 = 0.015;
/// Minimum correlation.
const MIN_CORRELATION: f64 = 0.5;
/// Maximum 1σ, seconds.
const MAX_SIGMA: f64 = 0.01;

/// Returns the indices of the spans that lie within the track at every offset.
pub(super) fn spans_within(
    track: &TrackerTrack,
    spans: &[(f64, f64)],
    range: f64,
) -> Result<Vec<usize>, LatencyError> {
    let (first, last) = track.span();
    let kept: Vec<usize> = (0..spans.len())
        .filter(|&i| {
            let (from, to) = spans[i];
            to > from && from - range >= first && to + range <= last
        })
        .collect();
    if kept.len() < MIN_SAMPLES {
        return Err(LatencyError::TooShort {
            samples: kept.len(),
            needed: MIN_SAMPLES,
        });
    }
    Ok(kept)
}

/// Keeps the spans that have tracker readings close to both ends at about this offset.
pub(super) fn covered_spans(
    track: &TrackerTrack,
    spans: &[(f64, f64)],
    mut kept: Vec<usize>,
    offset: f64,
) -> Result<Vec<usize>, LatencyError> {
    let is_covered = |time: f64| {
        let errors = [-MAX_ROUGH_ERROR, 0.0, MAX_ROUGH_ERROR];
        errors.iter().all(|d| track.covers(time + offset + d))
    };
    kept.retain(|&i| is_covered(spans[i].0) && is_covered(spans[i].1));
    if kept.len() < MIN_SAMPLES {
        return Err(LatencyError::TooShort {
            samples: kept.len(),
            needed: MIN_SAMPLES,
        });
    }
    Ok(kept)
}

/// Converts a minimum into an offset, or returns why it is rejected; `fitted` is the number of
/// parameters fitted along with the offset.
pub(super) fn accept_minimum(
    found: Option<scan::Minimum>,
    range: f64,
    independent: f64,
    (fitted, samples): (f64, usize),
) -> Result<ClockOffset, LatencyError> {
    let Some(mut found) = found else {
        return Err(LatencyError::Uncorrelated { percent: 0.0 });
    };
    // Corrects the scatter for the degrees of freedom that the fitted parameters take.
    let correction = independent / (independent - fitted).max(0.1);
    found.sigma *= correction.max(1.0).sqrt();
    if found.correlation < MIN_CORRELATION {
        return Err(LatencyError::Uncorrelated {
            percent: 100.0 * found.correlation,
        });
    }
    if found.at_edge {
        return Err(LatencyError::OutOfRange { seconds: range });
    }
    if let Some(second) = found.rival {
        return Err(LatencyError::Ambiguous {
            first: found.offset,
            second,
        });
    }
    if found.sigma.is_nan() || found.sigma > MAX_SIGMA {
        return Err(LatencyError::Uncertain {
            millis: 1e3 * found.sigma,
        });
    }
    Ok(ClockOffset {
        seconds: found.offset,
        sigma: found.sigma,
        correlation: found.correlation,
        samples,
    })
}

/// Returns the number of independent spans; overlapping spans are dependent.
pub(super) fn independent_count(spans: &[(f64, f64)], kept: &[usize]) -> f64 {
    let length: f64 = kept.windows(2).map(|w| spans[w[1]].0 - spans[w[0]].0).sum();
    length / SPAN
}
