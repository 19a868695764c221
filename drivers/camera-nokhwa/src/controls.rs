//! The controls that nokhwa supports.

use nokhwa::Camera;
use nokhwa::utils::{ControlValueSetter, KnownCameraControl};
use penumbra_interface::{ControlReport, ControlStanding};

/// Names of controls in settings, and in nokhwa.
const KNOWN: [(&str, KnownCameraControl); 15] = [
    ("brightness", KnownCameraControl::Brightness),
    ("contrast", KnownCameraControl::Contrast),
    ("hue", KnownCameraControl::Hue),
    ("saturation", KnownCameraControl::Saturation),
    ("sharpness", KnownCameraControl::Sharpness),
    ("gamma", KnownCameraControl::Gamma),
    (
        "white_balance_temperature",
        KnownCameraControl::WhiteBalance,
    ),
    ("backlight_compensation", KnownCameraControl::BacklightComp),
    ("gain", KnownCameraControl::Gain),
    ("pan_absolute", KnownCameraControl::Pan),
    ("tilt_absolute", KnownCameraControl::Tilt),
    ("zoom_absolute", KnownCameraControl::Zoom),
    ("exposure_time_absolute", KnownCameraControl::Exposure),
    ("iris_absolute", KnownCameraControl::Iris),
    ("focus_absolute", KnownCameraControl::Focus),
];

/// Sets the locked controls and reads them back.
pub(crate) fn apply(camera: &mut Camera, locked: &[(String, i64)]) -> Vec<ControlReport> {
    let set = |(name, wanted): &(String, i64)| {
        let (in_force, standing) = set(camera, name, *wanted);
        ControlReport {
            name: name.as_str().into(),
            wanted: *wanted,
            in_force,
            standing,
        }
    };
    locked.iter().map(set).collect()
}

fn set(camera: &mut Camera, name: &str, wanted: i64) -> (Option<i64>, ControlStanding) {
    let Some((_, control)) = KNOWN.iter().find(|(known, _)| *known == name) else {
        // nokhwa issue 209: automatic modes cannot be switched.
        let reason = "nokhwa does not support this control".to_owned();
        return (None, ControlStanding::Refused(reason));
    };
    if camera.camera_control(*control).is_err() {
        return (None, ControlStanding::Missing);
    }
    let outcome = camera.set_camera_control(*control, ControlValueSetter::Integer(wanted));
    let now = camera.camera_control(*control).ok();
    let now = now.and_then(|control| control.value().as_integer().copied());
    let standing = match (outcome, now) {
        (Err(error), _) => ControlStanding::Refused(error.to_string()),
        (Ok(()), Some(now)) if now != wanted => ControlStanding::Adjusted,
        (Ok(()), _) => ControlStanding::Held,
    };
    (now, standing)
}
