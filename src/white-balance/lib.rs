//! One white point and one exposure for two cameras: `scene = gain × environment`, linear,
//! per channel.
//!
//! Three ways that check one another: [`chart`] compares two pictures of the same colour
//! chart; [`gather`] finds what both cameras see right now and [`overlap`] compares it,
//! smoothed in time; [`reflectance`] predicts the colour of a known surface from the
//! measured light. [`PhotometricMatch`] says which of them is in force. A mirrored
//! sphere's reflectance is no part of the gains: the environment code divides by it.

pub mod chart;
pub mod colour;
mod exposure;
mod fusion;
pub mod gather;
mod matrix;
pub mod overlap;
pub mod reflectance;
mod robust;
mod view;

pub use exposure::ExposureRatio;
pub use fusion::{
    CalibratedGains, MatchMethod, MatchStatus, MethodStatus, PhotometricMatch, PhotometrySettings,
    Provenance,
};

use crate::colour::delta_e_of_gain_error;
use glam::DVec3;

/// Gains and how well they are known: `scene = gains × environment`, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainEstimate {
    /// Per channel.
    pub gains: DVec3,
    /// Standard error of each gain, relative (0.01 = 1 %).
    pub relative_sd: DVec3,
}

impl GainEstimate {
    /// An estimate of what is still missing, made with light that `applied` gains have
    /// gone into already, as an estimate of the whole gains.
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
}
