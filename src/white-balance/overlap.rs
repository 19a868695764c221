//! Gains from what both cameras see right now, smoothed in time.

use super::GainEstimate;
use super::gather::PhotometricPair;
use super::robust::{LogRatio, RobustMean, robust_mean};
use glam::DVec3;
use penumbra_interface::MonotonicTime;
use serde::Serialize;

/// One frame pair's answer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OverlapEstimate {
    /// The gains at the exposures of that pair.
    pub estimate: GainEstimate,
    /// Pairs behind the gains: the channel with the fewest.
    pub pairs: usize,
    /// Patches of the picture that these belong to.
    pub clusters: usize,
    /// How much the pairs scatter, relative.
    pub spread: f64,
    /// Mean ln of what the environment camera read: tells how fast the light changes.
    pub log_brightness: DVec3,
}

/// Why a frame pair says too little.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "why", rename_all = "snake_case")]
pub enum Shortage {
    /// Hardly anything is seen by both cameras.
    TooFew {
        /// Pairs found.
        pairs: usize,
        /// Patches of the picture that these belong to.
        clusters: usize,
    },
    /// The pairs contradict one another: wrong geometry, or something stands in the way.
    Inconsistent {
        /// Their scatter, percent.
        spread_percent: f64,
    },
    /// The gains jumped; they are believed once they stay there.
    Jump {
        /// By how much, percent, in the channel that jumped most.
        percent: f64,
    },
}

/// Fewer pairs than this are no evidence.
const MIN_PAIRS: usize = 24;
/// Fewer patches than this could all be in one shadow.
const MIN_CLUSTERS: usize = 5;
/// A scatter larger than this means that the pairs do not show the same surfaces.
const MAX_SPREAD: f64 = 0.35;
/// What no amount of pairs removes: registration, mirror reflectance, lens fall-off.
const SYSTEMATIC: f64 = 0.01;
/// The same within one cluster: how far a surface differs from matt, and JPEG's colour.
const CLUSTER_SYSTEMATIC: f64 = 0.03;
/// How much of a correction for light that changes between the pictures may be wrong.
const CORRECTION_SD: f64 = 0.5;

/// Robust gains of one frame pair.
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

/// When the two pictures of a pair were taken, and how they were exposed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairTiming {
    /// Middle of the scene camera's exposure.
    pub scene_at: MonotonicTime,
    /// Middle of the environment camera's exposure.
    pub environment_at: MonotonicTime,
    /// [`ExposureRatio::factor`](super::ExposureRatio::factor) of the pair.
    pub exposure_factor: f64,
}

/// How fast the gains may change and how soon a jump is believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SmoothingOptions {
    /// Random walk of the gains, relative per √second: automatic white balance drifts.
    pub drift: f64,
    /// Deviations beyond which a measurement is a jump.
    pub gate: f64,
    /// Measurements in a row that must agree on a jump.
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

/// The gains over time: a Kalman filter on the logarithm of each channel's gain, frozen
/// while there is too little to go by.
#[derive(Clone, Debug)]
pub struct GainTracker {
    options: SmoothingOptions,
    state: Option<State>,
    /// The measurement that departed, and how many in a row have agreed with it.
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
    /// Knows nothing yet.
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

    /// Takes one frame pair's answer. The filter holds the gains at the reference
    /// exposures.
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

    /// By how much ln of the light has changed from the environment picture to the scene
    /// picture, going by the environment camera's last two pictures.
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
            return self.depart(z, r, innovation, at);
        }
        let gain = predicted / (predicted + r);
        self.state = Some(State {
            log_gains: state.log_gains + gain * innovation,
            variance: (DVec3::ONE - gain) * predicted,
            measured_at: at,
        });
        (self.jump, self.frozen) = (None, None);
    }

    /// Waits for the jump to last, so that a hand in the picture does not move the light.
    fn depart(&mut self, z: DVec3, r: DVec3, innovation: DVec3, at: MonotonicTime) {
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

    /// The gains at the reference exposures, if ever measured. What no repetition removes
    /// is part of the stated error.
    #[must_use]
    pub fn estimate(&self) -> Option<GainEstimate> {
        let clusters = self.last().map_or(1, |last| last.clusters.max(1)) as f64;
        let systematic = SYSTEMATIC.powi(2) + CLUSTER_SYSTEMATIC.powi(2) / clusters;
        self.state.map(|state| GainEstimate {
            gains: state.log_gains.exp(),
            relative_sd: (state.variance + systematic).sqrt(),
        })
    }

    /// Why the last frame pair was not used; `None` while the filter follows.
    #[must_use]
    pub const fn frozen(&self) -> Option<Shortage> {
        self.frozen
    }

    /// The last answer that was one.
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
