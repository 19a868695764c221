//! The source of a device: the system, a recording, or the program that uses Penumbra as a
//! library.

use super::TrackerConfig;
use penumbra_interface::{Camera, CameraSettings, DeviceFactory, Tracker};
use std::path::{Path, PathBuf};

/// Prefix of a recording's file name in place of a device.
pub const REPLAY_PREFIX: &str = "replay:";

/// Source of a camera.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSource {
    /// A device, opened by the system's driver.
    System(CameraSettings),
    /// A recording that plays the device's stream.
    Replay(PathBuf),
    /// A device that the caller implements.
    Custom(DeviceFactory<dyn Camera>),
}

/// Source of a tracker.
#[derive(Clone, Debug, PartialEq)]
pub enum TrackerSource {
    /// A device at a serial port or a network address.
    System(Box<TrackerConfig>),
    /// A recording that plays the device's stream.
    Replay(PathBuf),
    /// A device that the caller implements.
    Custom(DeviceFactory<dyn Tracker>),
}

/// Returns the name of a replayed device for messages.
#[must_use]
pub fn replay_name(path: &Path) -> String {
    format!("{REPLAY_PREFIX}{}", path.display())
}

impl CameraSource {
    /// Returns the device's name for messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::System(settings) if settings.device.is_empty() => "the only camera".to_owned(),
            Self::System(settings) => settings.device.clone(),
            Self::Replay(path) => replay_name(path),
            Self::Custom(factory) => factory.name().to_owned(),
        }
    }
}

impl TrackerSource {
    /// Returns the device's name for messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::System(config) => config.device.clone(),
            Self::Replay(path) => replay_name(path),
            Self::Custom(factory) => factory.name().to_owned(),
        }
    }
}
