//! Gains and their uncertainty.

use super::colour::delta_e_of_gain_error;
use glam::DVec3;

/// Relative errors of the overlap that its standard error does not contain: surfaces that are not
/// matt, pictures of different instants.
const LIVE_FLOOR: f64 = 0.015;
/// Calibration and live gains are inconsistent where they differ by more than this many standard
/// errors of their difference.
const DRIFT_SIGMAS: f64 = 3.0;

/// Gains and their standard errors: `scene = gains × environment`, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainEstimate {
    /// Per channel.
    pub gains: DVec3,
    /// Standard error of each gain, relative (0.01 = 1 %).
    pub relative_sd: DVec3,
}

impl GainEstimate {
    /// Converts an estimate of the remaining correction, made with light to which `applied` gains
    /// had already been applied, to an estimate of the complete gains.
    #[must_use]
    pub fn after(&self, applied: DVec3) -> Self {
        Self {
            gains: self.gains * applied,
            ..*self
        }
    }

    /// Relative difference per channel from `other`, in percent of `other`.
    #[must_use]
    pub fn percent_from(&self, other: DVec3) -> DVec3 {
        100.0 * (self.gains / other - 1.0)
    }

    /// CIEDE2000 of a mid-bright grey (linear 0.5) under these gains instead of `other`.
    #[must_use]
    pub fn delta_e_from(&self, other: DVec3) -> f64 {
        delta_e_of_gain_error(self.gains / other, 0.5)
    }

    /// Combines calibrated gains with the `live` gains of the overlap. Where the two are
    /// consistent, each is weighted by the inverse of its variance. Where they are not, the
    /// calibration is out of date (the white balance or the exposure was changed): its variance is
    /// raised by the square of the excess difference, so that the live gains take over without a
    /// jump.
    #[must_use]
    pub(crate) fn followed_by(&self, live: &Self) -> Self {
        let mut fused = *self;
        for c in 0..3 {
            let difference = (live.gains[c] / self.gains[c]).ln();
            let own = self.relative_sd[c].powi(2);
            let theirs = live.relative_sd[c].max(LIVE_FLOOR).powi(2);
            let allowed = DRIFT_SIGMAS * (own + theirs).sqrt();
            let beyond = (difference.abs() - allowed).max(0.0);
            let own = own + beyond * beyond;
            let weight = own / (own + theirs);
            fused.gains[c] = self.gains[c] * (weight * difference).exp();
            fused.relative_sd[c] = (own * theirs / (own + theirs)).sqrt();
        }
        fused
    }
}
