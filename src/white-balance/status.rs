//! The white balance as the status and reports show it.

use super::gains::GainEstimate;
use super::overlap::Shortage;
use super::settings::{Provenance, WhiteBalanceMethod};
use glam::DVec3;
use serde::Serialize;

/// Two methods disagree where they differ by more than this (relative) …
const DISAGREEMENT: f64 = 0.05;
/// … and by more than this many standard errors.
const DISAGREEMENT_SIGMAS: f64 = 3.0;

/// State of the white balance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MatchStatus {
    /// Requested method.
    pub wanted: WhiteBalanceMethod,
    /// Source of the active gains.
    pub in_force: Provenance,
    /// Gains for the present exposures: scene = gains × environment, linear.
    pub gains: [f64; 3],
    /// Standard error of the gains, percent; null where unknown.
    pub uncertainty_percent: Option<[f64; 3]>,
    /// Rows of the 3×3 matrix that is used instead of the gains, at the reference exposures.
    pub matrix: Option<[[f64; 3]; 3]>,
    /// Factor by which the reported exposures have changed the gains since the reference.
    pub exposure_factor: f64,
    /// Whether the active gains are an old value of the overlap.
    pub frozen: bool,
    /// Why the last pair of frames was not used by the overlap.
    pub overlap_frozen: Option<Shortage>,
    /// Number of patches that both cameras saw in the last pair of frames that was used.
    pub overlap_pairs: Option<usize>,
    /// Mean over the chart's patches of the CIEDE2000 that remains between the two pictures.
    pub chart_residual_delta_e: Option<f64>,
    /// Every method that has gains.
    pub methods: Vec<MethodStatus>,
    /// One line for the user: a problem and what to do; null where there is none.
    pub notice: Option<String>,
}

/// Gains of one method, compared with the active gains.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodStatus {
    /// The method.
    pub method: Provenance,
    /// Gains at the reference exposures.
    pub gains: [f64; 3],
    /// Standard error, percent; null where unknown.
    pub uncertainty_percent: Option<[f64; 3]>,
    /// Largest difference of a channel from the active gains, percent.
    pub disagreement_percent: f64,
    /// CIEDE2000 between a grey (linear 0.5) under these and under the active gains.
    pub disagreement_delta_e: f64,
    /// Whether the difference is larger than the standard errors explain.
    pub disagrees: bool,
}

impl MethodStatus {
    pub(crate) fn new(
        method: Provenance,
        estimate: &GainEstimate,
        in_force: &GainEstimate,
    ) -> Self {
        let log_ratio = (estimate.gains / in_force.gains).ln().abs();
        let variance = estimate.relative_sd.powf(2.0) + in_force.relative_sd.powf(2.0);
        let beyond = |c: usize| {
            log_ratio[c] > DISAGREEMENT && log_ratio[c] > DISAGREEMENT_SIGMAS * variance[c].sqrt()
        };
        Self {
            method,
            gains: estimate.gains.to_array(),
            uncertainty_percent: percent(estimate.relative_sd),
            disagreement_percent: estimate.percent_from(in_force.gains).abs().max_element(),
            disagreement_delta_e: estimate.delta_e_from(in_force.gains),
            disagrees: (0..3).any(beyond),
        }
    }
}

/// Converts to percent; `None` for infinite uncertainty.
pub(crate) fn percent(relative: DVec3) -> Option<[f64; 3]> {
    relative.is_finite().then(|| (100.0 * relative).to_array())
}
