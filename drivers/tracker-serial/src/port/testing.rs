//! A pseudo-terminal for tests of ports, without a device at its other end.
#![expect(clippy::unwrap_used)]

use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::os::fd::OwnedFd;
use std::path::PathBuf;

/// Both ends of a pseudo-terminal that passes bytes unchanged.
pub(super) struct PtyPair {
    /// The device's end.
    pub device: OwnedFd,
    /// The end that a driver opens.
    pub driver: OwnedFd,
    /// Where a driver opens it.
    pub path: PathBuf,
}

impl PtyPair {
    pub(super) fn open() -> Self {
        let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&device).unwrap();
        unlockpt(&device).unwrap();
        rustix::io::ioctl_fionbio(&device, true).unwrap();
        let path = ptsname(&device, Vec::new()).unwrap().into_string().unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK;
        let driver = rustix::fs::open(&path, flags, Mode::empty()).unwrap();
        let mut settings = tcgetattr(&driver).unwrap();
        settings.make_raw();
        tcsetattr(&driver, OptionalActions::Now, &settings).unwrap();
        Self {
            device,
            driver,
            path: path.into(),
        }
    }
}
