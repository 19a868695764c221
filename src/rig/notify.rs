//! Reports readiness, status and watchdog signals to the service manager, if there is one
//! (`NOTIFY_SOCKET`).
//!
//! The frame loop itself feeds the watchdog, so that a loop that hangs is restarted.

use std::time::{Duration, Instant};

/// Interval at which the line in `systemctl status` is updated.
const STATUS_EVERY: Duration = Duration::from_secs(2);

/// Sends notifications and remembers when they were sent.
pub(super) struct Notifier {
    feed_every: Option<Duration>,
    fed: Option<Instant>,
    described: Option<Instant>,
    ready: bool,
}

impl Notifier {
    /// Creates a notifier, configured by the environment variables of the service manager.
    pub fn new() -> Self {
        Self {
            // Three times per watchdog timeout.
            feed_every: system::watchdog().map(|timeout| timeout / 3),
            fed: None,
            described: None,
            ready: false,
        }
    }

    /// Notifies the manager of an iteration of the frame loop; the first one reports readiness.
    /// `status_line` is the line in `systemctl status`.
    pub fn turn(&mut self, status_line: impl FnOnce() -> String) {
        if !self.ready {
            self.ready = true;
            system::ready();
        }
        let due = |last: Option<Instant>, every| last.is_none_or(|at| at.elapsed() >= every);
        if self.feed_every.is_some_and(|every| due(self.fed, every)) {
            self.fed = Some(Instant::now());
            system::feed();
        }
        if system::has_manager() && due(self.described, STATUS_EVERY) {
            self.described = Some(Instant::now());
            system::describe(&status_line());
        }
    }
}

impl Drop for Notifier {
    fn drop(&mut self) {
        system::stopping();
    }
}

#[cfg(unix)]
mod system {
    use sd_notify::{NotifyState, notify};
    use std::time::Duration;

    pub fn has_manager() -> bool {
        std::env::var_os("NOTIFY_SOCKET").is_some()
    }

    pub fn watchdog() -> Option<Duration> {
        sd_notify::watchdog_enabled()
    }

    pub fn ready() {
        send(NotifyState::Ready);
    }

    pub fn feed() {
        send(NotifyState::Watchdog);
    }

    pub fn describe(status_line: &str) {
        send(NotifyState::Status(status_line));
    }

    pub fn stopping() {
        send(NotifyState::Stopping);
    }

    /// Sends a notification; a failure is only logged.
    fn send(state: NotifyState<'_>) {
        if let Err(error) = notify(&[state]) {
            tracing::debug!(%error, "notifying the service manager failed");
        }
    }
}

#[cfg(not(unix))]
mod system {
    use std::time::Duration;

    pub const fn has_manager() -> bool {
        false
    }

    pub const fn watchdog() -> Option<Duration> {
        None
    }

    pub const fn ready() {}

    pub const fn feed() {}

    pub const fn describe(_: &str) {}

    pub const fn stopping() {}
}
