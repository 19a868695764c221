//! Error numbers of the kernel as errors for the user and for the supervisor, which reopens
//! the camera or gives up.

use crate::device::is_disconnected;
use penumbra_interface::DeviceError;
use rustix::io::Errno;
use std::os::unix::fs::MetadataExt;
use std::path::Path;

pub(crate) const NOT_A_CAMERA: &str = "not a camera, but for example a metadata node, an \
    output or a codec; `penumbra devices` lists the cameras";

/// Why a multi-planar device is refused. Preloading libcamera's V4L2 compatibility layer would
/// not help: it replaces the C library's `ioctl`, which neither rustix nor the crate `v4l` calls.
pub(crate) const MULTIPLANAR: &str = "a multi-planar capture device, usually a camera that \
    needs libcamera; let another program feed its pictures into a v4l2loopback device, and \
    name that one";

/// The device cannot be used as it is or as the settings ask. Only the user can help.
pub(crate) fn refused(device: &str, reason: impl Into<String>) -> DeviceError {
    DeviceError::Refused {
        device: device.to_owned(),
        reason: reason.into(),
    }
}

/// Opening the device file failed.
pub(crate) fn open_failed(path: &Path, errno: Errno) -> DeviceError {
    let device = path.display().to_string();
    match errno {
        Errno::NOENT | Errno::NODEV | Errno::NXIO => DeviceError::NotFound { device },
        Errno::BUSY => DeviceError::Busy { device },
        Errno::ACCESS | Errno::PERM => DeviceError::NotPermitted {
            device,
            group: group(path, Path::new("/etc/group")),
        },
        // See `V4l2Device::open`.
        Errno::NOTTY => refused(&device, NOT_A_CAMERA),
        other => DeviceError::Broken {
            device,
            reason: format!("opening: {other}"),
        },
    }
}

/// A step before the stream started failed. `step` names it: "setting the format".
pub(crate) fn setup_failed(device: &str, step: &str, errno: Errno) -> DeviceError {
    match errno {
        Errno::BUSY => DeviceError::Busy {
            device: device.to_owned(),
        },
        other => stream_failed(device, step, other),
    }
}

/// A step of a running stream failed.
pub(crate) fn stream_failed(device: &str, step: &str, errno: Errno) -> DeviceError {
    let device = device.to_owned();
    if is_disconnected(errno) {
        return DeviceError::Unplugged { device };
    }
    DeviceError::Broken {
        device,
        reason: format!("{step}: {errno}"),
    }
}

/// The group that a device file belongs to. Where it is not known, `video`: so it is called on
/// nearly every distribution.
fn group(path: &Path, groups: &Path) -> String {
    let name = || {
        let gid = std::fs::metadata(path).ok()?.gid();
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
    use super::*;
    use penumbra_interface::Recovery;

    #[test]
    fn missing_permission_names_the_group_and_the_command() {
        let folder = tempfile::tempdir().unwrap();
        let node = folder.path().join("video0");
        std::fs::write(&node, "").unwrap();
        let error = open_failed(&node, Errno::ACCESS);
        assert!(
            error.to_string().contains("sudo usermod -aG video $USER"),
            "{error}"
        );
        assert_eq!(error.recovery(), Recovery::Reopen);
    }

    #[test]
    fn only_a_device_that_is_no_camera_is_not_retried() {
        for errno in [Errno::NOENT, Errno::BUSY, Errno::IO, Errno::NOMEM] {
            let error = open_failed(Path::new("/dev/video9"), errno);
            assert!(error.to_string().starts_with("/dev/video9: "), "{error}");
            assert_eq!(error.recovery(), Recovery::Reopen, "{errno}");
        }
        let error = open_failed(Path::new("/dev/null"), Errno::NOTTY);
        assert_eq!(error.recovery(), Recovery::Fatal);
    }

    #[test]
    fn distinguishes_disconnected_device_from_broken_stream() {
        let gone = stream_failed("cam", "reading", Errno::NODEV);
        assert!(matches!(gone, DeviceError::Unplugged { .. }));
        let broken = stream_failed("cam", "reading", Errno::IO);
        assert!(matches!(broken, DeviceError::Broken { .. }));
    }
}
