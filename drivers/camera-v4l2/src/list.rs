//! Which cameras there are, and what they can do.

use crate::contract::names;
use crate::identity::{self, Place, Roots};
use crate::kernel::Node;
use crate::trouble;
use crate::video::{ControlKind, Controls, Modes};
use penumbra_interface::{CameraControl, CameraInfo};
use v4l::control::Flags;

/// All cameras of this machine. Opens each for a moment, which disturbs no stream. A
/// camera that cannot be opened is listed with its `trouble`; device files that are no
/// cameras (metadata, outputs, codecs) are left out.
#[must_use]
pub fn list_cameras() -> Vec<CameraInfo> {
    let places = identity::all(&Roots::default());
    places.iter().filter_map(describe).collect()
}

fn describe(place: &Place) -> Option<CameraInfo> {
    let info = CameraInfo {
        name: place.name.clone(),
        node: place.node.display().to_string(),
        by_id: place.by_id.clone(),
        by_path: place.by_path.clone(),
        usb: place.usb.clone(),
        ..CameraInfo::default()
    };
    let node = match Node::open(&place.node) {
        Ok(node) => node,
        Err(error) => {
            return (place.index == 0).then(|| CameraInfo {
                identity: place.identity(None),
                trouble: Some(trouble::on_open(&place.node, error).to_string()),
                ..info
            });
        }
    };
    let capabilities = node.capabilities().ok()?;
    let trouble = match (capabilities.captures, capabilities.multiplanar) {
        (true, _) => None,
        (false, true) => Some(crate::camera::MULTIPLANAR.to_owned()),
        (false, false) => return None,
    };
    Some(CameraInfo {
        identity: place.identity(Some(&capabilities.bus)),
        name: capabilities.card,
        driver: capabilities.driver,
        bus: capabilities.bus,
        formats: node.formats(),
        controls: controls(&node),
        trouble,
        ..info
    })
}

fn controls(node: &Node) -> Vec<CameraControl> {
    let described = node.describe_controls().into_iter();
    let settable = described.filter(|control| control.kind != ControlKind::Other);
    settable
        .map(|control| CameraControl {
            name: names::of_title(&control.title),
            kind: kind(control.kind).to_owned(),
            min: control.min,
            max: control.max,
            step: control.step,
            default: control.default,
            current: node.control(control.id, control.kind).ok(),
            menu: node.menu(&control),
            flags: flags(control.flags),
        })
        .collect()
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
