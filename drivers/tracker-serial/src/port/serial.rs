//! Serial ports.

use super::group::permission_hint;
use super::line::Line;
use super::tracker::LineTracker;
use crate::settings::TrackerSettings;
use penumbra_interface::{Clock, DeviceError, MonotonicTime, SystemClock};
use serial2::{CharSize, Parity, SerialPort, Settings, StopBits};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::Duration;

const WRITE_TIMEOUT: Duration = Duration::from_secs(1);
const BY_ID: &str = "/dev/serial/by-id";

/// A tracker on a serial port.
pub type SerialTracker = LineTracker<SerialLine>;

impl SerialTracker {
    /// Opens the port, tells the device its mode and sees that it streams. `name` is a path
    /// or a name under `/dev/serial/by-id`.
    ///
    /// # Errors
    /// See [`open`](super::open).
    pub fn open(settings: &TrackerSettings, name: &str) -> Result<Self, DeviceError> {
        // FreeD's manual: 38400 baud, odd parity.
        let parity = if settings.protocol.starts_with("freed") {
            Parity::Odd
        } else {
            Parity::None
        };
        let line = SerialLine::open(name, settings.baud(), parity)?;
        let identity = super::list::stable_name(&line.path);
        let mut tracker = Self::start(line, settings, identity)?;
        tracker.append_baud(settings.baud());
        if let Some(warning) = super::list::latency_warning(&device_path(name)) {
            tracker.warn(warning);
        }
        Ok(tracker)
    }
}

/// An open serial port, ours alone.
#[derive(Debug)]
pub struct SerialLine {
    port: SerialPort,
    path: PathBuf,
}

impl SerialLine {
    /// Opens a port exclusively, 8 data bits, 1 stop bit, no flow control.
    ///
    /// # Errors
    /// Absence, lack of permission, another program that has it: each by name, with what
    /// to do.
    pub fn open(name: &str, baud: u32, parity: Parity) -> Result<Self, DeviceError> {
        let path = device_path(name);
        let configure = |parity: Parity| {
            move |mut settings: Settings| {
                settings.set_raw();
                settings.set_baud_rate(baud)?;
                settings.set_char_size(CharSize::Bits8);
                settings.set_stop_bits(StopBits::One);
                settings.set_parity(parity);
                Ok(settings)
            }
        };
        let opened = SerialPort::open(&path, configure(parity)).or_else(|error| {
            // A pseudo-terminal has no parity and needs none; serial2 says that not all
            // settings were taken.
            if parity != Parity::None && error.kind() == ErrorKind::Other {
                SerialPort::open(&path, configure(Parity::None))
            } else {
                Err(error)
            }
        });
        let mut port = opened.map_err(|error| open_error(&path, name, &error))?;
        claim(&port, &path)?;
        let ready = port
            .set_read_timeout(Duration::ZERO)
            .and_then(|()| port.set_write_timeout(WRITE_TIMEOUT))
            .and_then(|()| port.discard_buffers());
        ready.map_err(|error| open_error(&path, name, &error))?;
        Ok(Self { port, path })
    }

    fn unplugged(&self) -> DeviceError {
        DeviceError::Unplugged {
            device: self.path.display().to_string(),
        }
    }

    fn failed(&self, error: &io::Error) -> DeviceError {
        if is_gone(error) {
            return self.unplugged();
        }
        DeviceError::Unready {
            device: self.path.display().to_string(),
            reason: format!("{error}; plug it in again"),
        }
    }
}

/// The path that a configured name stands for.
pub(super) fn device_path(name: &str) -> PathBuf {
    if name.contains(std::path::MAIN_SEPARATOR) || cfg!(windows) {
        PathBuf::from(name)
    } else {
        Path::new(BY_ID).join(name)
    }
}

/// What the kernel answers when a USB adapter is pulled out or a pseudo-terminal's other
/// end is closed.
fn is_gone(error: &io::Error) -> bool {
    #[cfg(unix)]
    let by_number = error
        .raw_os_error()
        .map(rustix::io::Errno::from_raw_os_error)
        .is_some_and(|errno| {
            use rustix::io::Errno;
            [Errno::IO, Errno::NXIO, Errno::NODEV, Errno::PIPE].contains(&errno)
        });
    #[cfg(not(unix))]
    let by_number = false;
    by_number
        || matches!(
            error.kind(),
            ErrorKind::BrokenPipe | ErrorKind::UnexpectedEof
        )
}

fn open_error(path: &Path, name: &str, error: &io::Error) -> DeviceError {
    let device = name.to_owned();
    match error.kind() {
        ErrorKind::NotFound => DeviceError::NotFound { device },
        ErrorKind::PermissionDenied => DeviceError::Refused {
            device,
            reason: permission_hint(path),
        },
        ErrorKind::ResourceBusy => busy(path),
        _ if is_gone(error) => DeviceError::NotFound { device },
        _ => DeviceError::Refused {
            device,
            reason: format!(
                "is no serial port ({error}); `penumbra devices` lists those there are"
            ),
        },
    }
}

fn busy(path: &Path) -> DeviceError {
    let holder = super::group::holder_of(path).map_or_else(
        || "another program has it open".to_owned(),
        |holder| format!("{holder} has it open"),
    );
    DeviceError::Unready {
        device: path.display().to_string(),
        reason: format!("busy: {holder}; end that program"),
    }
}

/// Nobody else may open it. The ioctl keeps others out, but not root; the lock keeps root
/// out who asks for it, as other Penumbras and most terminal programs do.
#[cfg(unix)]
fn claim(port: &SerialPort, path: &Path) -> Result<(), DeviceError> {
    use rustix::fs::{FlockOperation, flock};
    if flock(port, FlockOperation::NonBlockingLockExclusive) == Err(rustix::io::Errno::WOULDBLOCK) {
        return Err(busy(path));
    }
    // A pseudo-terminal of some systems has no such ioctl; the lock is held by now.
    let _ = rustix::termios::ioctl_tiocexcl(port);
    Ok(())
}

#[cfg(not(unix))]
fn claim(_port: &SerialPort, _path: &Path) -> Result<(), DeviceError> {
    // The system opens serial ports exclusively of itself.
    Ok(())
}

#[cfg(unix)]
impl Drop for SerialLine {
    /// Gives the exclusive use back: where somebody else holds the port open, as a
    /// simulated device does, closing alone would leave it taken.
    fn drop(&mut self) {
        let _ = rustix::termios::ioctl_tiocnxcl(&self.port);
    }
}

impl Line for SerialLine {
    fn read(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
    ) -> Result<Option<(usize, MonotonicTime)>, DeviceError> {
        if !wait(&self.port, timeout).map_err(|error| self.failed(&error))? {
            return Ok(None);
        }
        let read = self.port.read(buffer);
        let arrived_at = SystemClock.now();
        match read {
            // Readable and nothing there: the other end is gone. Reading on would spin.
            Ok(0) => Err(self.unplugged()),
            Ok(count) => Ok(Some((count, arrived_at))),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                Ok(None)
            }
            Err(error) => Err(self.failed(&error)),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), DeviceError> {
        self.port.write_all(bytes).map_err(|error| {
            if error.kind() == ErrorKind::TimedOut {
                DeviceError::Silent {
                    device: self.path.display().to_string(),
                    millis: u64::try_from(WRITE_TIMEOUT.as_millis()).unwrap_or(u64::MAX),
                }
            } else {
                self.failed(&error)
            }
        })
    }
}

/// Whether there is something to read within `timeout`. Signals do not end the wait.
///
/// # Errors
/// `BrokenPipe` if the other end has hung up and nothing is left to read.
#[cfg(unix)]
pub(super) fn wait(port: &impl std::os::fd::AsFd, timeout: Duration) -> io::Result<bool> {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};
    let until = SystemClock.now() + timeout;
    loop {
        let left = until.nanos_since(SystemClock.now()).max(0);
        let left = Timespec {
            tv_sec: left / 1_000_000_000,
            tv_nsec: left % 1_000_000_000,
        };
        let mut polled = [PollFd::new(port, PollFlags::IN)];
        match poll(&mut polled, Some(&left)) {
            Err(rustix::io::Errno::INTR) => {}
            Err(error) => return Err(error.into()),
            Ok(0) => return Ok(false),
            Ok(_) if polled[0].revents().contains(PollFlags::IN) => return Ok(true),
            Ok(_) => return Err(ErrorKind::BrokenPipe.into()),
        }
    }
}

/// Elsewhere the read itself waits.
#[cfg(not(unix))]
fn wait(port: &SerialPort, timeout: Duration) -> io::Result<bool> {
    let mut port = port.try_clone()?;
    port.set_read_timeout(timeout)?;
    Ok(true)
}
