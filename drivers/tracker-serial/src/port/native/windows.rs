//! Windows: `serialport` reads and writes; its time limits belong to the port, not to a call.

use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use serialport::{COMPort, SerialPort};
use std::io::{self, ErrorKind, Read, Write};
use std::path::Path;
use std::time::Duration;

/// An open serial port.
pub type NativePort = COMPort;

/// The name of a port that is about to be opened. The system opens a serial port for one
/// program at a time, so there is nothing to check before.
pub struct Preflight {
    name: String,
}

impl Preflight {
    /// Whether the system has no port of that name. `serialport` gives the same error for an absent
    /// port and for a port in use.
    pub fn is_gone(&self) -> bool {
        let ports = serialport::available_ports().unwrap_or_default();
        !ports
            .iter()
            .any(|port| port.port_name.eq_ignore_ascii_case(&self.name))
    }
}

/// Remembers the name.
///
/// # Errors
/// None.
pub fn preflight(path: &Path) -> io::Result<Preflight> {
    let name = path.to_string_lossy();
    let name = name.strip_prefix(r"\\.\").unwrap_or(&name);
    Ok(Preflight {
        name: name.to_owned(),
    })
}

/// Whether an error means that the port is disconnected.
pub fn is_gone(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::BrokenPipe | ErrorKind::UnexpectedEof
    )
}

/// Windows has no pseudo-terminals.
pub const fn is_pseudo_terminal(_path: &Path) -> bool {
    false
}

/// Does nothing.
///
/// # Errors
/// None.
pub const fn prepare(_port: &NativePort) -> io::Result<()> {
    Ok(())
}

/// Waits up to `timeout` for bytes and reads the available ones; returns their number and the time,
/// `None` if there are none.
///
/// # Errors
/// The system reports a failed read.
pub fn read(
    port: &mut NativePort,
    buffer: &mut [u8],
    timeout: Duration,
) -> io::Result<Option<(usize, MonotonicTime)>> {
    limit(port, timeout)?;
    let read = port.read(buffer);
    let arrived_at = SystemClock.now();
    match read {
        Ok(0) => Ok(None),
        Ok(count) => Ok(Some((count, arrived_at))),
        Err(error) if error.kind() == ErrorKind::TimedOut => Ok(None),
        Err(error) => Err(error),
    }
}

/// Writes all of `bytes`.
///
/// # Errors
/// `TimedOut` if the port accepts nothing for `timeout`; else the system's error.
pub fn write_all(port: &mut NativePort, bytes: &[u8], timeout: Duration) -> io::Result<()> {
    limit(port, timeout)?;
    let mut rest = bytes;
    while !rest.is_empty() {
        match port.write(rest)? {
            // A write that times out succeeds with fewer bytes.
            0 => return Err(ErrorKind::TimedOut.into()),
            count => rest = rest.get(count..).unwrap_or_default(),
        }
    }
    Ok(())
}

/// Zero would mean no limit, and the system counts in milliseconds.
fn limit(port: &mut NativePort, timeout: Duration) -> io::Result<()> {
    Ok(port.set_timeout(timeout.max(Duration::from_millis(1)))?)
}
