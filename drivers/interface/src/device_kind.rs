//! The devices of a rig.

use serde::Serialize;

/// What a device is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceKind {
    /// Its picture is augmented.
    SceneCamera,
    /// It sees the light.
    EnvironmentCamera,
    /// It says where the scene camera is.
    Tracker,
}

impl DeviceKind {
    /// As it stands in `/status` and as a metric label.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::SceneCamera => "scene-camera",
            Self::EnvironmentCamera => "environment-camera",
            Self::Tracker => "tracker",
        }
    }
}
