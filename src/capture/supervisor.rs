//! The loop around one device.

use super::backoff::Backoff;
use super::{Board, Timekeeper};
use penumbra_interface::{
    Camera, CameraReport, DeviceError, Frame, MonotonicTime, Recovery, Tracker, TrackerBytes,
    TrackerReport,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

/// A camera or a tracker, as its supervisor sees it.
pub trait Device {
    /// What it delivers.
    type Item;

    /// Waits up to `timeout` for the next item.
    ///
    /// # Errors
    /// [`DeviceError::recovery`] says what to do.
    fn next(&mut self, timeout: Duration) -> Result<Option<Self::Item>, DeviceError>;

    /// What it says of itself.
    fn account(&self) -> Account;

    /// Bytes of an item.
    fn bytes(item: &Self::Item) -> usize;
}

/// What a device says of itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Account {
    /// It has not been open yet.
    #[default]
    None,
    /// A camera.
    Camera(CameraReport),
    /// A tracker.
    Tracker(TrackerReport),
}

impl Device for Box<dyn Camera> {
    type Item = Frame;

    fn next(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        self.next_frame(timeout)
    }

    fn account(&self) -> Account {
        Account::Camera(self.report())
    }

    fn bytes(frame: &Frame) -> usize {
        frame.data.len()
    }
}

impl Device for Box<dyn Tracker> {
    type Item = TrackerBytes;

    fn next(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        self.next_bytes(timeout)
    }

    fn account(&self) -> Account {
        Account::Tracker(self.report())
    }

    fn bytes(item: &TrackerBytes) -> usize {
        item.bytes.len()
    }
}

/// Who takes what a device delivers. Neither call may block.
pub trait Sink<T> {
    /// The device says this of itself, after it was opened and now and then.
    fn account(&mut self, account: &Account);
    /// It has delivered.
    fn deliver(&mut self, item: T);
}

/// How patient a supervisor is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// A device is asked so long at a time; a wish to stop goes unheard no longer.
    pub poll: Duration,
    /// Nothing for so long is told in the status.
    pub silent_after: Duration,
    /// Nothing for so long, and the device is closed and opened anew.
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

/// Damaged deliveries in a row after which the device is opened anew.
const MOST_DAMAGED: u32 = 100;
/// After this many in a row there is a pause before each further reading.
const DAMAGED_AT_FULL_SPEED: u32 = 3;
/// Where a driver comes back at once with nothing, it is asked at this pace.
const BREATH: Duration = Duration::from_millis(5);
/// Having delivered for so long, a device's next trouble is a new one.
const GOOD_TIMES: Duration = Duration::from_secs(1);
/// How often a device is asked for its account.
const ACCOUNT_EVERY: Duration = Duration::from_millis(250);

/// Opens a device, takes what it delivers, and opens it again after trouble, until `time`
/// is to stop. `name` is for messages.
pub fn supervise<D: Device>(
    name: &str,
    open: &mut dyn FnMut() -> Result<D, DeviceError>,
    sink: &mut dyn Sink<D::Item>,
    (board, time, limits): (&Board, &dyn Timekeeper, Limits),
) {
    let mut backoff = Backoff::default();
    while !time.stopping() {
        board.opening();
        let opened = guarded(name, &mut *open);
        let was_open = opened.is_ok();
        let trouble = match opened {
            Ok(device) => {
                let (begun, error) = Streaming::of(name, device, (board, time, limits)).run(sink);
                if begun.is_some_and(|at| time.now() >= at + GOOD_TIMES) {
                    backoff.forget();
                }
                error
            }
            Err(error) => Some(error),
        };
        let Some(error) = trouble else { break };
        let wait = backoff.after(error.recovery());
        if board.trouble(&error, was_open, time.now() + wait) {
            tracing::warn!(device = name, "{error}");
        }
        time.pause(wait);
    }
    board.closed();
}

/// A device that is open.
struct Streaming<'a, D> {
    name: &'a str,
    device: D,
    board: &'a Board,
    time: &'a dyn Timekeeper,
    limits: Limits,
    first_at: Option<MonotonicTime>,
    last_at: MonotonicTime,
    accounted_at: MonotonicTime,
    damaged: u32,
}

impl<'a, D: Device> Streaming<'a, D> {
    fn of(
        name: &'a str,
        device: D,
        (board, time, limits): (&'a Board, &'a dyn Timekeeper, Limits),
    ) -> Self {
        let now = time.now();
        Self {
            name,
            device,
            board,
            time,
            limits,
            first_at: None,
            last_at: now,
            accounted_at: now,
            damaged: 0,
        }
    }

    /// Until trouble, or `None` at the wish to stop; and when the first item came.
    fn run(mut self, sink: &mut dyn Sink<D::Item>) -> (Option<MonotonicTime>, Option<DeviceError>) {
        let account = self.device.account();
        sink.account(&account);
        self.board.opened(account);
        while !self.time.stopping() {
            if let Err(error) = self.step(sink) {
                return (self.first_at, Some(error));
            }
        }
        (self.first_at, None)
    }

    fn step(&mut self, sink: &mut dyn Sink<D::Item>) -> Result<(), DeviceError> {
        let asked_at = self.time.now();
        let (device, poll) = (&mut self.device, self.limits.poll);
        let got = guarded(self.name, || device.next(poll));
        let now = self.time.now();
        match got {
            Ok(Some(item)) => {
                self.board.received(D::bytes(&item), now);
                sink.deliver(item);
                self.damaged = 0;
                self.last_at = now;
                self.first_at.get_or_insert(now);
            }
            Ok(None) => self.nothing(asked_at, now)?,
            Err(error) if error.recovery() == Recovery::Retry => self.bad(error)?,
            Err(error) => return Err(error),
        }
        if now.nanos_since(self.accounted_at) >= ACCOUNT_EVERY.as_nanos() as i64 {
            self.accounted_at = now;
            let account = self.device.account();
            sink.account(&account);
            self.board.account(account);
        }
        Ok(())
    }

    fn nothing(&self, asked_at: MonotonicTime, now: MonotonicTime) -> Result<(), DeviceError> {
        if now < asked_at + BREATH.min(self.limits.poll) {
            self.time.pause(BREATH);
        }
        if now < self.last_at + self.limits.silent_after {
            return Ok(());
        }
        let silent = DeviceError::Silent {
            device: self.name.to_owned(),
            millis: now.nanos_since(self.last_at).unsigned_abs() / 1_000_000,
        };
        if now >= self.last_at + self.limits.reopen_after {
            return Err(silent);
        }
        self.board.silent(&silent);
        Ok(())
    }

    /// One damaged delivery is nothing; many in a row are a device in trouble.
    fn bad(&mut self, error: DeviceError) -> Result<(), DeviceError> {
        self.board.damaged(&error);
        self.damaged += 1;
        if self.damaged > MOST_DAMAGED {
            return Err(error);
        }
        if self.damaged > DAMAGED_AT_FULL_SPEED {
            self.time.pause(BREATH);
        }
        Ok(())
    }
}

/// A bug in a driver costs its device, not the rig.
fn guarded<T>(name: &str, call: impl FnOnce() -> Result<T, DeviceError>) -> Result<T, DeviceError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| {
        tracing::error!(device = name, "the driver has panicked");
        Err(DeviceError::Refused {
            device: name.to_owned(),
            reason: "its driver has a bug and has panicked; please report it".to_owned(),
        })
    })
}
