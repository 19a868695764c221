//! The status of one device, shared between its supervisor and the readers of the status.

use crate::device::DeviceReport;
use crate::irregular::{IrregularCounts, Irregularity};
use penumbra_interface::{DeviceError, MonotonicTime, Recovery};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// State of a supervised device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceState {
    /// The device is being opened and configured.
    #[default]
    Opening,
    /// The device delivers.
    Streaming,
    /// The device is open but has delivered nothing for [`Limits::silent_after`](crate::Limits).
    Silent,
    /// The device was closed after an error and will be opened again.
    BackingOff {
        /// When it will be opened again.
        until: MonotonicTime,
    },
    /// The device failed with an error that only the user can correct.
    Failed {
        /// When the supervisor tries again.
        until: MonotonicTime,
    },
    /// The device was closed because the program ends.
    Closed,
}

/// Status of a supervised device.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceStatus {
    /// Its state.
    pub state: DeviceState,
    /// The present error; `None` while the device works.
    pub reason: Option<String>,
    /// The most recent error, even if the device works again.
    pub last_trouble: Option<String>,
    /// Number of attempts to open the device.
    pub attempts: u64,
    /// Number of times the device was lost after it had been open.
    pub losses: u64,
    /// Number of deliveries.
    pub received: u64,
    /// Total size of the deliveries, bytes.
    pub bytes: u64,
    /// Number of deliveries that the driver reported as damaged.
    pub damaged: u64,
    /// Numbers of irregular deliveries.
    pub irregular: IrregularCounts,
    /// When the most recent delivery arrived.
    pub last_at: Option<MonotonicTime>,
    /// The driver's report about the device.
    pub report: DeviceReport,
}

/// A device's status: the supervisor writes, the status page reads. Every call holds the lock
/// only for a moment.
#[derive(Debug, Default)]
pub struct DeviceMonitor(Mutex<DeviceStatus>);

impl DeviceMonitor {
    /// Returns a copy of the status.
    #[must_use]
    pub fn status(&self) -> DeviceStatus {
        self.lock().clone()
    }

    pub(crate) fn opening(&self) {
        let mut status = self.lock();
        status.attempts += 1;
        // During repeated attempts the state and reason of the last failure say more.
        if status.reason.is_none() {
            status.state = DeviceState::Opening;
        }
    }

    pub(crate) fn opened(&self, report: DeviceReport) {
        let mut status = self.lock();
        status.state = DeviceState::Opening;
        status.reason = None;
        status.report = report;
    }

    pub(crate) fn received(&self, bytes: usize, now: MonotonicTime) {
        let mut status = self.lock();
        status.state = DeviceState::Streaming;
        status.received += 1;
        status.bytes += bytes as u64;
        status.last_at = Some(now);
        status.reason = None;
    }

    pub(crate) fn reported(&self, report: DeviceReport) {
        self.lock().report = report;
    }

    pub(crate) fn damaged(&self, error: &DeviceError) {
        let mut status = self.lock();
        status.damaged += 1;
        status.last_trouble = Some(error.to_string());
    }

    /// Counts an irregular delivery; `detail` says more than its kind.
    pub(crate) fn irregular(&self, kind: Irregularity, name: &str, detail: Option<&str>) {
        let mut status = self.lock();
        status.irregular.add(kind);
        let what = detail.unwrap_or_else(|| kind.description());
        status.last_trouble = Some(format!("{name}: {what}"));
    }

    pub(crate) fn silent(&self, error: &DeviceError) {
        let mut status = self.lock();
        status.state = DeviceState::Silent;
        status.reason = Some(error.to_string());
    }

    /// Enters the state after an error, until the device is opened again at `until`. Returns
    /// whether the error is a new one, to be logged.
    pub(crate) fn failed(&self, error: &DeviceError, was_open: bool, until: MonotonicTime) -> bool {
        let mut status = self.lock();
        status.losses += u64::from(was_open);
        status.state = match error.recovery() {
            Recovery::Fatal => DeviceState::Failed { until },
            Recovery::Retry | Recovery::Reopen => DeviceState::BackingOff { until },
        };
        let text = error.to_string();
        let is_new = was_open || status.reason.as_ref() != Some(&text);
        status.last_trouble = Some(text.clone());
        status.reason = Some(text);
        is_new
    }

    pub(crate) fn closed(&self) {
        self.lock().state = DeviceState::Closed;
    }

    /// A panic of another thread must not disable the status, so a poisoned lock is accepted.
    fn lock(&self) -> MutexGuard<'_, DeviceStatus> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
