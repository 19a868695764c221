//! The kinds of faults: what is injected, where, for how long, and how the status names it.

use bytes::Bytes;
use penumbra_faulty::LastingFault;
use penumbra_interface::DeviceKind;
use std::time::Duration;

/// Where a fault is injected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    Device(DeviceKind),
    Disk,
    Viewer,
    Settings,
}

impl Place {
    pub const SCENE: Self = Self::Device(DeviceKind::SceneCamera);
    pub const ENVIRONMENT: Self = Self::Device(DeviceKind::EnvironmentCamera);
    pub const TRACKER: Self = Self::Device(DeviceKind::Tracker);

    pub const fn label(self) -> &'static str {
        match self {
            Self::Device(kind) => kind.label(),
            Self::Disk => "disk",
            Self::Viewer => "stream",
            Self::Settings => "settings",
        }
    }
}

const DEVICES: &[Place] = &[Place::SCENE, Place::ENVIRONMENT, Place::TRACKER];
const CAMERAS: &[Place] = &[Place::SCENE, Place::ENVIRONMENT];

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Unplug,
    Silence,
    Garbage,
    HalfRecords,
    Drops,
    Duplicates,
    Reorder,
    TimeBackAndForth,
    NotANumber,
    WrongSize,
    WrongFormat,
    DamagedJpeg,
    Slow,
    Burst,
    ControlChanged,
    DiskFull,
    DiskSlow,
    ViewerStalled,
    SettingsFlood,
    ClockStep,
}

impl Kind {
    pub const ALL: [Self; 20] = [
        Self::Unplug,
        Self::Silence,
        Self::Garbage,
        Self::HalfRecords,
        Self::Drops,
        Self::Duplicates,
        Self::Reorder,
        Self::TimeBackAndForth,
        Self::NotANumber,
        Self::WrongSize,
        Self::WrongFormat,
        Self::DamagedJpeg,
        Self::Slow,
        Self::Burst,
        Self::ControlChanged,
        Self::DiskFull,
        Self::DiskSlow,
        Self::ViewerStalled,
        Self::SettingsFlood,
        Self::ClockStep,
    ];

    pub const fn label(self) -> &'static str {
        match self {
            Self::Unplug => "unplugged",
            Self::Silence => "silence",
            Self::Garbage => "garbage",
            Self::HalfRecords => "half records",
            Self::Drops => "drops",
            Self::Duplicates => "duplicates",
            Self::Reorder => "reordered",
            Self::TimeBackAndForth => "time back and forth",
            Self::NotANumber => "NaN",
            Self::WrongSize => "wrong size",
            Self::WrongFormat => "wrong format",
            Self::DamagedJpeg => "damaged JPEG",
            Self::Slow => "slow",
            Self::Burst => "burst",
            Self::ControlChanged => "control changed by others",
            Self::DiskFull => "disk full",
            Self::DiskSlow => "disk slow",
            Self::ViewerStalled => "viewer stalled",
            Self::SettingsFlood => "settings flood",
            Self::ClockStep => "clock step",
        }
    }

    /// Where it is injected, in turns.
    pub const fn places(self) -> &'static [Place] {
        match self {
            Self::DiskFull | Self::DiskSlow => &[Place::Disk],
            Self::ViewerStalled => &[Place::Viewer],
            Self::SettingsFlood => &[Place::Settings],
            Self::DamagedJpeg | Self::ControlChanged => CAMERAS,
            // The bytes of a tracker are stamped at their arrival, by the monotonic clock.
            Self::ClockStep => CAMERAS,
            _ => DEVICES,
        }
    }

    /// How long it lasts. The environment camera delivers five times a second, and a picture of it is
    /// read only when the light of the one before is estimated.
    pub fn duration(self, place: Place) -> Duration {
        let millis = match (self, place) {
            (Self::Silence, _) => 800,
            (Self::Burst, Place::ENVIRONMENT) => 1300,
            // One delivery in ten is lost.
            (Self::Drops, _) => 1000,
            (Self::Slow | Self::Burst, _) => 700,
            (Self::ControlChanged | Self::DiskSlow, _) => 600,
            (Self::WrongSize | Self::WrongFormat, Place::ENVIRONMENT) => 2500,
            (Self::DamagedJpeg, Place::ENVIRONMENT) => 2500,
            (_, Place::ENVIRONMENT) => 700,
            _ => 300,
        };
        Duration::from_millis(millis)
    }

    /// The fault of a device; `jpeg` is a picture of another size.
    pub fn of_device(self, place: Place, jpeg: &Bytes) -> Option<LastingFault> {
        let hold = if place == Place::ENVIRONMENT {
            900
        } else {
            400
        };
        let hold = Duration::from_millis(hold);
        Some(match self {
            Self::Unplug => LastingFault::Unplugged,
            Self::Silence => LastingFault::Silent,
            Self::Garbage => LastingFault::Garbage,
            Self::HalfRecords => LastingFault::Half,
            Self::Drops => LastingFault::Drops,
            Self::Duplicates => LastingFault::Duplicates,
            Self::Reorder => LastingFault::Reordered,
            Self::TimeBackAndForth => LastingFault::TimeBack(300_000_000),
            Self::NotANumber => LastingFault::NotANumber,
            Self::WrongSize => LastingFault::OtherSize(jpeg.clone()),
            Self::WrongFormat => LastingFault::OtherFormat,
            Self::DamagedJpeg => LastingFault::FlippedBits,
            Self::Slow => LastingFault::Slow(hold),
            Self::Burst => LastingFault::Burst(hold),
            Self::ControlChanged => LastingFault::ControlChanged,
            Self::ClockStep => LastingFault::ClockStep(3_600_000_000_000),
            Self::DiskFull | Self::DiskSlow | Self::ViewerStalled | Self::SettingsFlood => {
                return None;
            }
        })
    }

    /// Words, one of which the status must show.
    pub const fn named_by(self, place: Place) -> &'static [&'static str] {
        let is_tracker = matches!(place, Place::TRACKER);
        let is_scene = matches!(place, Place::SCENE);
        match self {
            Self::Unplug => &["not connected", "disconnected"],
            Self::Silence => &["silent for"],
            Self::Drops if is_tracker => &["missing, by its rate"],
            Self::Drops => &["lost before they reached the driver"],
            Self::Duplicates => &["the same delivery twice"],
            Self::Reorder | Self::TimeBackAndForth if is_tracker => {
                &["not newer than the one before"]
            }
            Self::Reorder => &["out of order"],
            Self::TimeBackAndForth | Self::ClockStep => &["impossible time stamp"],
            Self::NotANumber if !is_tracker => &["exposure that is no number"],
            Self::WrongSize if is_scene => &["the scene camera's pictures have"],
            Self::Slow => &["long pause between deliveries", "silent for"],
            Self::Burst => &["many deliveries at once"],
            Self::ControlChanged => &["changed by another program"],
            Self::DiskFull => &["free space"],
            Self::DiskSlow => &["the disk is slow"],
            Self::ViewerStalled => &["viewers: 1"],
            Self::SettingsFlood => &["settings requested"],
            // Garbage and the like: what cannot be read.
            _ if is_tracker => &["bytes that belong to no record"],
            _ if is_scene => &["cannot be decoded"],
            _ => &["cannot be decoded", "environment picture"],
        }
    }
}
