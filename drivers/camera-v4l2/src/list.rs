//! Lists the cameras of the machine and what they can do.

use crate::controls::names;
use crate::device::{ControlDescription, ControlKind, Controls, Formats};
use crate::error::{self, MULTIPLANAR};
use crate::identity::{self, DeviceNode, SystemRoots};
use crate::kernel::V4l2Device;
use penumbra_interface::{CameraControl, CameraInfo};
use v4l::control::Flags;

/// All cameras of this machine.
///
/// Each is opened for a moment, which does not disturb a stream. A camera that cannot be
/// opened is listed with the reason in `trouble`. Device files that are not cameras (metadata
/// nodes, outputs, codecs) are left out.
#[must_use]
pub fn list_cameras() -> Vec<CameraInfo> {
    let nodes = identity::all(&SystemRoots::default());
    nodes.iter().filter_map(describe).collect()
}

fn describe(node: &DeviceNode) -> Option<CameraInfo> {
    let info = CameraInfo {
        name: node.name.clone(),
        node: node.path.display().to_string(),
        by_id: node.by_id.clone(),
        by_path: node.by_path.clone(),
        usb: node.usb.clone(),
        ..CameraInfo::default()
    };
    let device = match V4l2Device::open(&node.path) {
        Ok(device) => device,
        Err(errno) => {
            return (node.index == 0).then(|| CameraInfo {
                identity: node.identity(None),
                trouble: Some(error::open_failed(&node.path, errno).to_string()),
                ..info
            });
        }
    };
    let capabilities = device.capabilities().ok()?;
    let trouble = match (capabilities.captures, capabilities.multiplanar) {
        (true, _) => None,
        (false, true) => Some(MULTIPLANAR.to_owned()),
        (false, false) => return None,
    };
    Some(CameraInfo {
        identity: node.identity(Some(&capabilities.bus)),
        name: capabilities.card,
        driver: capabilities.driver,
        bus: capabilities.bus,
        formats: device.formats(),
        controls: controls(&device),
        trouble,
        ..info
    })
}

fn controls(device: &V4l2Device) -> Vec<CameraControl> {
    let described = device.describe_controls().into_iter();
    let numeric = described.filter(|control| control.kind != ControlKind::Other);
    numeric
        .map(|control| describe_control(device, &control))
        .collect()
}

fn describe_control(device: &V4l2Device, control: &ControlDescription) -> CameraControl {
    CameraControl {
        name: names::from_title(&control.title),
        kind: kind(control.kind).to_owned(),
        min: control.min,
        max: control.max,
        step: control.step,
        default: control.default,
        current: device.read_control(control.id, control.kind).ok(),
        menu: device.menu(control),
        flags: flags(control.flags),
    }
}

const fn kind(kind: ControlKind) -> &'static str {
    match kind {
        ControlKind::Integer | ControlKind::Integer64 => "integer",
        ControlKind::Boolean => "boolean",
        ControlKind::Menu => "menu",
        ControlKind::Button => "button",
        ControlKind::Bitmask => "bitmask",
        ControlKind::IntegerMenu => "integer menu",
        ControlKind::Other => "other",
    }
}

/// The flags that explain why a control may not be settable.
fn flags(set: Flags) -> Vec<String> {
    let named = [
        (Flags::INACTIVE, "inactive"),
        (Flags::READ_ONLY, "read-only"),
        (Flags::WRITE_ONLY, "write-only"),
        (Flags::GRABBED, "grabbed"),
        (Flags::VOLATILE, "volatile"),
    ];
    let named = named.iter().filter(|(flag, _)| set.contains(*flag));
    named.map(|(_, name)| (*name).to_owned()).collect()
}
