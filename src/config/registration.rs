//! `[registration]`: what tells where the scene camera is.

use super::convert::{Result, set};
use super::toml_text::Fault;
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

/// `[registration]`
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RegistrationConfig {
    /// What tells where the scene camera is.
    pub pose: PoseSource,
    /// How the picture of a lens that bends comes out.
    pub distortion: Distortion,
    /// Seconds from one row of the scene camera's picture to the next; 0 for a global shutter.
    pub row_seconds: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RegistrationFile {
    pub pose: Option<PoseSource>,
    pub distortion: Option<Distortion>,
    pub row_time_micros: Option<f64>,
}

/// Slower than any shutter: a second for a thousand rows.
const SLOWEST_ROW_MICROS: f64 = 1000.0;

pub(super) fn registration(file: &RegistrationFile, out: &mut RegistrationConfig) -> Result<()> {
    set(&mut out.pose, file.pose);
    set(&mut out.distortion, file.distortion);
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
