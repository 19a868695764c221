//! The devices whose data a calibration step uses.

use crate::wall_date::iso_now;
use penumbra_calibration::step::{CalibrationProvenance, StepInputs};
use penumbra_capture::{Devices, LiveDevice};
use penumbra_interface::DeviceKind;

/// Returns why these devices deliver nothing that a step needs, and what to do; `None` if they
/// deliver something. One of the needed cameras is sufficient, and a tracker is required only if no
/// camera is needed: the step itself reports what it can do without the others.
#[must_use]
pub fn missing_device(wants: &StepInputs, devices: &Devices) -> Option<String> {
    let needed = [
        ("scene_camera", wants.scene, devices.scene_camera.is_some()),
        (
            "environment_camera",
            wants.environment,
            devices.environment_camera.is_some(),
        ),
        (
            "tracker",
            wants.poses && !wants.scene && !wants.environment,
            devices.tracker.is_some(),
        ),
    ];
    let needed = || needed.iter().filter(|(_, is_needed, _)| *is_needed);
    if needed().any(|(_, _, is_configured)| *is_configured) {
        return None;
    }
    let (section, ..) = needed().next()?;
    Some(format!(
        "the rig has no {}; name one under [{section}] in its configuration",
        section.replace('_', " ")
    ))
}

const fn is_needed(wants: &StepInputs, kind: DeviceKind) -> bool {
    match kind {
        DeviceKind::SceneCamera => wants.scene,
        DeviceKind::EnvironmentCamera => wants.environment,
        DeviceKind::Tracker => wants.poses,
    }
}

/// Returns the first needed device that delivers nothing, and why.
#[must_use]
pub fn device_problem(wants: &StepInputs, devices: &[LiveDevice]) -> Option<String> {
    let mut needed = devices.iter().filter(|d| is_needed(wants, d.kind));
    needed.find_map(|device| {
        let reason = device.status().reason?;
        let kind = device.kind.label().replace('-', " ");
        Some(format!("{kind}: {reason}"))
    })
}

/// Returns the provenance of a calibration that is made from these devices now: the date, and
/// names and serial numbers of the needed devices.
#[must_use]
pub fn provenance(wants: &StepInputs, devices: &[LiveDevice]) -> CalibrationProvenance {
    let needed = devices.iter().filter(|d| is_needed(wants, d.kind));
    let known: Vec<_> = needed.filter_map(LiveDevice::name_and_serial).collect();
    let names: Vec<String> = known.iter().map(|(name, _)| name.clone()).collect();
    let serials: Vec<String> = known.into_iter().filter_map(|(_, serial)| serial).collect();
    let joined = |texts: Vec<String>| (!texts.is_empty()).then(|| texts.join(" and "));
    CalibrationProvenance {
        date: iso_now(),
        source: "live".to_owned(),
        device: joined(names),
        serial: joined(serials),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_config::CameraSource;

    const NOTHING: StepInputs = StepInputs {
        scene: false,
        environment: false,
        brackets: false,
        poses: false,
        spacing: 0.0,
    };

    #[test]
    fn missing_device_is_reported_with_its_configuration_section() {
        let rig = Devices {
            scene_camera: Some(CameraSource::Replay("a.mcap".into())),
            ..Devices::default()
        };
        let scene = StepInputs {
            scene: true,
            poses: true,
            ..NOTHING
        };
        assert_eq!(missing_device(&scene, &rig), None);
        let both = StepInputs {
            environment: true,
            ..scene
        };
        assert_eq!(missing_device(&both, &rig), None);
        let environment = StepInputs {
            environment: true,
            ..NOTHING
        };
        let message = missing_device(&environment, &rig).unwrap();
        assert!(
            message.contains("no environment camera") && message.contains("[environment_camera]")
        );
        let poses = StepInputs {
            poses: true,
            ..NOTHING
        };
        assert!(missing_device(&poses, &rig).unwrap().contains("[tracker]"));
        assert!(
            missing_device(&scene, &Devices::default())
                .unwrap()
                .contains("[scene_camera]")
        );
    }
}
