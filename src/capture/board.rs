//! What is known of a device, for whoever asks.

use super::Account;
use penumbra_interface::{DeviceError, MonotonicTime, Recovery};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What a supervised device is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceState {
    /// It is being opened and configured.
    #[default]
    Opening,
    /// It delivers.
    Streaming,
    /// It is open, but nothing comes.
    Silent,
    /// It is closed after trouble, to be opened again then.
    BackingOff {
        /// When.
        until: MonotonicTime,
    },
    /// It cannot be used until somebody sees to it; whether they have is tried then.
    Failed {
        /// When.
        until: MonotonicTime,
    },
    /// It was closed in order: the program ends.
    Closed,
}

/// Everything that is known of a device.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Condition {
    /// What it is doing.
    pub state: DeviceState,
    /// What is wrong, while something is.
    pub reason: Option<String>,
    /// What went wrong last, even if all is well again.
    pub last_trouble: Option<String>,
    /// Times that it was tried to open it.
    pub attempts: u64,
    /// Times that it was lost after it had been open.
    pub losses: u64,
    /// Deliveries.
    pub received: u64,
    /// Bytes of them.
    pub bytes: u64,
    /// Deliveries that the driver called damaged.
    pub damaged: u64,
    /// When the newest came.
    pub last_at: Option<MonotonicTime>,
    /// What the device says of itself.
    pub account: Account,
}

/// Where a supervisor writes and the status reads. Every call is short.
#[derive(Debug, Default)]
pub struct Board(Mutex<Condition>);

impl Board {
    /// A copy of all that is known.
    #[must_use]
    pub fn condition(&self) -> Condition {
        self.lock().clone()
    }

    /// What the device is doing.
    #[must_use]
    pub fn state(&self) -> DeviceState {
        self.lock().state
    }

    pub(super) fn opening(&self) {
        let mut condition = self.lock();
        condition.attempts += 1;
        // While it is tried in vain again and again, the reason says more.
        if condition.reason.is_none() {
            condition.state = DeviceState::Opening;
        }
    }

    pub(super) fn opened(&self, account: Account) {
        let mut condition = self.lock();
        condition.state = DeviceState::Opening;
        condition.reason = None;
        condition.account = account;
    }

    pub(super) fn received(&self, bytes: usize, now: MonotonicTime) {
        let mut condition = self.lock();
        condition.state = DeviceState::Streaming;
        condition.received += 1;
        condition.bytes += bytes as u64;
        condition.last_at = Some(now);
        condition.reason = None;
    }

    pub(super) fn account(&self, account: Account) {
        self.lock().account = account;
    }

    pub(super) fn damaged(&self, error: &DeviceError) {
        let mut condition = self.lock();
        condition.damaged += 1;
        condition.last_trouble = Some(error.to_string());
    }

    pub(super) fn silent(&self, error: &DeviceError) {
        let mut condition = self.lock();
        condition.state = DeviceState::Silent;
        condition.reason = Some(error.to_string());
    }

    /// True if this trouble is a new one, worth a line in the log.
    pub(super) fn trouble(
        &self,
        error: &DeviceError,
        was_open: bool,
        until: MonotonicTime,
    ) -> bool {
        let mut condition = self.lock();
        condition.losses += u64::from(was_open);
        condition.state = match error.recovery() {
            Recovery::Fatal => DeviceState::Failed { until },
            Recovery::Retry | Recovery::Reopen => DeviceState::BackingOff { until },
        };
        let text = error.to_string();
        let new = was_open || condition.reason.as_ref() != Some(&text);
        condition.last_trouble = Some(text.clone());
        condition.reason = Some(text);
        new
    }

    pub(super) fn closed(&self) {
        self.lock().state = DeviceState::Closed;
    }

    /// A panic elsewhere must not take the status away, so a poisoned lock is used on.
    fn lock(&self) -> MutexGuard<'_, Condition> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
