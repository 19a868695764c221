//! The devices that a step of calibration looks at.

use crate::wall_date::iso_now;
use penumbra_calibration::step::{Made, Wants};
use penumbra_capture::{Devices, LiveDevice};
use penumbra_interface::DeviceKind;

/// Why a step cannot have anything of what it wants from these devices, and what to do. Only one
/// of the cameras that it wants is insisted on, and a tracker where it wants no camera: what it
/// can do without the others it says itself.
#[must_use]
pub fn lacking(wants: &Wants, devices: &Devices) -> Option<String> {
    let wanted = [
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
    let wanted = || wanted.iter().filter(|(_, wanted, _)| *wanted);
    if wanted().any(|(_, _, there)| *there) {
        return None;
    }
    let (what, ..) = wanted().next()?;
    Some(format!(
        "the rig has no {}; name one under [{what}] in its configuration",
        what.replace('_', " ")
    ))
}

const fn is_wanted(wants: &Wants, kind: DeviceKind) -> bool {
    match kind {
        DeviceKind::SceneCamera => wants.scene,
        DeviceKind::EnvironmentCamera => wants.environment,
        DeviceKind::Tracker => wants.poses,
    }
}

/// The first of the wanted devices that delivers nothing, and why.
#[must_use]
pub fn trouble(wants: &Wants, devices: &[LiveDevice]) -> Option<String> {
    let mut wanted = devices.iter().filter(|d| is_wanted(wants, d.kind));
    wanted.find_map(|device| {
        let reason = device.status().reason?;
        let kind = device.kind.label().replace('-', " ");
        Some(format!("{kind}: {reason}"))
    })
}

/// Who asks now, of these devices.
#[must_use]
pub fn made(wants: &Wants, devices: &[LiveDevice]) -> Made {
    let wanted = devices.iter().filter(|d| is_wanted(wants, d.kind));
    let known: Vec<_> = wanted.filter_map(LiveDevice::name_and_serial).collect();
    let names: Vec<String> = known.iter().map(|(name, _)| name.clone()).collect();
    let serials: Vec<String> = known.into_iter().filter_map(|(_, serial)| serial).collect();
    let joined = |texts: Vec<String>| (!texts.is_empty()).then(|| texts.join(" and "));
    Made {
        date: iso_now(),
        source: "live".to_owned(),
        device: joined(names),
        serial: joined(serials),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use penumbra_config::CameraSource;

    const NOTHING: Wants = Wants {
        scene: false,
        environment: false,
        brackets: false,
        poses: false,
        spacing: 0.0,
    };

    #[test]
    fn what_the_rig_lacks_is_said_with_the_key_to_set() {
        let rig = Devices {
            scene_camera: Some(CameraSource::Replay("a.mcap".into())),
            ..Devices::default()
        };
        let scene = Wants {
            scene: true,
            poses: true,
            ..NOTHING
        };
        assert_eq!(lacking(&scene, &rig), None);
        let both = Wants {
            environment: true,
            ..scene
        };
        assert_eq!(lacking(&both, &rig), None);
        let environment = Wants {
            environment: true,
            ..NOTHING
        };
        let said = lacking(&environment, &rig).unwrap();
        assert!(said.contains("no environment camera") && said.contains("[environment_camera]"));
        let poses = Wants {
            poses: true,
            ..NOTHING
        };
        assert!(lacking(&poses, &rig).unwrap().contains("[tracker]"));
        assert!(
            lacking(&scene, &Devices::default())
                .unwrap()
                .contains("[scene_camera]")
        );
    }
}
