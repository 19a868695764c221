//! `[registration]`: what tells where the scene camera is.

use super::convert::set;
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
    /// `"tracker"`: the tracker.
    #[default]
    Tracker,
    /// `"markers"`: the markers that the calibration lists, in the scene camera's own picture.
    Markers,
}

/// `[registration]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RegistrationConfig {
    /// What tells where the scene camera is.
    pub pose: PoseSource,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RegistrationFile {
    pub pose: Option<PoseSource>,
}

pub(super) fn registration(file: &RegistrationFile, out: &mut RegistrationConfig) {
    set(&mut out.pose, file.pose);
}
