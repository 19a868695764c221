//! Injects faults into any camera or tracker, for tests of a rig's reaction, e.g. to a pulled
//! cable.
//!
//! A [`Plan`] lists the faults, each after a number of good deliveries. After the last one the
//! device works like the one inside. A [`FaultSwitch`] starts and ends faults of other kinds while
//! the device delivers, and a [`FaultyDisk`] those of the disk that recordings are written to.

mod disk;
mod switch;

pub use disk::{FaultyDisk, FaultyFile};
pub use switch::{FaultSwitch, LastingFault, SwitchedCamera, SwitchedTracker};

use bytes::Bytes;
use penumbra_interface::{
    Camera, CameraReport, DeviceError, Frame, Tracker, TrackerBytes, TrackerReport,
};
use std::collections::VecDeque;
use std::time::Duration;

/// One fault.
#[derive(Clone, Debug)]
pub enum Fault {
    /// One read fails with this error.
    Error(DeviceError),
    /// Nothing comes from a number of reads. What the device inside delivers is lost.
    Silence {
        /// Number of reads.
        readings: u32,
    },
    /// A delivery is cut to a part of its bytes.
    CutShort {
        /// The part that remains, 0..=1.
        share: f64,
    },
    /// Some bytes of a delivery have one bit flipped.
    Flipped {
        /// Distance between two of them, bytes.
        every: usize,
    },
    /// A delivery is lost.
    Lost,
    /// The driver panics.
    Panic,
}

/// Faults in their order, each with the number of good deliveries since the previous one.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    faults: VecDeque<(u64, Fault)>,
    /// Good deliveries since the previous fault.
    good: u64,
    /// Remaining reads of a silence.
    silent: u32,
}

impl Plan {
    /// A plan of these faults, each after this many good deliveries since the previous one.
    pub fn new(faults: impl IntoIterator<Item = (u64, Fault)>) -> Self {
        Self {
            faults: faults.into_iter().collect(),
            ..Self::default()
        }
    }

    /// The fault that is due, if any.
    fn due(&mut self) -> Option<Fault> {
        let (after, _) = self.faults.front()?;
        if self.good < *after {
            return None;
        }
        self.good = 0;
        self.faults.pop_front().map(|(_, fault)| fault)
    }

    /// Reads the device inside and applies the fault that is due.
    fn read<T>(
        &mut self,
        read: impl FnOnce() -> Result<Option<T>, DeviceError>,
        bytes: impl FnOnce(&mut T) -> &mut Bytes,
    ) -> Result<Option<T>, DeviceError> {
        if self.silent > 0 {
            self.silent -= 1;
            return read().map(|_| None);
        }
        match self.due() {
            Some(Fault::Error(error)) => Err(error),
            Some(Fault::Silence { readings }) => {
                self.silent = readings.saturating_sub(1);
                read().map(|_| None)
            }
            Some(Fault::Lost) => read().map(|_| None),
            Some(Fault::CutShort { share }) => read().map(|got| {
                got.map(|mut got| {
                    let data = bytes(&mut got);
                    let left = (data.len() as f64 * share.clamp(0.0, 1.0)) as usize;
                    data.truncate(left);
                    got
                })
            }),
            Some(Fault::Flipped { every }) => read().map(|got| {
                got.map(|mut got| {
                    let data = bytes(&mut got);
                    *data = flipped(data, every.max(1));
                    got
                })
            }),
            Some(Fault::Panic) => panicking(),
            None => read().inspect(|got| self.good += u64::from(got.is_some())),
        }
    }
}

#[expect(clippy::panic, reason = "the fault to be injected")]
fn panicking<T>() -> T {
    panic!("a bug in a driver, on purpose")
}

fn flipped(data: &Bytes, every: usize) -> Bytes {
    let flip = |(i, byte): (usize, &u8)| if i % every == 0 { byte ^ 0x10 } else { *byte };
    data.iter().enumerate().map(flip).collect()
}

/// A camera with injected faults.
pub struct FaultyCamera {
    inner: Box<dyn Camera>,
    plan: Plan,
}

impl FaultyCamera {
    /// Wraps another camera.
    #[must_use]
    pub fn new(inner: Box<dyn Camera>, plan: Plan) -> Self {
        Self { inner, plan }
    }
}

impl Camera for FaultyCamera {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let inner = &mut self.inner;
        self.plan
            .read(|| inner.next_frame(timeout), |frame| &mut frame.data)
    }

    fn report(&self) -> CameraReport {
        self.inner.report()
    }
}

/// A tracker with injected faults.
pub struct FaultyTracker {
    inner: Box<dyn Tracker>,
    plan: Plan,
}

impl FaultyTracker {
    /// Wraps another tracker.
    #[must_use]
    pub fn new(inner: Box<dyn Tracker>, plan: Plan) -> Self {
        Self { inner, plan }
    }
}

impl Tracker for FaultyTracker {
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        let inner = &mut self.inner;
        self.plan
            .read(|| inner.next_bytes(timeout), |got| &mut got.bytes)
    }

    fn report(&self) -> TrackerReport {
        self.inner.report()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_interface::MonotonicTime;

    /// Delivers `abcd` in every read.
    struct Good;

    impl Tracker for Good {
        fn next_bytes(&mut self, _: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
            Ok(Some(TrackerBytes {
                bytes: Bytes::from_static(b"abcd"),
                arrived_at: MonotonicTime::default(),
            }))
        }

        fn report(&self) -> TrackerReport {
            TrackerReport::default()
        }
    }

    fn deliveries(plan: Plan, reads: usize) -> Vec<String> {
        let mut tracker = FaultyTracker::new(Box::new(Good), plan);
        let show = |got: Result<Option<TrackerBytes>, DeviceError>| match got {
            Ok(Some(got)) => String::from_utf8_lossy(&got.bytes).into_owned(),
            Ok(None) => "-".to_owned(),
            Err(_) => "!".to_owned(),
        };
        (0..reads)
            .map(|_| show(tracker.next_bytes(Duration::ZERO)))
            .collect()
    }

    #[test]
    fn faults_come_as_planned() {
        let unplugged = DeviceError::Unplugged {
            device: "t".to_owned(),
        };
        let plan = Plan::new([
            (1, Fault::Error(unplugged)),
            (1, Fault::Silence { readings: 2 }),
            (0, Fault::CutShort { share: 0.5 }),
            (0, Fault::Flipped { every: 3 }),
            (1, Fault::Lost),
        ]);
        let expected = [
            "abcd", "!", "abcd", "-", "-", "ab", "qbct", "abcd", "-", "abcd",
        ];
        assert_eq!(deliveries(plan, 10), expected);
    }

    #[test]
    #[should_panic(expected = "on purpose")]
    fn a_planned_panic_panics() {
        deliveries(Plan::new([(0, Fault::Panic)]), 1);
    }
}
