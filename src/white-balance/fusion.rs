//! Which gains are in force, how sure they are, and how far the other ways differ.

use super::chart::{ChartError, ChartMatch};
use super::overlap::{GainTracker, OverlapEstimate, PairTiming, Shortage, SmoothingOptions};
use super::{ExposureRatio, GainEstimate};
use glam::{DMat3, DVec3};
use penumbra_interface::{Exposure, MonotonicTime};
use serde::{Deserialize, Serialize};

/// The user's choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MatchMethod {
    /// The best that is available: calibration, chart, overlap, reflectance, grey world.
    #[default]
    Auto,
    /// The two pictures of a chart.
    Chart,
    /// What both cameras see.
    Overlap,
    /// A surface of known reflectance.
    Reflectance,
    /// The gains of the config.
    Fixed,
}

/// Where the gains in force come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Provenance {
    /// The scene camera sees the environment itself: nothing to match.
    SameCamera,
    /// The config.
    Fixed,
    /// The radiometric step of calibration, followed where the live picture contradicts it.
    Calibrated,
    /// The two pictures of a chart.
    Chart,
    /// What both cameras see.
    Overlap,
    /// A surface of known reflectance.
    Reflectance,
    /// Only the assumption that the scene is grey on average: right to within half.
    GreyWorld,
    /// Nothing at all: gains of 1.
    Unknown,
}

/// What the config says of the match.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhotometrySettings {
    /// Which way is to be in force.
    pub method: MatchMethod,
    /// Gains for `fixed`.
    pub fixed_gains: Option<[f64; 3]>,
    /// Use a 3×3 matrix where the chart calls for one.
    pub matrix: bool,
}

/// Gains that the radiometric step of calibration found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibratedGains {
    /// The gains.
    pub estimate: GainEstimate,
    /// `scene = matrix × environment`, where the cameras differ by more than gains.
    pub matrix: Option<DMat3>,
    /// Exposure time × gain of scene and environment camera that they hold for, seconds; `None`
    /// where the cameras do not say.
    pub exposures: Option<[f64; 2]>,
}

impl GainEstimate {
    /// Calibrated gains in the light of what both cameras see now. Where `live` agrees within
    /// what both allow, the two are weighed by their variances; where it does not, the calibration
    /// is old (a white balance turned, an exposure changed): its variance is raised by how far it
    /// is out of bounds, so that the live picture takes over without a jump.
    #[must_use]
    fn followed_by(&self, live: &Self) -> Self {
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

/// Everything known of the match between the two cameras, and the decision.
#[derive(Clone, Debug)]
pub struct PhotometricMatch {
    settings: PhotometrySettings,
    same_camera: bool,
    exposures: ExposureRatio,
    calibrated: Option<CalibratedGains>,
    chart: Option<Result<ChartMatch, ChartError>>,
    overlap: GainTracker,
    reflectance: Option<GainEstimate>,
    grey_world: Option<GainEstimate>,
}

/// What the overlap's standard error does not hold: surfaces that are not matt, pictures of
/// different instants.
const LIVE_FLOOR: f64 = 0.015;
/// Beyond so many standard errors of their difference, calibration and live picture contradict
/// each other.
const DRIFT_SIGMAS: f64 = 3.0;
/// How much of a new reflectance estimate is taken over at each update.
const REFLECTANCE_SHARE: f64 = 0.2;
/// Two ways disagree where they differ by more than this (relative) …
const DISAGREEMENT: f64 = 0.05;
/// … and by more than this many standard errors.
const DISAGREEMENT_SIGMAS: f64 = 3.0;

impl PhotometricMatch {
    /// `same_camera`: the environment is read from the scene camera's own picture.
    #[must_use]
    pub fn new(settings: PhotometrySettings, same_camera: bool) -> Self {
        Self {
            settings,
            same_camera,
            exposures: ExposureRatio::default(),
            calibrated: None,
            chart: None,
            overlap: GainTracker::new(SmoothingOptions::default()),
            reflectance: None,
            grey_world: None,
        }
    }

    /// Changes the settings while running.
    pub fn set_settings(&mut self, settings: PhotometrySettings) {
        self.settings = settings;
    }

    /// Takes what the chart says. The exposures first reported are taken for those of the
    /// chart's photographs.
    pub fn set_chart(&mut self, chart: Result<ChartMatch, ChartError>) {
        self.chart = Some(chart);
    }

    /// Takes what calibration found.
    pub fn set_calibrated(&mut self, gains: CalibratedGains) {
        if let Some([scene, environment]) = gains.exposures {
            self.exposures = ExposureRatio::at(scene, environment);
        }
        self.calibrated = Some(gains);
    }

    /// Calibrated gains, followed by what is seen.
    fn calibrated_now(&self) -> Option<GainEstimate> {
        let estimate = self.calibrated?.estimate;
        Some(match self.overlap.estimate() {
            Some(live) => estimate.followed_by(&live),
            None => estimate,
        })
    }

    /// Takes what the two cameras report of the frames now in use.
    pub fn set_exposures(&mut self, scene: Option<Exposure>, environment: Option<Exposure>) {
        self.exposures.update(scene, environment);
    }

    /// Takes one frame pair's answer; see [`estimate_overlap`](super::overlap::estimate_overlap).
    pub fn update_overlap(
        &mut self,
        answer: Result<OverlapEstimate, Shortage>,
        scene_at: MonotonicTime,
        environment_at: MonotonicTime,
    ) {
        let timing = PairTiming {
            scene_at,
            environment_at,
            exposure_factor: self.exposures.factor(),
        };
        self.overlap.update(answer, timing);
    }

    /// Takes an estimate from known surfaces at the present exposures.
    pub fn update_reflectance(&mut self, estimate: Option<GainEstimate>) {
        let estimate = estimate.map(|e| self.at_reference(e));
        self.reflectance = blend(self.reflectance, estimate);
    }

    /// Takes the grey world's guess at the present exposures.
    pub fn update_grey_world(&mut self, estimate: Option<GainEstimate>) {
        let estimate = estimate.map(|e| self.at_reference(e));
        self.grey_world = blend(self.grey_world, estimate);
    }

    fn at_reference(&self, estimate: GainEstimate) -> GainEstimate {
        GainEstimate {
            gains: estimate.gains / self.exposures.factor(),
            ..estimate
        }
    }

    /// Gains for the frames now in use: `scene = gains × environment`, linear.
    #[must_use]
    pub fn gains(&self) -> DVec3 {
        self.in_force().1.gains * self.factor()
    }

    /// Gains, or the matrix in place of them, for the frames now in use:
    /// `scene = matrix × environment`, linear.
    #[must_use]
    pub fn scene_from_environment(&self) -> DMat3 {
        match self.matrix() {
            Some(matrix) => matrix * self.factor(),
            None => DMat3::from_diagonal(self.gains()),
        }
    }

    /// The chart's or the calibration's matrix, if it is in force.
    fn matrix(&self) -> Option<DMat3> {
        if !self.settings.matrix {
            return None;
        }
        match self.in_force() {
            (Provenance::Chart, _) => self.chart_match()?.matrix,
            (Provenance::Calibrated, now) => {
                let found = self.calibrated?;
                let drift = now.gains / found.estimate.gains;
                Some(DMat3::from_diagonal(drift) * found.matrix?)
            }
            _ => None,
        }
    }

    fn factor(&self) -> f64 {
        if self.same_camera {
            1.0
        } else {
            self.exposures.factor()
        }
    }

    fn chart_match(&self) -> Option<&ChartMatch> {
        self.chart.as_ref()?.as_ref().ok()
    }

    /// The way in force, and its gains at the reference exposures.
    #[must_use]
    pub fn in_force(&self) -> (Provenance, GainEstimate) {
        let wanted = match self.settings.method {
            MatchMethod::Auto => None,
            MatchMethod::Chart => Some(Provenance::Chart),
            MatchMethod::Overlap => Some(Provenance::Overlap),
            MatchMethod::Reflectance => Some(Provenance::Reflectance),
            MatchMethod::Fixed => Some(Provenance::Fixed),
        };
        let available = self.available();
        let chosen = available.iter().find(|(p, _)| Some(*p) == wanted);
        let best = || {
            let automatic = available.iter();
            automatic
                .filter(|(p, _)| *p != Provenance::Fixed)
                .min_by_key(|(p, _)| *p)
        };
        let own_camera = available.first().filter(|_| self.same_camera);
        own_camera
            .or(chosen)
            .or_else(best)
            .copied()
            .unwrap_or(NOTHING)
    }

    fn available(&self) -> Vec<(Provenance, GainEstimate)> {
        let exact = |gains| GainEstimate {
            gains,
            relative_sd: DVec3::ZERO,
        };
        let fixed = self.settings.fixed_gains.map(DVec3::from_array);
        let list = [
            (
                Provenance::SameCamera,
                self.same_camera.then_some(exact(DVec3::ONE)),
            ),
            (Provenance::Fixed, fixed.map(exact)),
            (Provenance::Calibrated, self.calibrated_now()),
            (Provenance::Chart, self.chart_match().map(|c| c.estimate)),
            (Provenance::Overlap, self.overlap.estimate()),
            (Provenance::Reflectance, self.reflectance),
            (Provenance::GreyWorld, self.grey_world),
        ];
        let list = list.into_iter();
        list.filter_map(|(p, estimate)| Some((p, estimate?)))
            .collect()
    }

    /// For status and report.
    #[must_use]
    pub fn status(&self) -> MatchStatus {
        let (in_force, estimate) = self.in_force();
        let compared = self.available();
        let methods: Vec<MethodStatus> = compared
            .iter()
            .map(|(p, e)| MethodStatus::new(*p, e, &estimate))
            .collect();
        let frozen = self.overlap.frozen();
        MatchStatus {
            wanted: self.settings.method,
            in_force,
            gains: self.gains().to_array(),
            uncertainty_percent: percent(estimate.relative_sd),
            matrix: self.matrix().map(|m| m.transpose().to_cols_array_2d()),
            exposure_factor: self.factor(),
            frozen: in_force == Provenance::Overlap && frozen.is_some(),
            overlap_frozen: frozen,
            overlap_pairs: self.overlap.last().map(|last| last.pairs),
            chart_residual_delta_e: self.chart_match().map(|c| c.residual_delta_e),
            notice: self.notice(in_force, &methods),
            methods,
        }
    }

    /// One line for the user, where something is to be done.
    fn notice(&self, in_force: Provenance, methods: &[MethodStatus]) -> Option<String> {
        if let Some(other) = methods.iter().find(|m| m.disagrees) {
            return Some(format!(
                "{in_force:?} and {:?} disagree by {:.0} %: photograph the chart again, or \
                 lock white balance and exposure of both cameras",
                other.method, other.disagreement_percent
            ));
        }
        if let Some(Err(error)) = &self.chart {
            return Some(error.to_string());
        }
        matches!(in_force, Provenance::GreyWorld | Provenance::Unknown).then(|| {
            "the cameras' brightness is not matched: photograph a colour chart with both, or \
             state a phantom's albedo"
                .to_owned()
        })
    }
}

const NOTHING: (Provenance, GainEstimate) = (
    Provenance::Unknown,
    GainEstimate {
        gains: DVec3::ONE,
        relative_sd: DVec3::INFINITY,
    },
);

/// Geometric moving average; the stated error stays the newest one's, because albedo and
/// light err alike at every update.
fn blend(old: Option<GainEstimate>, new: Option<GainEstimate>) -> Option<GainEstimate> {
    let (Some(old), Some(new)) = (old, new) else {
        return new.or(old);
    };
    Some(GainEstimate {
        gains: old.gains * (new.gains / old.gains).powf(REFLECTANCE_SHARE),
        ..new
    })
}

/// `None` where nothing is known.
fn percent(relative: DVec3) -> Option<[f64; 3]> {
    relative.is_finite().then(|| (100.0 * relative).to_array())
}

/// The match, for status and report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MatchStatus {
    /// What the config asks for.
    pub wanted: MatchMethod,
    /// What is used.
    pub in_force: Provenance,
    /// Gains for the present exposures: scene = gains × environment, linear.
    pub gains: [f64; 3],
    /// Standard error of the gains; null where nothing is known.
    pub uncertainty_percent: Option<[f64; 3]>,
    /// The 3×3 matrix in force instead of the gains, rows, at the reference exposures.
    pub matrix: Option<[[f64; 3]; 3]>,
    /// What the reported exposures change since the reference.
    pub exposure_factor: f64,
    /// The way in force lives on an old value.
    pub frozen: bool,
    /// Why the overlap of the last frame pair said nothing.
    pub overlap_frozen: Option<Shortage>,
    /// Patches that both cameras saw, last time it said something.
    pub overlap_pairs: Option<usize>,
    /// CIEDE2000 left between the chart's two pictures once matched, mean over patches.
    pub chart_residual_delta_e: Option<f64>,
    /// Every way that has an answer.
    pub methods: Vec<MethodStatus>,
    /// What the user should know or do, one line.
    pub notice: Option<String>,
}

/// One way's answer, compared with the one in force.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodStatus {
    /// Which way.
    pub method: Provenance,
    /// Its gains at the reference exposures.
    pub gains: [f64; 3],
    /// Standard error; null where unknown.
    pub uncertainty_percent: Option<[f64; 3]>,
    /// Largest difference of a channel from the gains in force.
    pub disagreement_percent: f64,
    /// CIEDE2000 between a grey (linear 0.5) under these and under the gains in force.
    pub disagreement_delta_e: f64,
    /// The difference is more than their stated errors allow.
    pub disagrees: bool,
}

impl MethodStatus {
    fn new(method: Provenance, estimate: &GainEstimate, in_force: &GainEstimate) -> Self {
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

#[cfg(test)]
mod tests;
