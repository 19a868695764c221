//! Trackers on serial ports.

use super::line::Line;
use super::line_settings::LineSettings;
use super::list::{latency_warning, stable_name};
use super::native::{self, NativePort};
use super::open_port::{device_path, open_port};
use super::tracker::LineTracker;
use crate::settings::TrackerSettings;
use penumbra_interface::{DeviceError, MonotonicTime};
use serialport::Parity;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::time::Duration;

const WRITE_TIMEOUT: Duration = Duration::from_secs(1);

/// A tracker on a serial port.
pub type SerialTracker = LineTracker<SerialLine>;

impl SerialTracker {
    /// Opens the port, configures the device and waits until it streams. `name` is a path or a
    /// name under `/dev/serial/by-id`.
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
        let identity = stable_name(&line.path);
        let warning = latency_warning(&line.path);
        let mut tracker = Self::start(line, settings, identity)?;
        tracker.append_baud(settings.baud());
        if let Some(warning) = warning {
            tracker.warn(warning);
        }
        Ok(tracker)
    }
}

/// An open serial port that no other program can open.
#[derive(Debug)]
pub struct SerialLine {
    port: NativePort,
    path: PathBuf,
}

impl SerialLine {
    /// Opens a port for this process alone: 8 data bits, 1 stop bit, no flow control.
    ///
    /// # Errors
    /// The port is absent, not permitted, in use (the error names the program), not a serial port,
    /// or does not accept the settings.
    pub fn open(name: &str, baud: u32, parity: Parity) -> Result<Self, DeviceError> {
        let path = device_path(name);
        let port = open_port(name, &path, LineSettings::new(baud, parity))?;
        Ok(Self { port, path })
    }

    fn device(&self) -> String {
        self.path.display().to_string()
    }

    fn failed(&self, error: &io::Error) -> DeviceError {
        let device = self.device();
        if native::is_gone(error) {
            return DeviceError::Unplugged { device };
        }
        DeviceError::Unready {
            device,
            reason: format!("{error}; plug it in again"),
        }
    }
}

impl Line for SerialLine {
    fn read(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
    ) -> Result<Option<(usize, MonotonicTime)>, DeviceError> {
        native::read(&mut self.port, buffer, timeout).map_err(|error| self.failed(&error))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), DeviceError> {
        native::write_all(&mut self.port, bytes, WRITE_TIMEOUT).map_err(|error| {
            if error.kind() == ErrorKind::TimedOut {
                DeviceError::Silent {
                    device: self.device(),
                    millis: u64::try_from(WRITE_TIMEOUT.as_millis()).unwrap_or(u64::MAX),
                }
            } else {
                self.failed(&error)
            }
        })
    }
}
