//! Wraps any camera or tracker and makes it misbehave on purpose, for tests and for trying
//! out what a rig does when a cable is pulled.
//!
//! Faults come by a [`Plan`]: each after so many good deliveries. With the plan at its end
//! the device is as good as the one inside.

use bytes::Bytes;
use penumbra_interface::{
    Camera, CameraReport, DeviceError, Frame, Tracker, TrackerBytes, TrackerReport,
};
use std::collections::VecDeque;
use std::time::Duration;

/// One misbehaviour.
#[derive(Clone, Debug)]
pub enum Fault {
    /// The device says this, once.
    Error(DeviceError),
    /// Nothing comes, so many times. What the device inside delivers then is lost.
    Silence {
        /// Readings in vain.
        readings: u32,
    },
    /// A delivery is cut to this share of its bytes, 0..=1.
    CutShort {
        /// What is left.
        share: f64,
    },
    /// Every so many-th byte of a delivery has a bit flipped.
    Flipped {
        /// Distance between two of them.
        every: usize,
    },
    /// A delivery that never comes.
    Lost,
    /// The driver has a bug.
    Panic,
}

/// What goes wrong when: after so many good deliveries since the fault before.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    faults: VecDeque<(u64, Fault)>,
    good: u64,
    silent: u32,
}

impl Plan {
    /// Faults in order, each after so many good deliveries since the one before.
    pub fn new(faults: impl IntoIterator<Item = (u64, Fault)>) -> Self {
        Self {
            faults: faults.into_iter().collect(),
            ..Self::default()
        }
    }

    /// The fault that is due.
    fn due(&mut self) -> Option<Fault> {
        let (after, _) = self.faults.front()?;
        if self.good < *after {
            return None;
        }
        self.good = 0;
        self.faults.pop_front().map(|(_, fault)| fault)
    }

    /// Passes a reading of the device inside on, or does not.
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
            Some(Fault::Panic) => bug(),
            None => read().inspect(|got| self.good += u64::from(got.is_some())),
        }
    }
}

#[expect(clippy::panic, reason = "what it is for")]
fn bug<T>() -> T {
    panic!("a bug in a driver, on purpose")
}

fn flipped(data: &Bytes, every: usize) -> Bytes {
    let flip = |(i, byte): (usize, &u8)| if i % every == 0 { byte ^ 0x10 } else { *byte };
    data.iter().enumerate().map(flip).collect()
}

/// A camera that misbehaves.
pub struct FaultyCamera {
    inner: Box<dyn Camera>,
    plan: Plan,
}

impl FaultyCamera {
    /// Around another camera.
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

/// A tracker that misbehaves.
pub struct FaultyTracker {
    inner: Box<dyn Tracker>,
    plan: Plan,
}

impl FaultyTracker {
    /// Around another tracker.
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

    /// Delivers `abcd` for ever.
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

    fn told(plan: Plan, readings: usize) -> Vec<String> {
        let mut tracker = FaultyTracker::new(Box::new(Good), plan);
        let tell = |got: Result<Option<TrackerBytes>, DeviceError>| match got {
            Ok(Some(got)) => String::from_utf8_lossy(&got.bytes).into_owned(),
            Ok(None) => "-".to_owned(),
            Err(_) => "!".to_owned(),
        };
        (0..readings)
            .map(|_| tell(tracker.next_bytes(Duration::ZERO)))
            .collect()
    }

    #[test]
    fn faults_come_when_planned_and_then_no_more() {
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
        assert_eq!(told(plan, 10), expected);
    }

    #[test]
    #[should_panic(expected = "on purpose")]
    fn a_bug_is_a_bug() {
        told(Plan::new([(0, Fault::Panic)]), 1);
    }
}
