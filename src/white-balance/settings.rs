//! The methods of the white balance, its settings, and the gains of a calibration.

use super::gains::GainEstimate;
use glam::DMat3;
use serde::{Deserialize, Serialize};

/// The method that the configuration asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WhiteBalanceMethod {
    /// The best available method: calibration, chart, overlap, reflectance, grey world.
    #[default]
    Auto,
    /// Pictures of one colour chart by both cameras.
    Chart,
    /// Surfaces that both cameras see.
    Overlap,
    /// A surface of known reflectance.
    Reflectance,
    /// The gains of the configuration.
    Fixed,
}

/// Source of gains, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Provenance {
    /// The environment is read from the scene camera's picture: both cameras are one.
    SameCamera,
    /// The configuration.
    Fixed,
    /// The radiometric calibration, updated where the live pictures are inconsistent with it.
    Calibrated,
    /// Pictures of one colour chart by both cameras.
    Chart,
    /// The statement that both cameras are of one model with the same settings, updated where the live
    /// pictures are inconsistent with it; an assumed standard error of 3 %.
    SameModel,
    /// Surfaces that both cameras see.
    Overlap,
    /// A surface of known reflectance.
    Reflectance,
    /// Both cameras have the same product name, so that they are assumed to be of one model with the
    /// same settings; an assumed standard error of 10 %.
    SameProduct,
    /// The assumption that the scene is grey on average; standard error 50 %.
    GreyWorld,
    /// None: gains of 1.
    Unknown,
}

/// Settings of the white balance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WhiteBalanceSettings {
    /// Requested method.
    pub method: WhiteBalanceMethod,
    /// Gains for `fixed`.
    pub fixed_gains: Option<[f64; 3]>,
    /// Use a 3×3 matrix instead of gains where a chart shows that it is better.
    pub matrix: bool,
}

/// Gains of the radiometric calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibratedGains {
    /// The gains.
    pub estimate: GainEstimate,
    /// `scene = matrix × environment`, linear; `None` where gains describe the cameras as well.
    pub matrix: Option<DMat3>,
    /// Exposure time × gain, seconds, of the scene and environment camera for which the gains
    /// hold; `None` where the cameras report no exposure.
    pub exposures: Option<[f64; 2]>,
}
