//! How long to wait before a device is opened again.

use penumbra_interface::Recovery;
use std::time::Duration;

/// After the first trouble; doubled with each that follows.
const FIRST: Duration = Duration::from_millis(100);
/// A device that is back is to deliver within two seconds, of which opening takes its part.
const LONGEST: Duration = Duration::from_secs(1);
/// Where only the user can help. They will have helped at some time, and then do not want
/// to restart the program; asking costs the device and its neighbours little at this pace.
const AFTER_REFUSAL: Duration = Duration::from_secs(3);

/// Waits that grow while trouble follows trouble.
#[derive(Clone, Copy, Debug, Default)]
pub struct Backoff {
    in_a_row: u32,
}

impl Backoff {
    /// The wait after trouble of this kind.
    pub fn after(&mut self, recovery: Recovery) -> Duration {
        let doublings = self.in_a_row.min(8);
        self.in_a_row = self.in_a_row.saturating_add(1);
        match recovery {
            Recovery::Fatal => AFTER_REFUSAL,
            Recovery::Retry | Recovery::Reopen => (FIRST * (1 << doublings)).min(LONGEST),
        }
    }

    /// The device has delivered for a while: the next trouble is a new one.
    pub const fn forget(&mut self) {
        self.in_a_row = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_to_less_than_two_seconds_and_begin_anew_after_good_times() {
        let mut backoff = Backoff::default();
        let millis = |b: &mut Backoff| b.after(Recovery::Reopen).as_millis();
        let waits: Vec<_> = (0..6).map(|_| millis(&mut backoff)).collect();
        assert_eq!(waits, [100, 200, 400, 800, 1000, 1000]);
        (0..100).for_each(|_| assert!(millis(&mut backoff) == 1000));
        assert_eq!(backoff.after(Recovery::Fatal), AFTER_REFUSAL);
        backoff.forget();
        assert_eq!(millis(&mut backoff), 100);
    }
}
