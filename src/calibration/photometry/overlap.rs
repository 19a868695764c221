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
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

    use super::*;

    fn pairs(gains: DVec3, count: u32, outliers: u32) -> Vec<PhotometricPair> {
        (0..count)
            .map(|i| {
                let environment = DVec3::splat(0.05 + 0.002 * f64::from(i % 50));
                let wobble = 1.0 + 0.02 * f64::from(i % 5) - 0.04;
                let wrong = if i % count < outliers { 3.0 } else { 1.0 };
                PhotometricPair {
                    scene: gains * environment * wobble * wrong,
                    environment,
                    variance: DVec3::splat(4e-4),
                    cluster: i / 10,
                }
            })
            .collect()
    }

    fn seconds(s: f64) -> MonotonicTime {
        MonotonicTime::from_nanos((s * 1e9) as i64)
    }

    const GAINS: DVec3 = DVec3::new(3.0, 2.5, 4.0);

    #[test]
    fn a_quarter_of_outliers_is_borne() {
        let found = estimate_overlap(&pairs(GAINS, 200, 50)).unwrap();
        let error = found.estimate.percent_from(GAINS);
        assert!(error.abs().max_element() < 1.0, "{error}");
        assert_eq!(found.pairs, 150);
    }

    #[test]
    fn clipped_channels_are_left_out() {
        let mut pairs = pairs(GAINS, 200, 0);
        for pair in pairs.iter_mut().step_by(2) {
            pair.scene.x = 1.0;
            pair.variance.x = f64::INFINITY;
        }
        let found = estimate_overlap(&pairs).unwrap();
        assert!(found.estimate.percent_from(GAINS).abs().max_element() < 1.0);
        assert_eq!(found.pairs, 100);
    }

    #[test]
    fn too_few_and_contradictory_pairs_are_refused() {
        assert!(matches!(
            estimate_overlap(&[]),
            Err(Shortage::TooFew { pairs: 0, .. })
        ));
        let few = estimate_overlap(&pairs(GAINS, 20, 0));
        assert!(matches!(few, Err(Shortage::TooFew { pairs: 20, .. })));
        let mut wild = pairs(GAINS, 200, 0);
        for (i, pair) in wild.iter_mut().enumerate() {
            pair.scene *= (0.02 * (i as f64 - 100.0)).exp();
        }
        let wild = estimate_overlap(&wild);
        assert!(
            matches!(wild, Err(Shortage::Inconsistent { .. })),
            "{wild:?}"
        );
    }

    fn answer(gains: DVec3, sd: f64) -> Result<OverlapEstimate, Shortage> {
        Ok(OverlapEstimate {
            estimate: GainEstimate {
                gains,
                relative_sd: DVec3::splat(sd),
            },
            pairs: 100,
            clusters: 10,
            spread: 0.03,
            log_brightness: DVec3::ZERO,
        })
    }

    fn timing(exposure_factor: f64, at: MonotonicTime) -> PairTiming {
        PairTiming {
            scene_at: at,
            environment_at: at,
            exposure_factor,
        }
    }

    #[test]
    fn noise_is_averaged_and_the_stated_error_falls_but_not_to_nothing() {
        let mut tracker = GainTracker::new(SmoothingOptions {
            drift: 0.0,
            ..SmoothingOptions::default()
        });
        for i in 0..100 {
            let noisy = GAINS * (1.0 + 0.05 * if i % 2 == 0 { 1.0 } else { -1.0 });
            tracker.update(
                answer(noisy, 0.05),
                timing(1.0, seconds(0.1 * f64::from(i))),
            );
        }
        let found = tracker.estimate().unwrap();
        assert!(found.percent_from(GAINS).abs().max_element() < 0.3);
        let sd = found.relative_sd.x;
        let systematic = SYSTEMATIC.powi(2) + CLUSTER_SYSTEMATIC.powi(2) / 10.0;
        let expected = (0.05f64.powi(2) / 100.0 + systematic).sqrt();
        assert!((sd / expected - 1.0).abs() < 0.01, "{sd} {expected}");
    }

    #[test]
    fn it_freezes_keeps_its_value_and_thaws() {
        let mut tracker = GainTracker::new(SmoothingOptions::default());
        assert_eq!(tracker.estimate(), None);
        tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(0.0)));
        let before = tracker.estimate();
        let shortage = Shortage::TooFew {
            pairs: 3,
            clusters: 1,
        };
        tracker.update(Err(shortage), timing(1.0, seconds(1.0)));
        assert_eq!(tracker.frozen(), Some(shortage));
        assert_eq!(tracker.estimate(), before);
        tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(2.0)));
        assert_eq!(tracker.frozen(), None);
    }

    #[test]
    fn a_passing_hand_is_ignored_and_a_lasting_jump_is_followed() {
        let mut tracker = GainTracker::new(SmoothingOptions::default());
        for i in 0..10 {
            tracker.update(
                answer(GAINS, 0.02),
                timing(1.0, seconds(0.1 * f64::from(i))),
            );
        }
        for i in 10..13 {
            tracker.update(
                answer(0.6 * GAINS, 0.02),
                timing(1.0, seconds(0.1 * f64::from(i))),
            );
        }
        assert!(matches!(tracker.frozen(), Some(Shortage::Jump { .. })));
        let held = tracker.estimate().unwrap();
        assert!(held.percent_from(GAINS).abs().max_element() < 0.1);
        tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(1.3)));
        for i in 14..20 {
            tracker.update(
                answer(0.6 * GAINS, 0.02),
                timing(1.0, seconds(0.1 * f64::from(i))),
            );
        }
        let followed = tracker.estimate().unwrap();
        assert!(followed.percent_from(0.6 * GAINS).abs().max_element() < 0.1);
        assert_eq!(tracker.frozen(), None);
    }

    #[test]
    fn a_reported_exposure_change_is_no_jump() {
        let mut tracker = GainTracker::new(SmoothingOptions::default());
        tracker.update(answer(GAINS, 0.02), timing(1.0, seconds(0.0)));
        tracker.update(answer(4.0 * GAINS, 0.02), timing(4.0, seconds(0.1)));
        assert_eq!(tracker.frozen(), None);
        let found = tracker.estimate().unwrap();
        assert!(found.percent_from(GAINS).abs().max_element() < 1e-6);
    }

    #[test]
    fn light_that_dims_between_the_two_pictures_is_allowed_for() {
        let mut tracker = GainTracker::new(SmoothingOptions::default());
        let rate = -1.0f64; // ln units per second: a cloud
        let skew = 0.03;
        for i in 0..20 {
            let at = 0.066 * f64::from(i);
            let mut dimming = answer(GAINS * (rate * skew).exp(), 0.002).unwrap();
            dimming.log_brightness = DVec3::splat(rate * at);
            let timing = PairTiming {
                scene_at: seconds(at + skew),
                environment_at: seconds(at),
                exposure_factor: 1.0,
            };
            tracker.update(Ok(dimming), timing);
        }
        let found = tracker.estimate().unwrap();
        let error = found.percent_from(GAINS).abs().max_element();
        assert!(error < 1.0, "{error} % with the correction, 3 % without");
    }
}
