//! Time that can be let pass, and that ends.

use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// The time, and a way to wait that the end of the program cuts short.
pub trait Timekeeper: Clock {
    /// Waits; false if everything is to end.
    fn pause(&self, time: Duration) -> bool;

    /// Whether everything is to end.
    fn stopping(&self) -> bool;
}

/// The system's time.
#[derive(Debug, Default)]
pub struct LiveTime {
    stopping: Mutex<bool>,
    woken: Condvar,
}

impl LiveTime {
    /// Ends every pause, now and later.
    pub fn stop(&self) {
        *self.stopping.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.woken.notify_all();
    }
}

impl Clock for LiveTime {
    fn now(&self) -> MonotonicTime {
        SystemClock.now()
    }
}

impl Timekeeper for LiveTime {
    fn pause(&self, time: Duration) -> bool {
        let stopping = self.stopping.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.woken.wait_timeout_while(stopping, time, |stop| !*stop);
        !*waited.unwrap_or_else(PoisonError::into_inner).0
    }

    fn stopping(&self) -> bool {
        *self.stopping.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
