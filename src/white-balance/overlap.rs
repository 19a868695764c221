//! Gains from surfaces that both cameras see now, filtered over time.

use super::gains::GainEstimate;
use super::gather::PhotometricPair;
use super::robust_mean::{LogRatio, RobustMean, robust_mean};
use glam::DVec3;
use penumbra_interface::MonotonicTime;
use serde::Serialize;

/// Gains of one pair of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverlapEstimate {
    /// The gains at the exposures of the pair.
    pub estimate: GainEstimate,
    /// Number of patches that were used, in the channel with the fewest.
    pub pairs: usize,
    /// Number of clusters to which these belong, in the channel with the fewest.
    pub clusters: usize,
    /// Robust standard deviation (1.4826 MAD) of the patches, relative.
    pub spread: f64,
    /// Mean ln of the environment camera's values: its change is the change of the light.
    pub log_brightness: DVec3,
}

/// Why a pair of frames was not used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "why", rename_all = "snake_case")]
pub enum Shortage {
    /// Too few surfaces are seen by both cameras.
    TooFew {
        /// Number of patches.
        pairs: usize,
        /// Number of clusters of patches.
        clusters: usize,
    },
    /// The patches are inconsistent: the geometry is wrong, or something hides the surfaces.
    Inconsistent {
        /// Their robust standard deviation, percent.
        spread_percent: f64,
    },
    /// The gains jumped; the new gains are used once they persist.
    Jump {
        /// Size of the jump in the channel with the largest, percent.
        percent: f64,
    },
}

/// Minimum number of patches.
const MIN_PAIRS: usize = 24;
/// Minimum number of clusters: fewer could all lie in one shadow.
const MIN_CLUSTERS: usize = 5;
/// Maximum relative standard deviation; beyond it the patches do not show the same surfaces.
const MAX_SPREAD: f64 = 0.35;
/// Relative error that averaging does not reduce: registration, mirror reflectance, vignetting.
const SYSTEMATIC: f64 = 0.01;
/// Such an error within one cluster: a surface that is not matt, and JPEG's chroma.
const CLUSTER_SYSTEMATIC: f64 = 0.03;
/// Relative standard deviation of the correction for light that changes between the pictures.
const CORRECTION_SD: f64 = 0.5;

/// Estimates robust gains from one pair of frames.
///
/// # Errors
/// There are fewer than 24 patches or 5 clusters, or the patches are inconsistent.
pub fn estimate_overlap(all: &[PhotometricPair]) -> Result<OverlapEstimate, Shortage> {
    let channels = [0, 1, 2].map(|c| robust_mean(&log_ratios(all, c)));
    let [Some(r), Some(g), Some(b)] = channels else {
        return Err(Shortage::TooFew {
            pairs: 0,
            clusters: 0,
        });
    };
    let channels = [r, g, b];
    let fewest = |f: fn(&RobustMean) -> usize| channels.iter().map(f).min().unwrap_or(0);
    let (pairs, clusters) = (fewest(|m| m.inliers), fewest(|m| m.clusters));
    if pairs < MIN_PAIRS || clusters < MIN_CLUSTERS {
        return Err(Shortage::TooFew { pairs, clusters });
    }
    let spread = channels.iter().map(|m| m.spread).fold(0.0, f64::max);
    if spread > MAX_SPREAD {
        return Err(Shortage::Inconsistent {
            spread_percent: 100.0 * spread,
        });
    }
    Ok(OverlapEstimate {
        estimate: GainEstimate {
            gains: DVec3::new(r.mean, g.mean, b.mean).exp(),
            relative_sd: DVec3::new(r.sd, g.sd, b.sd),
        },
        pairs,
        clusters,
        spread,
        log_brightness: mean_log_brightness(all),
    })
}

fn mean_log_brightness(pairs: &[PhotometricPair]) -> DVec3 {
    let sum: DVec3 = pairs
        .iter()
        .map(|pair| pair.environment.max(DVec3::splat(1e-6)).ln())
        .sum();
    sum / pairs.len().max(1) as f64
}

fn log_ratios(pairs: &[PhotometricPair], channel: usize) -> Vec<LogRatio> {
    pairs
        .iter()
        .filter(|pair| pair.variance[channel].is_finite())
        .map(|pair| LogRatio {
            value: (pair.scene[channel] / pair.environment[channel]).ln(),
            variance: pair.variance[channel],
            cluster: pair.cluster,
        })
        .collect()
}

/// Times and exposures of the two pictures of a pair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairTiming {
    /// Middle of the scene camera's exposure.
    pub scene_at: MonotonicTime,
    /// Middle of the environment camera's exposure.
    pub environment_at: MonotonicTime,
    /// [`ExposureRatio::factor`](super::ExposureRatio::factor) of the pair.
    pub exposure_factor: f64,
}

/// Drift of the gains and acceptance of jumps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothingOptions {
    /// Random walk of the gains, relative per √second, for automatic white balance.
    pub drift: f64,
    /// Number of standard deviations beyond which a measurement counts as a jump.
    pub gate: f64,
    /// Number of consecutive measurements that must confirm a jump.
    pub patience: u32,
}

impl Default for SmoothingOptions {
    fn default() -> Self {
        Self {
            drift: 0.01,
            gate: 4.0,
            patience: 5,
        }
    }
}

/// Kalman filter on the logarithm of each channel's gain. It keeps its value while pairs of frames
/// are not usable.
#[derive(Clone, Debug)]
pub struct GainTracker {
    options: SmoothingOptions,
    state: Option<State>,
    /// The measurement that jumped, and the number of consecutive measurements that confirm it.
    jump: Option<(DVec3, u32)>,
    frozen: Option<Shortage>,
    last: Option<(OverlapEstimate, PairTiming)>,
}

#[derive(Clone, Copy, Debug)]
struct State {
    log_gains: DVec3,
    variance: DVec3,
    measured_at: MonotonicTime,
}

impl GainTracker {
    /// Creates a filter without measurements.
    #[must_use]
    pub fn new(options: SmoothingOptions) -> Self {
        Self {
            options,
            state: None,
            jump: None,
            frozen: None,
            last: None,
        }
    }

    /// Adds the gains of one pair of frames. The filter's gains hold for the reference exposures.
    pub fn update(&mut self, answer: Result<OverlapEstimate, Shortage>, timing: PairTiming) {
        match answer {
            Ok(measured) => {
                let change = self.light_change(&measured, &timing);
                self.measure(&measured.estimate, change, &timing);
                self.last = Some((measured, timing));
            }
            Err(shortage) => self.frozen = Some(shortage),
        }
    }

    /// Change of ln of the light from the environment picture to the scene picture, extrapolated
    /// from the environment camera's last two pictures.
    fn light_change(&self, measured: &OverlapEstimate, timing: &PairTiming) -> DVec3 {
        let Some((last, before)) = &self.last else {
            return DVec3::ZERO;
        };
        let seconds = timing.environment_at.seconds_since(before.environment_at);
        let skew = timing.scene_at.seconds_since(timing.environment_at);
        let comparable = timing.exposure_factor == before.exposure_factor;
        if !comparable || seconds <= 0.0 || seconds > 0.5 || skew.abs() > seconds {
            return DVec3::ZERO;
        }
        (measured.log_brightness - last.log_brightness) * (skew / seconds)
    }

    // ┌ Per channel, x = ln gain:  P⁻ = P + q² Δt,  K = P⁻ / (P⁻ + R),                      ┐
    // └ x ← x + K (z − x),  P ← (1 − K) P⁻   (Kalman 1960)                                   ┘
    fn measure(&mut self, measured: &GainEstimate, change: DVec3, timing: &PairTiming) {
        let (at, sd) = (timing.environment_at, measured.relative_sd);
        let z = (measured.gains / timing.exposure_factor).ln() - change;
        let r = sd * sd + (CORRECTION_SD * change) * (CORRECTION_SD * change);
        if !z.is_finite() || !r.is_finite() {
            return;
        }
        let Some(state) = self.state else {
            return self.restart(z, r, at);
        };
        let seconds = at.seconds_since(state.measured_at).max(0.0);
        let predicted = state.variance + self.options.drift.powi(2) * seconds;
        let innovation = z - state.log_gains;
        let expected = (predicted + r + SYSTEMATIC * SYSTEMATIC).sqrt();
        if (innovation / expected).abs().max_element() > self.options.gate {
            return self.confirm_jump(z, r, innovation, at);
        }
        let gain = predicted / (predicted + r);
        self.state = Some(State {
            log_gains: state.log_gains + gain * innovation,
            variance: (DVec3::ONE - gain) * predicted,
            measured_at: at,
        });
        (self.jump, self.frozen) = (None, None);
    }

    /// Waits until a jump persists, so that a hand in the picture does not change the light.
    fn confirm_jump(&mut self, z: DVec3, r: DVec3, innovation: DVec3, at: MonotonicTime) {
        let near = |first: DVec3| (z - first).abs().max_element() < 0.1;
        let count = match self.jump {
            Some((first, count)) if near(first) => count + 1,
            _ => 1,
        };
        if count >= self.options.patience {
            return self.restart(z, r, at);
        }
        let first = self
            .jump
            .filter(|_| count > 1)
            .map_or(z, |(first, _)| first);
        self.jump = Some((first, count));
        self.frozen = Some(Shortage::Jump {
            percent: 100.0 * innovation.abs().max_element().exp_m1(),
        });
    }

    fn restart(&mut self, z: DVec3, r: DVec3, at: MonotonicTime) {
        self.state = Some(State {
            log_gains: z,
            variance: r,
            measured_at: at,
        });
        (self.jump, self.frozen) = (None, None);
    }

    /// The gains at the reference exposures; `None` before the first measurement. The standard
    /// error includes systematic errors.
    #[must_use]
    pub fn estimate(&self) -> Option<GainEstimate> {
        let clusters = self.last().map_or(1, |last| last.clusters.max(1)) as f64;
        let systematic = SYSTEMATIC.powi(2) + CLUSTER_SYSTEMATIC.powi(2) / clusters;
        self.state.map(|state| GainEstimate {
            gains: state.log_gains.exp(),
            relative_sd: (state.variance + systematic).sqrt(),
        })
    }

    /// Why the last pair of frames was not used; `None` if it was.
    #[must_use]
    pub const fn frozen(&self) -> Option<Shortage> {
        self.frozen
    }

    /// The last usable pair of frames.
    #[must_use]
    pub fn last(&self) -> Option<&OverlapEstimate> {
        self.last.as_ref().map(|(estimate, _)| estimate)
    }

    /// When the gains were last measured.
    #[must_use]
    pub fn measured_at(&self) -> Option<MonotonicTime> {
        self.state.map(|state| state.measured_at)
    }
}

#[cfg(test)]
mod tests;
