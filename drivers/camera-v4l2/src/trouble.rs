//! The kernel's errors as what the user is told and the supervisor acts on.

use crate::video::is_gone;
use penumbra_interface::DeviceError;
use rustix::io::Errno;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Opening the device file failed.
pub(crate) fn on_open(node: &Path, errno: Errno) -> DeviceError {
    let device = node.display().to_string();
    match errno {
        Errno::NOENT | Errno::NODEV | Errno::NXIO => DeviceError::NotFound { device },
        Errno::BUSY => DeviceError::Busy { device },
        Errno::ACCESS | Errno::PERM => DeviceError::NotPermitted {
            device,
            group: group(node, Path::new("/etc/group")),
        },
        // Not a video device, see `Node::open`.
        Errno::NOTTY => crate::camera::refused(&device, crate::camera::NO_CAMERA.to_owned()),
        other => DeviceError::Broken {
            device,
            reason: format!("opening: {other}"),
        },
    }
}

/// A step of setting up failed: `what` names it ("choosing the format").
pub(crate) fn on_setup(device: &str, what: &str, errno: Errno) -> DeviceError {
    let device = device.to_owned();
    match errno {
        Errno::BUSY => DeviceError::Busy { device },
        gone if is_gone(gone) => DeviceError::Unplugged { device },
        other => DeviceError::Broken {
            device,
            reason: format!("{what}: {other}"),
        },
    }
}

/// Streaming failed.
pub(crate) fn on_stream(device: &str, what: &str, errno: Errno) -> DeviceError {
    let device = device.to_owned();
    if is_gone(errno) {
        return DeviceError::Unplugged { device };
    }
    DeviceError::Broken {
        device,
        reason: format!("{what}: {errno}"),
    }
}

/// The group that a device file belongs to; `video` where it cannot be told, as on nearly
/// every distribution.
fn group(node: &Path, groups: &Path) -> String {
    let name = || {
        let gid = std::fs::metadata(node).ok()?.gid();
        let groups = std::fs::read_to_string(groups).ok()?;
        groups.lines().find_map(|line| {
            let mut fields = line.split(':');
            let name = fields.next()?;
            let number: u32 = fields.nth(1)?.parse().ok()?;
            (number == gid && gid != 0).then(|| name.to_owned())
        })
    };
    name().unwrap_or_else(|| "video".to_owned())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use penumbra_interface::Recovery;

    #[test]
    fn no_permission_names_group_and_command() {
        let folder = tempfile::tempdir().unwrap();
        let node = folder.path().join("video0");
        std::fs::write(&node, "").unwrap();
        let error = on_open(&node, Errno::ACCESS);
        assert!(
            error.to_string().contains("sudo usermod -aG video $USER"),
            "{error}"
        );
        assert_eq!(error.recovery(), Recovery::Reopen);
    }

    #[test]
    fn what_may_pass_is_tried_again() {
        for errno in [Errno::NOENT, Errno::BUSY, Errno::IO, Errno::NOMEM] {
            let error = on_open(Path::new("/dev/video9"), errno);
            assert!(error.to_string().starts_with("/dev/video9: "), "{error}");
            assert_eq!(error.recovery(), Recovery::Reopen, "{errno}");
        }
        let gone = on_stream("cam", "reading", Errno::NODEV);
        assert!(matches!(gone, DeviceError::Unplugged { .. }));
        let broken = on_stream("cam", "reading", Errno::IO);
        assert!(matches!(broken, DeviceError::Broken { .. }));
    }
}
