//! Keeps one device open and passes on its deliveries.

use crate::backoff::Backoff;
use crate::device::{Device, DeviceReport};
use crate::monitor::DeviceMonitor;
use crate::time::StoppableClock;
use penumbra_interface::{DeviceError, MonotonicTime, Recovery};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// Receives the deliveries of a device. Neither call may block.
pub trait Sink<T> {
    /// Receives the driver's report, after opening and then every [`REPORT_INTERVAL`].
    fn report(&mut self, report: &DeviceReport);
    /// Receives a delivery.
    fn deliver(&mut self, item: T);
}

/// Time limits of a supervisor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Timeout of one read; a request to stop is noticed after at most this time.
    pub poll: Duration,
    /// After this time without a delivery the device counts as silent.
    pub silent_after: Duration,
    /// After this time without a delivery the device is closed and opened again.
    pub reopen_after: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            poll: Duration::from_millis(100),
            silent_after: Duration::from_millis(500),
            reopen_after: Duration::from_secs(3),
        }
    }
}

/// Consecutive damaged deliveries after which the device is opened again.
const MAX_CONSECUTIVE_DAMAGED: u32 = 100;
/// Consecutive damaged deliveries after which there is a pause before each read.
const MAX_DAMAGED_WITHOUT_PAUSE: u32 = 3;
/// Pause before the next read after damaged data, or if a driver returns at once without data.
const PAUSE: Duration = Duration::from_millis(5);
/// After this time of deliveries the back-off starts again at its shortest wait.
const BACKOFF_RESET_AFTER: Duration = Duration::from_secs(1);
/// Interval between two reports of a driver.
pub const REPORT_INTERVAL: Duration = Duration::from_millis(250);

/// Keeps one device open.
#[derive(Clone, Copy)]
pub struct Supervisor<'a> {
    /// The device's name, for messages.
    pub name: &'a str,
    /// The destination of its status.
    pub monitor: &'a DeviceMonitor,
    /// The clock that also ends the loop.
    pub clock: &'a dyn StoppableClock,
    /// Time limits.
    pub limits: Limits,
}

impl Supervisor<'_> {
    /// Opens the device, passes its deliveries to `sink` and opens it again after an error,
    /// until the clock is stopped.
    pub fn run<D: Device>(
        &self,
        open: &mut dyn FnMut() -> Result<D, DeviceError>,
        sink: &mut dyn Sink<D::Item>,
    ) {
        let mut backoff = Backoff::default();
        while !self.clock.is_stopping() {
            self.monitor.opening();
            let opened = guard(self.name, &mut *open);
            let was_open = opened.is_ok();
            let error = match opened {
                Ok(device) => {
                    let (first_at, error) = Stream::new(*self, device).run(sink);
                    if first_at.is_some_and(|at| self.clock.now() >= at + BACKOFF_RESET_AFTER) {
                        backoff.reset();
                    }
                    error
                }
                Err(error) => Some(error),
            };
            let Some(error) = error else { break };
            let wait = backoff.next_wait(error.recovery());
            let until = self.clock.now() + wait;
            if self.monitor.failed(&error, was_open, until) {
                tracing::warn!(device = self.name, "{error}");
            }
            self.clock.pause(wait);
        }
        self.monitor.closed();
    }
}

/// A device that is open.
struct Stream<'a, D> {
    supervisor: Supervisor<'a>,
    device: D,
    first_at: Option<MonotonicTime>,
    last_at: MonotonicTime,
    reported_at: MonotonicTime,
    consecutive_damaged: u32,
}

impl<'a, D: Device> Stream<'a, D> {
    fn new(supervisor: Supervisor<'a>, device: D) -> Self {
        let now = supervisor.clock.now();
        Self {
            supervisor,
            device,
            first_at: None,
            last_at: now,
            reported_at: now,
            consecutive_damaged: 0,
        }
    }

    /// Streams until an error or until the clock is stopped. Returns when the first item
    /// arrived, and the error.
    fn run(mut self, sink: &mut dyn Sink<D::Item>) -> (Option<MonotonicTime>, Option<DeviceError>) {
        let report = self.device.report();
        sink.report(&report);
        self.supervisor.monitor.opened(report);
        while !self.supervisor.clock.is_stopping() {
            if let Err(error) = self.step(sink) {
                return (self.first_at, Some(error));
            }
        }
        (self.first_at, None)
    }

    /// Reads once.
    fn step(&mut self, sink: &mut dyn Sink<D::Item>) -> Result<(), DeviceError> {
        let Supervisor {
            name,
            monitor,
            clock,
            limits,
        } = self.supervisor;
        let asked_at = clock.now();
        let device = &mut self.device;
        let read = guard(name, || device.next(limits.poll));
        let now = clock.now();
        match read {
            Ok(Some(item)) => {
                monitor.received(D::bytes(&item), now);
                sink.deliver(item);
                self.consecutive_damaged = 0;
                self.last_at = now;
                self.first_at.get_or_insert(now);
            }
            Ok(None) => self.check_silence(asked_at, now)?,
            Err(error) if error.recovery() == Recovery::Retry => self.count_damaged(error)?,
            Err(error) => return Err(error),
        }
        if now.nanos_since(self.reported_at) >= REPORT_INTERVAL.as_nanos() as i64 {
            self.reported_at = now;
            let report = self.device.report();
            sink.report(&report);
            monitor.reported(report);
        }
        Ok(())
    }

    /// Fails once the device has been silent for too long.
    fn check_silence(
        &self,
        asked_at: MonotonicTime,
        now: MonotonicTime,
    ) -> Result<(), DeviceError> {
        let Supervisor {
            name,
            monitor,
            clock,
            limits,
        } = self.supervisor;
        // A driver that does not wait for the timeout must not keep the loop spinning.
        if now < asked_at + PAUSE.min(limits.poll) {
            clock.pause(PAUSE);
        }
        if now < self.last_at + limits.silent_after {
            return Ok(());
        }
        let silent = DeviceError::Silent {
            device: name.to_owned(),
            millis: now.nanos_since(self.last_at).unsigned_abs() / 1_000_000,
        };
        if now >= self.last_at + limits.reopen_after {
            return Err(silent);
        }
        monitor.silent(&silent);
        Ok(())
    }

    /// Tolerates single damaged deliveries and fails after many in a row.
    fn count_damaged(&mut self, error: DeviceError) -> Result<(), DeviceError> {
        self.supervisor.monitor.damaged(&error);
        self.consecutive_damaged += 1;
        if self.consecutive_damaged > MAX_CONSECUTIVE_DAMAGED {
            return Err(error);
        }
        if self.consecutive_damaged > MAX_DAMAGED_WITHOUT_PAUSE {
            self.supervisor.clock.pause(PAUSE);
        }
        Ok(())
    }
}

/// Calls a driver and converts a panic into an error, which closes the driver's device instead of
/// ending the rig.
fn guard<T>(name: &str, call: impl FnOnce() -> Result<T, DeviceError>) -> Result<T, DeviceError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| {
        tracing::error!(device = name, "the driver has panicked");
        Err(DeviceError::Refused {
            device: name.to_owned(),
            reason: "its driver has a bug and has panicked; please report it".to_owned(),
        })
    })
}
