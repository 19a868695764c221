//! One clock for every device.

use std::ops::{Add, Sub};
use std::time::Duration;

/// Nanoseconds of `CLOCK_MONOTONIC`. Recorded sessions keep the instants of the machine
/// that recorded them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MonotonicTime(i64);

impl MonotonicTime {
    /// The instant `nanos` nanoseconds after the clock's zero.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the clock's zero.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Signed nanoseconds from `earlier` to `self`; saturates instead of overflowing,
    /// because recorded time stamps come from outside.
    #[must_use]
    pub const fn nanos_since(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }

    /// Signed seconds from `earlier` to `self`.
    #[must_use]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.nanos_since(earlier) as f64 * 1e-9
    }

    /// This instant shifted by a signed number of nanoseconds, saturating.
    #[must_use]
    pub const fn offset_nanos(self, nanos: i64) -> Self {
        Self(self.0.saturating_add(nanos))
    }
}

impl Add<Duration> for MonotonicTime {
    type Output = Self;
    fn add(self, rhs: Duration) -> Self {
        self.offset_nanos(i64::try_from(rhs.as_nanos()).unwrap_or(i64::MAX))
    }
}

impl Sub<Duration> for MonotonicTime {
    type Output = Self;
    fn sub(self, rhs: Duration) -> Self {
        Self(
            self.0
                .saturating_sub(i64::try_from(rhs.as_nanos()).unwrap_or(i64::MAX)),
        )
    }
}

/// Where the time comes from: the system, or a test.
pub trait Clock: Send + Sync {
    /// The present instant.
    fn now(&self) -> MonotonicTime;
}

/// `CLOCK_MONOTONIC`, as the kernel stamps buffers. Where there is none (Windows), time
/// since the first reading.
#[derive(Clone, Copy, Debug, Default)]
pub struct SystemClock;

impl Clock for SystemClock {
    #[cfg(unix)]
    fn now(&self) -> MonotonicTime {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        let nanos = time.tv_sec.saturating_mul(1_000_000_000);
        MonotonicTime(nanos.saturating_add(time.tv_nsec))
    }

    #[cfg(not(unix))]
    fn now(&self) -> MonotonicTime {
        static STARTED: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
        MonotonicTime::default() + STARTED.get_or_init(std::time::Instant::now).elapsed()
    }
}
