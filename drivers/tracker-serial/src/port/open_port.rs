//! Opens a serial port, with one-line errors.

use super::access::{busy, not_permitted};
use super::line_settings::LineSettings;
use super::native::{self, NativePort, Preflight};
use penumbra_interface::DeviceError;
use serialport::{ClearBuffer, SerialPort};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

const BY_ID: &str = "/dev/serial/by-id";

/// Returns the path of a configured name: the name itself if it is a path, else the link under
/// `/dev/serial/by-id`.
pub(super) fn device_path(name: &str) -> PathBuf {
    if name.contains(std::path::MAIN_SEPARATOR) || cfg!(windows) {
        PathBuf::from(name)
    } else {
        Path::new(BY_ID).join(name)
    }
}

/// Opens the port at `path` for this process alone, sets its line and empties its buffers.
/// `name` is the configured one, for messages.
///
/// # Errors
/// The port is absent, not permitted, in use, not a serial port, or does not accept the settings.
pub(super) fn open_port(
    name: &str,
    path: &Path,
    requested: LineSettings,
) -> Result<NativePort, DeviceError> {
    if requested.baud == 0 {
        // The system interprets this rate as the command to hang up.
        return Err(refused(name, "0 is not a baud rate; set another `baud`"));
    }
    let preflight = native::preflight(path).map_err(|error| preflight_error(name, path, &error))?;
    let (port, actual) = configure(path, requested)
        .map_err(|error| configure_error(name, path, &error, &preflight))?;
    if requested.are_met_by(actual) || native::is_pseudo_terminal(path) {
        return Ok(port);
    }
    let reason = format!(
        "was set to {requested}, but uses {actual}; set another `baud`, or use another adapter"
    );
    Err(refused(name, &reason))
}

/// Opens and configures a port by `serialport`, and reads back the settings that it has then:
/// `serialport` does not check whether the driver accepted them.
fn configure(
    path: &Path,
    requested: LineSettings,
) -> serialport::Result<(NativePort, LineSettings)> {
    let mut line = requested;
    if cfg!(target_os = "macos") && native::is_pseudo_terminal(path) {
        // Setting a baud rate there fails; 0 leaves it out.
        line.baud = 0;
    }
    // Boards with built-in USB send only while DTR is up. Windows leaves it down.
    let builder = serialport::new(path.to_string_lossy(), line.baud).dtr_on_open(true);
    let port = line.apply(builder).open_native()?;
    native::prepare(&port)?;
    port.clear(ClearBuffer::All)?;
    let actual = LineSettings::of(&port)?;
    Ok((port, actual))
}

fn preflight_error(name: &str, path: &Path, error: &io::Error) -> DeviceError {
    match error.kind() {
        ErrorKind::NotFound => not_found(name),
        ErrorKind::PermissionDenied => not_permitted(name, path),
        ErrorKind::ResourceBusy => busy(path),
        _ if native::is_gone(error) => not_found(name),
        _ => {
            let reason = format!("is no serial port ({error}); `penumbra devices` lists the ports");
            refused(name, &reason)
        }
    }
}

/// `serialport` maps most of the system's error numbers to one kind, so the preflight is asked
/// whether the port is still there.
fn configure_error(
    name: &str,
    path: &Path,
    error: &serialport::Error,
    preflight: &Preflight,
) -> DeviceError {
    if preflight.is_gone() {
        return not_found(name);
    }
    match error.kind() {
        serialport::ErrorKind::NoDevice => busy(path),
        _ => refused(
            name,
            &format!("cannot be set up as a serial port ({error})"),
        ),
    }
}

fn not_found(name: &str) -> DeviceError {
    DeviceError::NotFound {
        device: name.to_owned(),
    }
}

fn refused(name: &str, reason: &str) -> DeviceError {
    DeviceError::Refused {
        device: name.to_owned(),
        reason: reason.to_owned(),
    }
}

#[cfg(all(test, unix))]
mod tests;
