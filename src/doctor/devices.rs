//! Checks presence and permissions of cameras, graphics cards and serial ports.

use super::Check;
use rustix::fs::Access;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A family of device files.
struct Family {
    name: &'static str,
    folder: &'static str,
    prefixes: &'static [&'static str],
    /// Message if there is none.
    none: &'static str,
}

/// Only USB serial ports: the on-board /dev/ttyS* exist even if nothing is connected.
const FAMILIES: [Family; 3] = [
    Family {
        name: "cameras",
        folder: "dev",
        prefixes: &["video"],
        none: "no /dev/video*; recorded sessions need none",
    },
    Family {
        name: "graphics cards",
        folder: "dev/dri",
        prefixes: &["renderD"],
        none: "no /dev/dri/renderD*; the software driver needs none",
    },
    Family {
        name: "serial ports",
        folder: "dev",
        prefixes: &["ttyUSB", "ttyACM"],
        none: "no /dev/ttyUSB* or ttyACM*; recorded sessions need none",
    },
];

pub(super) fn examine(root: &Path) -> Vec<Check> {
    FAMILIES.iter().map(|family| check(family, root)).collect()
}

fn check(family: &Family, root: &Path) -> Check {
    let devices = devices(family, root);
    if devices.is_empty() {
        return Check::ok(family.name, family.none);
    }
    let refused: Vec<&PathBuf> = devices.iter().filter(|path| !usable(path)).collect();
    let Some(first) = refused.first() else {
        return Check::ok(family.name, listed(&devices, root));
    };
    Check::warn(
        family.name,
        format!("no permission: {}", listed(&refused, root)),
        remedy(first, root),
    )
}

fn devices(family: &Family, root: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(root.join(family.folder)) else {
        return Vec::new();
    };
    let mut found: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| {
            let name = path.file_name().and_then(|n| n.to_str()).unwrap_or("");
            family
                .prefixes
                .iter()
                .any(|prefix| name.starts_with(prefix))
        })
        .collect();
    found.sort();
    found
}

/// Checks permissions without opening the device: opening a serial port resets some trackers.
fn usable(device: &Path) -> bool {
    rustix::fs::access(device, Access::READ_OK | Access::WRITE_OK).is_ok()
}

fn listed(devices: &[impl AsRef<Path>], root: &Path) -> String {
    let names: Vec<String> = devices
        .iter()
        .map(|path| {
            let path = path.as_ref();
            let shown = path.strip_prefix(root).unwrap_or(path);
            format!("/{}", shown.display())
        })
        .collect();
    names.join(", ")
}

/// Returns the command that adds the user to the device's group, whose name differs between
/// distributions.
fn remedy(device: &Path, root: &Path) -> String {
    let group = std::fs::metadata(device)
        .ok()
        .and_then(|meta| group_name(root, meta.gid()));
    match group {
        Some(group) if group != "root" => {
            format!("sudo usermod -aG {group} \"$USER\", then log out and in")
        }
        _ => "install the udev rules in systemd/ and plug the device in again".into(),
    }
}

fn group_name(root: &Path, gid: u32) -> Option<String> {
    let groups = std::fs::read_to_string(root.join("etc/group")).ok()?;
    groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        let number: u32 = fields.nth(1)?.parse().ok()?;
        (number == gid).then(|| name.to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::State;

    fn machine() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for folder in ["dev/dri", "etc"] {
            std::fs::create_dir_all(root.path().join(folder)).unwrap();
        }
        root
    }

    #[test]
    fn lists_known_devices_in_order() {
        let root = machine();
        for name in [
            "video2",
            "video0",
            "vcs",
            "ttyUSB0",
            "ttyS0",
            "dri/renderD128",
        ] {
            std::fs::write(root.path().join("dev").join(name), "").unwrap();
        }
        let checks = examine(root.path());
        let found: Vec<&str> = checks.iter().map(|c| c.found.as_str()).collect();
        assert_eq!(
            found,
            [
                "/dev/video0, /dev/video2",
                "/dev/dri/renderD128",
                "/dev/ttyUSB0"
            ]
        );
    }

    #[test]
    fn names_the_group_of_an_inaccessible_device() {
        let root = machine();
        // A dangling link is refused to everyone, root included.
        let camera = root.path().join("dev/video0");
        std::os::unix::fs::symlink("gone", &camera).unwrap();
        let check = check(&FAMILIES[0], root.path());
        assert_eq!(check.state, State::Warn);
        assert!(check.found.ends_with("/dev/video0"), "{}", check.found);

        let node = root.path().join("dev/video1");
        std::fs::write(&node, "").unwrap();
        let gid = std::fs::metadata(&node).unwrap().gid();
        let groups = format!("root:x:4294967294:\nvideo:x:{gid}:someone\n");
        std::fs::write(root.path().join("etc/group"), groups).unwrap();
        assert!(remedy(&node, root.path()).contains("usermod -aG video"));
    }

    #[test]
    fn a_machine_without_devices_is_ok() {
        let root = machine();
        assert!(examine(root.path()).iter().all(|c| c.state == State::Ok));
    }
}
