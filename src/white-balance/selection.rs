//! Selects the gains to use among those of all methods.

use super::chart::{ChartError, ChartMatch};
use super::exposure::ExposureRatio;
use super::gains::GainEstimate;
use super::overlap::{GainTracker, OverlapEstimate, PairTiming, Shortage, SmoothingOptions};
use super::settings::{CalibratedGains, Provenance, WhiteBalanceMethod, WhiteBalanceSettings};
use super::status::{MatchStatus, MethodStatus, percent};
use glam::{DMat3, DVec3};
use penumbra_interface::{Exposure, MonotonicTime};

/// The gains of all methods, and the choice between them.
#[derive(Clone, Debug)]
pub struct WhiteBalanceMatch {
    settings: WhiteBalanceSettings,
    same_camera: bool,
    exposures: ExposureRatio,
    calibrated: Option<CalibratedGains>,
    same_model: Option<SameModel>,
    chart: Option<Result<ChartMatch, ChartError>>,
    overlap: GainTracker,
    reflectance: Option<GainEstimate>,
    grey_world: Option<GainEstimate>,
}

/// How it is known that both cameras are of one model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SameModel {
    /// The user states it, and that their settings are the same.
    Stated,
    /// Their product names are the same. Their settings may differ.
    ByName,
}

impl SameModel {
    /// Assumed standard error of the gains, relative.
    const fn standard_error(self) -> f64 {
        match self {
            Self::Stated => 0.03,
            Self::ByName => 0.1,
        }
    }
}

/// An exposure at which both cameras of one model are equally bright, seconds; any will do.
const REFERENCE_SECONDS: f64 = 0.01;
/// Weight of a new reflectance or grey-world estimate in the moving average.
const REFLECTANCE_WEIGHT: f64 = 0.2;

impl WhiteBalanceMatch {
    /// Creates a white balance without measurements. `same_camera`: the environment is read from
    /// the scene camera's own picture.
    #[must_use]
    pub fn new(settings: WhiteBalanceSettings, same_camera: bool) -> Self {
        Self {
            settings,
            same_camera,
            exposures: ExposureRatio::default(),
            calibrated: None,
            same_model: None,
            chart: None,
            overlap: GainTracker::new(SmoothingOptions::default()),
            reflectance: None,
            grey_world: None,
        }
    }

    /// Replaces the settings.
    pub fn set_settings(&mut self, settings: WhiteBalanceSettings) {
        self.settings = settings;
    }

    /// Sets the gains of the chart. They hold for the exposures that are reported first.
    pub fn set_chart(&mut self, chart: Result<ChartMatch, ChartError>) {
        self.chart = Some(chart);
    }

    /// Sets the gains of the radiometric calibration.
    pub fn set_calibrated(&mut self, gains: CalibratedGains) {
        if let Some([scene, environment]) = gains.exposures {
            self.exposures = ExposureRatio::at(scene, environment);
        }
        self.calibrated = Some(gains);
    }

    /// States that both cameras are of one model with the same settings, so that their gains are the
    /// ratio of their exposures. Calibrated gains and those of a chart replace it, and where it is told
    /// by names alone, everything that is measured.
    pub fn set_same_model(&mut self, known: SameModel) {
        self.same_model = Some(known);
        self.exposures = ExposureRatio::at(REFERENCE_SECONDS, REFERENCE_SECONDS);
    }

    /// Gains of 1 at equal exposures.
    fn of_same_model(&self, wanted: SameModel) -> Option<GainEstimate> {
        let known = self.same_model.filter(|known| *known == wanted)?;
        Some(self.followed(GainEstimate {
            gains: DVec3::ONE,
            relative_sd: DVec3::splat(known.standard_error()),
        }))
    }

    /// Calibrated gains, updated by the overlap.
    fn calibrated_now(&self) -> Option<GainEstimate> {
        self.calibrated.map(|found| self.followed(found.estimate))
    }

    fn followed(&self, estimate: GainEstimate) -> GainEstimate {
        match self.overlap.estimate() {
            Some(live) => estimate.followed_by(&live),
            None => estimate,
        }
    }

    /// Sets the exposures that the cameras report for the current frames.
    pub fn set_exposures(&mut self, scene: Option<Exposure>, environment: Option<Exposure>) {
        self.exposures.update(scene, environment);
    }

    /// Adds the gains of one pair of frames; see
    /// [`estimate_overlap`](super::overlap::estimate_overlap).
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

    /// Adds an estimate from known surfaces at the current exposures.
    pub fn update_reflectance(&mut self, estimate: Option<GainEstimate>) {
        let estimate = estimate.map(|e| self.at_reference(e));
        self.reflectance = blend(self.reflectance, estimate);
    }

    /// Adds a grey-world estimate at the current exposures.
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

    /// Gains for the current frames: `scene = gains × environment`, linear.
    #[must_use]
    pub fn gains(&self) -> DVec3 {
        self.in_force().1.gains * self.factor()
    }

    /// The 3×3 matrix, or the gains as a diagonal matrix, for the current frames:
    /// `scene = matrix × environment`, linear.
    #[must_use]
    pub fn scene_from_environment(&self) -> DMat3 {
        match self.matrix() {
            Some(matrix) => matrix * self.factor(),
            None => DMat3::from_diagonal(self.gains()),
        }
    }

    /// The matrix of the chart or the calibration, if it is active.
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

    /// The active method and its gains at the reference exposures.
    #[must_use]
    pub fn in_force(&self) -> (Provenance, GainEstimate) {
        let wanted = match self.settings.method {
            WhiteBalanceMethod::Auto => None,
            WhiteBalanceMethod::Chart => Some(Provenance::Chart),
            WhiteBalanceMethod::Overlap => Some(Provenance::Overlap),
            WhiteBalanceMethod::Reflectance => Some(Provenance::Reflectance),
            WhiteBalanceMethod::Fixed => Some(Provenance::Fixed),
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
            .unwrap_or(UNKNOWN)
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
            (Provenance::SameModel, self.of_same_model(SameModel::Stated)),
            (Provenance::Overlap, self.overlap.estimate()),
            (Provenance::Reflectance, self.reflectance),
            (
                Provenance::SameProduct,
                self.of_same_model(SameModel::ByName),
            ),
            (Provenance::GreyWorld, self.grey_world),
        ];
        let list = list.into_iter();
        list.filter_map(|(p, estimate)| Some((p, estimate?)))
            .collect()
    }

    /// Returns the state for the status and reports.
    #[must_use]
    pub fn status(&self) -> MatchStatus {
        let (in_force, estimate) = self.in_force();
        let available = self.available();
        let methods: Vec<MethodStatus> = available
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

    /// One line for the user, where there is something to do.
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
        let notice = match in_force {
            Provenance::SameProduct => {
                "the cameras are assumed to have the same white balance, because both lens \
                 calibrations name the same product: set `[white_balance] same_camera` to true if \
                 they have, or photograph a colour chart with both"
            }
            Provenance::GreyWorld | Provenance::Unknown => {
                "the cameras' white balance is unknown: photograph a colour chart with both, set a \
                 phantom's albedo, or set `[white_balance] same_camera` if they are of one model"
            }
            _ => return None,
        };
        Some(notice.to_owned())
    }
}

const UNKNOWN: (Provenance, GainEstimate) = (
    Provenance::Unknown,
    GainEstimate {
        gains: DVec3::ONE,
        relative_sd: DVec3::INFINITY,
    },
);

/// Geometric moving average. The standard error is that of the newest estimate, because errors of
/// albedo and light are the same at every update.
fn blend(old: Option<GainEstimate>, new: Option<GainEstimate>) -> Option<GainEstimate> {
    let (Some(old), Some(new)) = (old, new) else {
        return new.or(old);
    };
    Some(GainEstimate {
        gains: old.gains * (new.gains / old.gains).powf(REFLECTANCE_WEIGHT),
        ..new
    })
}

#[cfg(test)]
mod tests;
