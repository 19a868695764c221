//! A clock whose waits end early when the program stops.

use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A clock with a wait that the end of the program interrupts. Tests replace it by simulated
/// time.
pub trait StoppableClock: Clock {
    /// Waits for `time`; returns false if the program is stopping.
    fn pause(&self, time: Duration) -> bool;

    /// Returns whether the program is stopping.
    fn is_stopping(&self) -> bool;
}

/// The system's monotonic clock.
#[derive(Debug, Default)]
pub struct StoppableSystemClock {
    stopping: Mutex<bool>,
    stopped: Condvar,
}

impl StoppableSystemClock {
    /// Ends the pauses of all threads, and all later ones at once.
    pub fn stop(&self) {
        *self.stopping.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.stopped.notify_all();
    }
}

impl Clock for StoppableSystemClock {
    fn now(&self) -> MonotonicTime {
        SystemClock.now()
    }
}

impl StoppableClock for StoppableSystemClock {
    fn pause(&self, time: Duration) -> bool {
        let stopping = self.stopping.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self
            .stopped
            .wait_timeout_while(stopping, time, |stop| !*stop);
        !*waited.unwrap_or_else(PoisonError::into_inner).0
    }

    fn is_stopping(&self) -> bool {
        *self.stopping.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
