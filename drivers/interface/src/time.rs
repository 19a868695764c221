//! The common clock of all devices.

use std::ops::{Add, Sub};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

/// A time of `CLOCK_MONOTONIC`, nanoseconds. Recorded sessions hold times of the machine that
/// recorded them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MonotonicTime(i64);

impl MonotonicTime {
    /// The time `nanos` nanoseconds after the clock's zero.
    #[must_use]
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds since the clock's zero.
    #[must_use]
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Nanoseconds from `earlier` to `self`, negative if `self` is earlier. Saturates, because
    /// recorded times may have any value.
    #[must_use]
    pub const fn nanos_since(self, earlier: Self) -> i64 {
        self.0.saturating_sub(earlier.0)
    }

    /// Seconds from `earlier` to `self`, negative if `self` is earlier.
    #[must_use]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.nanos_since(earlier) as f64 * 1e-9
    }

    /// This time shifted by a number of nanoseconds, which may be negative. Saturates.
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

/// A source of the time: the system, or a test.
pub trait Clock: Send + Sync {
    /// The present time.
    fn now(&self) -> MonotonicTime;
}

/// A clock that only changes when it is set or advanced, for tests and simulations. Clones show the
/// same time.
#[derive(Clone, Debug, Default)]
pub struct ManualClock(Arc<AtomicI64>);

impl ManualClock {
    /// Creates a clock that shows `now`.
    #[must_use]
    pub fn new(now: MonotonicTime) -> Self {
        Self(Arc::new(AtomicI64::new(now.as_nanos())))
    }

    /// Sets the time.
    pub fn set(&self, now: MonotonicTime) {
        self.0.store(now.as_nanos(), Ordering::Relaxed);
    }

    /// Advances the time.
    pub fn advance(&self, nanos: i64) {
        self.0.fetch_add(nanos, Ordering::Relaxed);
    }
}

impl Clock for ManualClock {
    fn now(&self) -> MonotonicTime {
        MonotonicTime::from_nanos(self.0.load(Ordering::Relaxed))
    }
}

/// `CLOCK_MONOTONIC`, which the kernel uses to stamp buffers. On Windows, which has none, the
/// time since the first call.
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
