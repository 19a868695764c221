//! A pseudo-terminal in the place of a serial port.

use crate::serve::Outlet;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, FdFlags, fcntl_setfd};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, ioctl_tiocnxcl, tcgetattr, tcsetattr};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The device's end of a pseudo-terminal; a driver opens [`path`](Pty::path) like a serial
/// port. Dropping it hangs up.
#[derive(Debug)]
pub struct Pty {
    device: OwnedFd,
    path: PathBuf,
    /// Keeps the driver's end open, so that drivers may open and close it: while it is not open,
    /// reading at the device's end fails.
    driver_end: File,
    link: Option<PathBuf>,
}

impl Pty {
    /// Creates a pseudo-terminal in raw mode. In the default mode, bytes that the device sends
    /// before a driver has opened its end would be echoed to the device.
    ///
    /// # Errors
    /// The operating system cannot create or configure it.
    pub fn open() -> io::Result<Self> {
        let device = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        // macOS does not accept this as a flag of `openpt`.
        fcntl_setfd(&device, FdFlags::CLOEXEC)?;
        grantpt(&device)?;
        unlockpt(&device)?;
        rustix::io::ioctl_fionbio(&device, true)?;
        let path = PathBuf::from(ptsname(&device, Vec::new())?.to_string_lossy().into_owned());
        let driver_end = OpenOptions::new().read(true).write(true).open(&path)?;
        let mut settings = tcgetattr(&driver_end)?;
        settings.make_raw();
        tcsetattr(&driver_end, OptionalActions::Now, &settings)?;
        Ok(Self {
            device,
            path,
            driver_end,
            link: None,
        })
    }

    /// The path of the driver's end.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes a symbolic link to the driver's end, and replaces a link that exists already. The
    /// link is removed when this is dropped.
    ///
    /// # Errors
    /// Something other than a link exists at that path, or the link cannot be made.
    pub fn link(&mut self, link: &Path) -> io::Result<()> {
        if link.symlink_metadata().is_ok_and(|data| data.is_symlink()) {
            std::fs::remove_file(link)?;
        }
        std::os::unix::fs::symlink(&self.path, link)?;
        self.link = Some(link.to_owned());
        Ok(())
    }
}

impl Outlet for Pty {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        // A driver that was killed has left its exclusive mode on.
        let _ = ioctl_tiocnxcl(&self.driver_end);
        let timeout = Timespec {
            tv_sec: timeout.as_secs().cast_signed(),
            tv_nsec: timeout.subsec_nanos().into(),
        };
        let mut polled = [PollFd::new(&self.device, PollFlags::IN)];
        match poll(&mut polled, Some(&timeout)) {
            Ok(0) | Err(Errno::INTR) => return Ok(0),
            result => result?,
        };
        match rustix::io::read(&self.device, buffer) {
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            result => Ok(result?),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut rest = bytes;
        while !rest.is_empty() {
            match rustix::io::write(&self.device, rest) {
                Ok(count) => rest = rest.get(count..).unwrap_or_default(),
                Err(Errno::INTR) => {}
                // No driver reads: the bytes are lost, as on a serial line.
                Err(Errno::AGAIN) => return Ok(()),
                Err(error) => return Err(error.into()),
            }
        }
        Ok(())
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && std::fs::read_link(link).is_ok_and(|target| target == self.path)
        {
            let _ = std::fs::remove_file(link);
        }
    }
}
