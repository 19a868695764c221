//! Unix: `serialport` opens and configures; this module reads and writes.
//!
//! `serialport`'s own `read` takes POLLIN and POLLHUP together for an error and so loses the
//! bytes that came just before a hang-up. Its `write` blocks without limit when a port takes
//! only a part, because it opens ports in blocking mode.

use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FlockOperation, Mode, OFlags, flock};
use rustix::io::Errno;
use serialport::TTYPort;
use std::io::{self, ErrorKind};
use std::os::fd::{AsRawFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::time::Duration;

/// An open serial port.
pub type NativePort = TTYPort;

/// Opens `path` without configuring it and checks that it is a terminal that no other program has
/// locked. Keep the result until the port itself is open, so that the modem lines stay up.
///
/// `serialport` alone is not sufficient: its errors have no error number, which distinguishes an
/// unplugged port from a file that is no port. And if it does not get the lock, it clears the
/// exclusive mode that the other program has set.
///
/// # Errors
/// The system cannot open it, or it is no terminal; `ResourceBusy` if another program has the port.
pub fn preflight(path: &Path) -> io::Result<Preflight> {
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = rustix::fs::open(path, flags, Mode::empty())?;
    rustix::termios::tcgetattr(&port)?;
    if flock(&port, FlockOperation::NonBlockingLockExclusive) == Err(Errno::WOULDBLOCK) {
        return Err(ErrorKind::ResourceBusy.into());
    }
    flock(&port, FlockOperation::Unlock)?;
    Ok(Preflight { port })
}

/// A port that has been opened but not configured.
pub struct Preflight {
    port: OwnedFd,
}

impl Preflight {
    /// Whether the port has been unplugged since.
    pub fn is_gone(&self) -> bool {
        rustix::termios::tcgetattr(&self.port).is_err()
    }
}

/// Pseudo-terminals have no line, so they take parity and data bits without effect.
pub fn is_pseudo_terminal(path: &Path) -> bool {
    let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = real.to_string_lossy();
    name.starts_with("/dev/pts/") || (cfg!(target_os = "macos") && name.starts_with("/dev/ttys"))
}

/// Prepares a port that `serialport` has configured for [`read`] and [`write_all`].
///
/// # Errors
/// The system cannot set its attributes.
pub fn prepare(port: &NativePort) -> io::Result<()> {
    let port = descriptor(port);
    rustix::fs::fcntl_setfl(port, rustix::fs::fcntl_getfl(port)? | OFlags::NONBLOCK)?;
    pass_damaged_bytes(port)
}

/// Drops breaks, and passes bytes with a wrong parity on unchanged: a protocol's checksum handles
/// them better than the kernel, which would replace either by a zero.
#[cfg(target_os = "linux")]
fn pass_damaged_bytes(port: BorrowedFd<'_>) -> io::Result<()> {
    use rustix::termios::{InputModes, OptionalActions, tcgetattr, tcsetattr};
    let mut settings = tcgetattr(port)?;
    settings.input_modes |= InputModes::IGNBRK | InputModes::IGNPAR;
    settings.input_modes -= InputModes::INPCK;
    Ok(tcsetattr(port, OptionalActions::Now, &settings)?)
}

/// On macOS setting attributes again would undo a baud rate that is not a standard one.
#[cfg(not(target_os = "linux"))]
fn pass_damaged_bytes(_port: BorrowedFd<'_>) -> io::Result<()> {
    Ok(())
}

/// Waits up to `timeout` for bytes and reads the available ones; returns their number and the time,
/// `None` if there are none.
///
/// # Errors
/// `BrokenPipe` once the other end has hung up and everything has been read.
pub fn read(
    port: &mut NativePort,
    buffer: &mut [u8],
    timeout: Duration,
) -> io::Result<Option<(usize, MonotonicTime)>> {
    read_from(descriptor(port), buffer, timeout)
}

fn read_from(
    port: BorrowedFd<'_>,
    buffer: &mut [u8],
    timeout: Duration,
) -> io::Result<Option<(usize, MonotonicTime)>> {
    if !wait(port, PollFlags::IN, timeout)? {
        return Ok(None);
    }
    let read = rustix::io::retry_on_intr(|| rustix::io::read(port, &mut *buffer));
    let arrived_at = SystemClock.now();
    match read {
        // Readable but empty: the other end has disconnected. Reading again would spin.
        Ok(0) => Err(ErrorKind::BrokenPipe.into()),
        Ok(count) => Ok(Some((count, arrived_at))),
        Err(Errno::AGAIN) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Whether an error means that a USB adapter has been unplugged or that the other end of a
/// pseudo-terminal is closed.
pub fn is_gone(error: &io::Error) -> bool {
    let numbers = [Errno::IO, Errno::NXIO, Errno::NODEV, Errno::PIPE];
    Errno::from_io_error(error).is_some_and(|number| numbers.contains(&number))
        || matches!(
            error.kind(),
            ErrorKind::BrokenPipe | ErrorKind::UnexpectedEof
        )
}

/// Writes all of `bytes`.
///
/// # Errors
/// `TimedOut` if the port accepts nothing for `timeout`; else the system's error.
pub fn write_all(port: &mut NativePort, bytes: &[u8], timeout: Duration) -> io::Result<()> {
    write_all_to(descriptor(port), bytes, timeout)
}

fn write_all_to(port: BorrowedFd<'_>, bytes: &[u8], timeout: Duration) -> io::Result<()> {
    let mut rest = bytes;
    while !rest.is_empty() {
        if !wait(port, PollFlags::OUT, timeout)? {
            return Err(ErrorKind::TimedOut.into());
        }
        match rustix::io::write(port, rest) {
            Ok(0) => return Err(ErrorKind::WriteZero.into()),
            Ok(count) => rest = rest.get(count..).unwrap_or_default(),
            Err(Errno::AGAIN | Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Waits up to `timeout` until the port is ready for `events`. Signals do not end the wait.
///
/// # Errors
/// `BrokenPipe` if the other end has hung up and the port is not ready any more.
fn wait(port: BorrowedFd<'_>, events: PollFlags, timeout: Duration) -> io::Result<bool> {
    let until = SystemClock.now() + timeout;
    loop {
        let left = until.nanos_since(SystemClock.now()).max(0);
        let left = Timespec {
            tv_sec: left / 1_000_000_000,
            tv_nsec: left % 1_000_000_000,
        };
        let mut polled = [PollFd::from_borrowed_fd(port, events)];
        match poll(&mut polled, Some(&left)) {
            Err(Errno::INTR) => {}
            Err(error) => return Err(error.into()),
            Ok(0) => return Ok(false),
            // Also if a hang-up is reported at the same time: arrived bytes are read first.
            Ok(_) if polled[0].revents().contains(events) => return Ok(true),
            Ok(_) => return Err(ErrorKind::BrokenPipe.into()),
        }
    }
}

/// The port's descriptor, which `serialport` hands out as a bare number.
#[expect(unsafe_code, reason = "TTYPort implements AsRawFd but not AsFd")]
fn descriptor(port: &NativePort) -> BorrowedFd<'_> {
    // SAFETY: the port owns the descriptor and closes it when it is dropped, which the borrow
    // prevents.
    unsafe { BorrowedFd::borrow_raw(port.as_raw_fd()) }
}

#[cfg(test)]
mod tests;
