//! The devices of a rig, by their purpose.

use serde::Serialize;

/// Purpose of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeviceKind {
    /// The camera whose pictures are augmented.
    SceneCamera,
    /// The camera that captures the light of the surroundings.
    EnvironmentCamera,
    /// The device that measures the pose of the scene camera.
    Tracker,
}

impl DeviceKind {
    /// Its name in `/status` and in metric labels.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::SceneCamera => "scene-camera",
            Self::EnvironmentCamera => "environment-camera",
            Self::Tracker => "tracker",
        }
    }
}
