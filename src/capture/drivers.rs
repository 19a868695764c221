//! The drivers of real devices. No other file outside `drivers/` opens real devices.

use penumbra_config::{Hemisphere, TrackerConfig, TrackerUnits};
use penumbra_interface::{Camera, CameraInfo, CameraSettings, Clock, DeviceError, Tracker};
use penumbra_tracker_serial::{self as tracker, PortName, TrackerSettings};
use std::sync::Arc;

/// Opens a camera through V4L2.
#[cfg(target_os = "linux")]
pub(crate) fn open_camera(
    settings: &CameraSettings,
    clock: Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    penumbra_camera_v4l2::open(settings, clock)
}

/// Opens a camera through the crate `nokhwa`.
#[cfg(all(not(target_os = "linux"), feature = "nokhwa"))]
pub(crate) fn open_camera(
    settings: &CameraSettings,
    clock: Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    penumbra_camera_nokhwa::open(settings, clock)
}

/// Refuses: the program was built without a camera driver for this system.
#[cfg(all(not(target_os = "linux"), not(feature = "nokhwa")))]
pub(crate) fn open_camera(
    settings: &CameraSettings,
    _clock: Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    Err(DeviceError::Refused {
        device: settings.device.clone(),
        reason: "this program was built without cameras; build it with --features nokhwa".into(),
    })
}

/// Lists the cameras that the compiled-in drivers find.
#[must_use]
pub fn list_cameras() -> Vec<CameraInfo> {
    #[cfg_attr(
        all(not(target_os = "linux"), not(feature = "nokhwa")),
        expect(unused_mut, reason = "a build without drivers finds none")
    )]
    let mut cameras = Vec::new();
    #[cfg(target_os = "linux")]
    cameras.extend(penumbra_camera_v4l2::list_cameras());
    #[cfg(feature = "nokhwa")]
    cameras.extend(penumbra_camera_nokhwa::list_cameras());
    cameras
}

/// Returns the product name and the serial number of the camera with this identity.
#[cfg(target_os = "linux")]
pub(crate) fn camera_name_and_serial(identity: &str) -> Option<(String, Option<String>)> {
    penumbra_camera_v4l2::name_and_serial(identity)
}

/// Returns nothing: other drivers know no more than the identity.
#[cfg(not(target_os = "linux"))]
pub(crate) const fn camera_name_and_serial(_: &str) -> Option<(String, Option<String>)> {
    None
}

/// Opens a tracker and configures it as its protocol prescribes.
///
/// # Errors
/// A port name that cannot be parsed; the driver's error.
pub(crate) fn open_tracker(config: &TrackerConfig) -> Result<Box<dyn Tracker>, DeviceError> {
    let port = PortName::parse(&config.device).map_err(|reason| DeviceError::Refused {
        device: config.device.clone(),
        reason,
    })?;
    tracker::open(&TrackerSettings {
        baud: config.baud,
        stations: vec![config.station],
        hemisphere: hemisphere(config.hemisphere),
        units: match config.units {
            Some(TrackerUnits::Inches) => tracker::Units::Inches,
            Some(TrackerUnits::Centimetres) | None => tracker::Units::Centimetres,
        },
        silence_millis: config.silent_after_nanos.unsigned_abs() / 1_000_000,
        ..TrackerSettings::new(&config.protocol, port)
    })
}

const fn hemisphere(side: Hemisphere) -> tracker::Hemisphere {
    match side {
        Hemisphere::Forward => tracker::Hemisphere::Forward,
        Hemisphere::Back => tracker::Hemisphere::Back,
        Hemisphere::Right => tracker::Hemisphere::Right,
        Hemisphere::Left => tracker::Hemisphere::Left,
        Hemisphere::Lower => tracker::Hemisphere::Lower,
        Hemisphere::Upper => tracker::Hemisphere::Upper,
    }
}
