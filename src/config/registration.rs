//! `[registration]`: what tells where the scene camera is.

use super::convert::{Result, set};
use penumbra_strict_toml::Fault;
use serde::Deserialize;

/// What tells where the scene camera is.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSource {
    /// `"auto"`: hybrid where the calibration lists markers and a tracker, else what it lists.
    #[default]
    Auto,
    /// `"tracker"`: the tracker.
    Tracker,
    /// `"markers"`: the markers that the calibration lists, in the scene camera's own picture.
    Markers,
    /// `"hybrid"`: the tracker, and those markers take its drift and distortion away.
    Hybrid,
}

/// How a picture comes out that the scene camera's lens bends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distortion {
    /// `"camera"`: bent, like the camera's, and virtual objects like the real ones.
    #[default]
    Camera,
    /// `"undistorted"`: straight.
    Undistorted,
}

/// For which instant pictures are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predict {
    /// `"picture"`: that at which they were taken.
    #[default]
    Picture,
    /// `"display"`: that at which they are seen. The finished picture, real and virtual, is
    /// turned to where the camera will be by then.
    Display,
}

/// `[registration]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegistrationConfig {
    /// What tells where the scene camera is.
    pub pose: PoseSource,
    /// How the picture of a lens that bends comes out.
    pub distortion: Distortion,
    /// Seconds from one row of the scene camera's picture to the next; 0 for a global shutter.
    pub row_seconds: f64,
    /// For which instant pictures are shown.
    pub predict: Predict,
    /// From handing a picture to the window until it is seen, nanoseconds.
    pub display_delay_nanos: i64,
}

impl Default for RegistrationConfig {
    fn default() -> Self {
        Self {
            pose: PoseSource::default(),
            distortion: Distortion::default(),
            row_seconds: 0.0,
            predict: Predict::default(),
            display_delay_nanos: 15_000_000,
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RegistrationFile {
    pub pose: Option<PoseSource>,
    pub distortion: Option<Distortion>,
    pub row_time_micros: Option<f64>,
    pub predict: Option<Predict>,
    pub display_delay_ms: Option<f64>,
}

/// Slower than any shutter: a second for a thousand rows.
const SLOWEST_ROW_MICROS: f64 = 1000.0;
/// Slower than any monitor that anybody looks through.
const LONGEST_DELAY_MS: f64 = 200.0;

pub(super) fn registration(file: &RegistrationFile, out: &mut RegistrationConfig) -> Result<()> {
    set(&mut out.pose, file.pose);
    set(&mut out.distortion, file.distortion);
    set(&mut out.predict, file.predict);
    if let Some(ms) = file.display_delay_ms {
        if !(0.0..=LONGEST_DELAY_MS).contains(&ms) {
            let reason = format!(
                "expected 0 to {LONGEST_DELAY_MS} milliseconds, found {ms}; a monitor takes half a \
                 refresh and a little more"
            );
            return Err(Fault::new("registration.display_delay_ms", reason));
        }
        out.display_delay_nanos = (ms * 1e6).round() as i64;
    }
    if let Some(micros) = file.row_time_micros {
        if micros.is_nan() || micros.abs() > SLOWEST_ROW_MICROS {
            let reason = format!(
                "expected at most {SLOWEST_ROW_MICROS} microseconds a row, found {micros}; a usual camera \
                 takes 10 to 60"
            );
            return Err(Fault::new("registration.row_time_micros", reason));
        }
        out.row_seconds = micros * 1e-6;
    }
    Ok(())
}
