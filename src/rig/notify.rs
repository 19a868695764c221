//! Tells the service manager how it goes, where there is one (`NOTIFY_SOCKET`).
//!
//! The watchdog is fed from the frame loop itself: a loop that hangs stops feeding it, and
//! is restarted.

use std::time::{Duration, Instant};

/// How often the line in `systemctl status` is renewed.
const SENTENCE_EVERY: Duration = Duration::from_secs(2);

/// What was told when.
pub(super) struct Notifier {
    feed_every: Option<Duration>,
    fed: Option<Instant>,
    told: Option<Instant>,
    ready: bool,
}

impl Notifier {
    /// By the environment.
    pub fn new() -> Self {
        Self {
            // Three times before its patience ends.
            feed_every: system::watchdog().map(|patience| patience / 3),
            fed: None,
            told: None,
            ready: false,
        }
    }

    /// One turn of the loop: the first is what a start waits for. `sentence` is what
    /// `systemctl status` shows.
    pub fn turn(&mut self, sentence: impl FnOnce() -> String) {
        if !self.ready {
            self.ready = true;
            system::ready();
        }
        let due = |last: Option<Instant>, every| last.is_none_or(|at| at.elapsed() >= every);
        if self.feed_every.is_some_and(|every| due(self.fed, every)) {
            self.fed = Some(Instant::now());
            system::feed();
        }
        if system::listens() && due(self.told, SENTENCE_EVERY) {
            self.told = Some(Instant::now());
            system::say(&sentence());
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

    pub fn listens() -> bool {
        std::env::var_os("NOTIFY_SOCKET").is_some()
    }

    pub fn watchdog() -> Option<Duration> {
        sd_notify::watchdog_enabled()
    }

    pub fn ready() {
        tell(NotifyState::Ready);
    }

    pub fn feed() {
        tell(NotifyState::Watchdog);
    }

    pub fn say(sentence: &str) {
        tell(NotifyState::Status(sentence));
    }

    pub fn stopping() {
        tell(NotifyState::Stopping);
    }

    /// A manager that does not listen is no reason to stop.
    fn tell(state: NotifyState<'_>) {
        if let Err(error) = notify(&[state]) {
            tracing::debug!(%error, "the service manager does not listen");
        }
    }
}

#[cfg(not(unix))]
mod system {
    use std::time::Duration;

    pub const fn listens() -> bool {
        false
    }

    pub const fn watchdog() -> Option<Duration> {
        None
    }

    pub const fn ready() {}

    pub const fn feed() {}

    pub const fn say(_: &str) {}

    pub const fn stopping() {}
}
