//! A tracker on a serial port or a socket.

use super::line::Line;
use crate::dialogue::{Action, Answer, Dialogue, Trouble, stop_command};
use crate::settings::TrackerSettings;
use bytes::Bytes;
use penumbra_interface::{
    Clock, DeviceError, MonotonicTime, SystemClock, Tracker, TrackerBytes, TrackerReport,
};
use std::collections::VecDeque;
use std::time::Duration;

/// Maximum number of bytes of one read: a third of a second at 115200 baud.
const READ_LIMIT: usize = 4096;

/// A tracker that streams through a serial port or a socket.
#[derive(Debug)]
pub struct LineTracker<L: Line> {
    line: L,
    settings: TrackerSettings,
    report: TrackerReport,
    /// Parts of the stream that arrived before the end of the dialogue.
    pending: VecDeque<TrackerBytes>,
    /// When the last bytes arrived.
    last_received_at: MonotonicTime,
    buffer: Box<[u8]>,
}

impl<L: Line> LineTracker<L> {
    /// Starts the device on an open line and waits until it streams.
    ///
    /// # Errors
    /// See [`open`](super::open).
    pub fn start(
        line: L,
        settings: &TrackerSettings,
        identity: String,
    ) -> Result<Self, DeviceError> {
        let mut tracker = Self {
            line,
            settings: settings.clone(),
            report: TrackerReport {
                identity,
                protocol: settings.protocol.clone(),
                ..TrackerReport::default()
            },
            pending: VecDeque::new(),
            last_received_at: SystemClock.now(),
            buffer: vec![0; READ_LIMIT].into(),
        };
        let answer = tracker.converse()?;
        tracker.report.description = answer.description;
        tracker.report.warning = answer.warning;
        tracker.last_received_at = SystemClock.now();
        Ok(tracker)
    }

    /// Appends the baud rate to the name of the protocol, for decoders of the recording.
    pub(super) fn append_baud(&mut self, baud: u32) {
        self.report.protocol = format!("{}@{baud}", self.settings.protocol);
    }

    /// Adds a warning to the report.
    pub(super) fn warn(&mut self, warning: String) {
        let before = self.report.warning.take();
        self.report.warning = Some(match before {
            Some(before) => format!("{before}; {warning}"),
            None => warning,
        });
    }

    fn converse(&mut self) -> Result<Answer, DeviceError> {
        let Some(mut dialogue) = Dialogue::new(&self.settings) else {
            return Err(self.unready(format!(
                "{:?} is no tracker protocol",
                self.settings.protocol
            )));
        };
        loop {
            match dialogue.next(SystemClock.now()) {
                Action::Write(bytes) => self.line.write(&bytes)?,
                Action::Read { until, keep } => {
                    let timeout = until.nanos_since(SystemClock.now()).max(0).unsigned_abs();
                    if let Some(read) = self.read(Duration::from_nanos(timeout))? {
                        dialogue.receive(&read.bytes, read.arrived_at);
                        self.pending.extend(keep.then_some(read));
                    }
                }
                Action::Done(answer) => return Ok(answer),
                Action::Failed(Trouble::Silent { millis }) => return Err(self.silent(millis)),
                Action::Failed(Trouble::Foreign { seen }) => return Err(self.unready(seen)),
            }
        }
    }

    fn read(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        let Some((count, arrived_at)) = self.line.read(&mut self.buffer, timeout)? else {
            return Ok(None);
        };
        self.last_received_at = arrived_at;
        self.report.bytes += count as u64;
        Ok(Some(TrackerBytes {
            // A slice would keep the complete buffer in memory while a recorder holds it.
            bytes: Bytes::copy_from_slice(&self.buffer[..count]),
            arrived_at,
        }))
    }

    fn unready(&self, reason: String) -> DeviceError {
        DeviceError::Unready {
            device: self.settings.port.to_string(),
            reason,
        }
    }

    fn silent(&self, millis: u64) -> DeviceError {
        DeviceError::Silent {
            device: self.settings.port.to_string(),
            millis,
        }
    }
}

impl<L: Line> Tracker for LineTracker<L> {
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        if let Some(pending) = self.pending.pop_front() {
            return Ok(Some(pending));
        }
        if let Some(read) = self.read(timeout)? {
            return Ok(Some(read));
        }
        let silent = SystemClock.now().nanos_since(self.last_received_at) / 1_000_000;
        match u64::try_from(silent) {
            Ok(millis) if millis >= self.settings.silence_millis => Err(self.silent(millis)),
            _ => Ok(None),
        }
    }

    fn report(&self) -> TrackerReport {
        self.report.clone()
    }
}

impl<L: Line> Drop for LineTracker<L> {
    /// Stops the stream. The device may be disconnected, so an error is ignored.
    fn drop(&mut self) {
        let stop = stop_command(&self.settings);
        if !stop.is_empty() {
            let _ = self.line.write(&stop);
        }
    }
}
