//! `[registration]`: source of the scene camera's pose, lens distortion and prediction.

use super::range::{Result, set};
use penumbra_strict_toml::Fault;
use serde::Deserialize;

/// Source of the scene camera's pose.
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
    /// `"auto"`: hybrid if the calibration lists markers and a tracker, else the one that it lists.
    #[default]
    Auto,
    /// `"tracker"`: the tracker.
    Tracker,
    /// `"markers"`: markers of the calibration, seen by the scene camera.
    Markers,
    /// `"hybrid"`: the tracker, whose drift and distortion the markers correct.
    Hybrid,
}

/// Lens distortion of the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distortion {
    /// `"camera"`: that of the camera; virtual objects are distorted likewise.
    #[default]
    Camera,
    /// `"undistorted"`: none; the picture is rectified.
    Undistorted,
}

/// Instant for which a picture is rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predict {
    /// `"picture"`: when it was taken.
    #[default]
    Picture,
    /// `"display"`: when it is seen. The finished picture, real and virtual, is reprojected to the
    /// predicted orientation of the camera.
    Display,
}

/// `[registration]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegistrationConfig {
    /// Source of the scene camera's pose.
    pub pose: PoseSource,
    /// Lens distortion of the output.
    pub distortion: Distortion,
    /// Time between two rows of the scene camera's picture, seconds; 0 for a global shutter.
    pub row_seconds: f64,
    /// Instant for which a picture is rendered.
    pub predict: Predict,
    /// Time from presenting a picture in the window until it is seen, nanoseconds.
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

/// Maximum time between rows, seconds: one second for a thousand rows.
const MAX_ROW_MICROS: f64 = 1000.0;
/// Maximum delay of a display.
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
        if micros.is_nan() || micros.abs() > MAX_ROW_MICROS {
            let reason = format!(
                "expected at most {MAX_ROW_MICROS} microseconds a row, found {micros}; a typical camera \
                 takes 10 to 60"
            );
            return Err(Fault::new("registration.row_time_micros", reason));
        }
        out.row_seconds = micros * 1e-6;
    }
    Ok(())
}
