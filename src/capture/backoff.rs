//! The supervisor's waiting times before it opens a device again.

use penumbra_interface::Recovery;
use std::time::Duration;

/// Wait after the first error; doubled after each consecutive error.
const FIRST_WAIT: Duration = Duration::from_millis(100);
/// Maximum wait. A device that is plugged in again must deliver within two seconds, including the
/// time to open it.
const MAX_WAIT: Duration = Duration::from_secs(1);
/// Wait after an error that only the user can correct. Trying again spares the user a restart
/// of the program; at this interval it costs the device and its neighbours little.
const WAIT_AFTER_FATAL: Duration = Duration::from_secs(3);

/// Waits that grow with consecutive errors.
#[derive(Clone, Copy, Debug, Default)]
pub struct Backoff {
    consecutive_errors: u32,
}

impl Backoff {
    /// Returns the wait after an error of this kind, and counts the error.
    pub fn next_wait(&mut self, recovery: Recovery) -> Duration {
        let doublings = self.consecutive_errors.min(8);
        self.consecutive_errors = self.consecutive_errors.saturating_add(1);
        match recovery {
            Recovery::Fatal => WAIT_AFTER_FATAL,
            Recovery::Retry | Recovery::Reopen => (FIRST_WAIT * (1 << doublings)).min(MAX_WAIT),
        }
    }

    /// Starts again at the shortest wait.
    pub const fn reset(&mut self) {
        self.consecutive_errors = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_one_second_and_start_again_after_a_reset() {
        let mut backoff = Backoff::default();
        let millis = |b: &mut Backoff| b.next_wait(Recovery::Reopen).as_millis();
        let waits: Vec<_> = (0..6).map(|_| millis(&mut backoff)).collect();
        assert_eq!(waits, [100, 200, 400, 800, 1000, 1000]);
        (0..100).for_each(|_| assert!(millis(&mut backoff) == 1000));
        assert_eq!(backoff.next_wait(Recovery::Fatal), WAIT_AFTER_FATAL);
        backoff.reset();
        assert_eq!(millis(&mut backoff), 100);
    }
}
