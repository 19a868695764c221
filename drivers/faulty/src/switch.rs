//! Faults that are switched on and off while a device delivers.

use bytes::Bytes;
use penumbra_interface::{
    Camera, CameraReport, ControlReport, ControlStanding, DeviceError, Exposure, Frame,
    MonotonicTime, PixelFormat, Tracker, TrackerBytes, TrackerReport,
};
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// A fault that lasts until it is switched off.
#[derive(Clone, Debug, PartialEq)]
pub enum LastingFault {
    /// The device is gone; it cannot be opened either.
    Unplugged,
    /// The device is open and delivers nothing.
    Silent,
    /// Deliveries are random bytes.
    Garbage,
    /// Deliveries are cut in half.
    Half,
    /// Every tenth delivery is lost on its way.
    Drops,
    /// Every delivery comes twice.
    Duplicates,
    /// Every delivery comes after the one that follows it.
    Reordered,
    /// Every second time stamp is this much too early, nanoseconds.
    TimeBack(i64),
    /// Exposures that are no numbers; numbers of a tracker that are none.
    NotANumber,
    /// Pictures are this JPEG file instead; records of a tracker have ten bytes less.
    OtherSize(Bytes),
    /// Pictures are announced in another format; a tracker speaks another protocol.
    OtherFormat,
    /// Bits of the coded picture are flipped.
    FlippedBits,
    /// One delivery in this time.
    Slow(Duration),
    /// Nothing for this time, then everything at once.
    Burst(Duration),
    /// Another program has changed a control.
    ControlChanged,
    /// The clock of the time stamps is this much ahead, nanoseconds.
    ClockStep(i64),
}

/// Switches the fault of a device. Clones switch the same one.
#[derive(Clone, Debug, Default)]
pub struct FaultSwitch(Arc<Mutex<Option<LastingFault>>>);

impl FaultSwitch {
    /// Sets the fault; `None` switches it off.
    pub fn set(&self, fault: Option<LastingFault>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = fault;
    }

    fn fault(&self) -> Option<LastingFault> {
        let fault = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        fault.clone()
    }

    /// Returns an error if the device is unplugged.
    ///
    /// # Errors
    /// It is.
    pub fn plugged_in(&self, device: &str) -> Result<(), DeviceError> {
        let device = device.to_owned();
        match self.fault() {
            Some(LastingFault::Unplugged) => Err(DeviceError::NotFound { device }),
            _ => Ok(()),
        }
    }
}

/// A delivery with what faults change of it.
trait Faulty: Clone {
    fn bytes(&mut self) -> &mut Bytes;
    fn arrived_at(&self) -> MonotonicTime;
    /// Applies a fault to a single delivery. `number` counts deliveries.
    fn spoil(&mut self, fault: &LastingFault, number: u64);
    /// Changes the arrival.
    fn arrive(&mut self, at: MonotonicTime);
}

impl Faulty for Frame {
    fn bytes(&mut self) -> &mut Bytes {
        &mut self.data
    }

    fn arrived_at(&self) -> MonotonicTime {
        self.arrived_at
    }

    fn spoil(&mut self, fault: &LastingFault, number: u64) {
        match fault {
            LastingFault::TimeBack(nanos) if number.is_multiple_of(2) => {
                self.captured_at = self.captured_at.offset_nanos(-nanos);
            }
            LastingFault::ClockStep(nanos) => {
                self.captured_at = self.captured_at.offset_nanos(*nanos);
            }
            LastingFault::NotANumber if number.is_multiple_of(2) => self.bracket_ev = f64::NAN,
            LastingFault::NotANumber => {
                self.exposure = Some(Exposure {
                    exposure_micros: f64::NAN,
                    gain: f64::NAN,
                });
            }
            LastingFault::OtherSize(jpeg) => self.data = jpeg.clone(),
            LastingFault::OtherFormat => {
                (self.format, self.width, self.height) = (PixelFormat::Yuyv, 640, 480);
            }
            _ => (),
        }
    }

    fn arrive(&mut self, at: MonotonicTime) {
        self.arrived_at = at;
    }
}

impl Faulty for TrackerBytes {
    fn bytes(&mut self) -> &mut Bytes {
        &mut self.bytes
    }

    fn arrived_at(&self) -> MonotonicTime {
        self.arrived_at
    }

    fn spoil(&mut self, fault: &LastingFault, number: u64) {
        match fault {
            LastingFault::TimeBack(nanos) if number.is_multiple_of(2) => {
                self.arrived_at = self.arrived_at.offset_nanos(-nanos);
            }
            LastingFault::ClockStep(nanos) => {
                self.arrived_at = self.arrived_at.offset_nanos(*nanos);
            }
            LastingFault::NotANumber => {
                let text = String::from_utf8_lossy(&self.bytes).replace('.', "NaN");
                self.bytes = text.into();
            }
            LastingFault::OtherSize(_) => {
                self.bytes.truncate(self.bytes.len().saturating_sub(10));
            }
            LastingFault::OtherFormat => {
                self.bytes = Bytes::from_static(b"1,0.1,0.2,0.3,1,0,0,0\n");
            }
            _ => (),
        }
    }

    fn arrive(&mut self, at: MonotonicTime) {
        self.arrived_at = at;
    }
}

/// Deliveries of a device, and those that a fault holds back.
struct Deliveries<T> {
    switch: FaultSwitch,
    name: String,
    waiting: VecDeque<T>,
    held: VecDeque<T>,
    number: u64,
    lost: u64,
}

impl<T: Faulty> Deliveries<T> {
    fn new(name: &str, switch: FaultSwitch) -> Self {
        Self {
            switch,
            name: name.to_owned(),
            waiting: VecDeque::new(),
            held: VecDeque::new(),
            number: 0,
            lost: 0,
        }
    }

    fn next(
        &mut self,
        read: impl FnOnce() -> Result<Option<T>, DeviceError>,
    ) -> Result<Option<T>, DeviceError> {
        let fault = self.switch.fault();
        if fault == Some(LastingFault::Unplugged) {
            let device = self.name.clone();
            return Err(DeviceError::Unplugged { device });
        }
        if let Some(waiting) = self.waiting.pop_front() {
            return Ok(Some(waiting));
        }
        let Some(item) = read()? else {
            return Ok(None);
        };
        self.number += 1;
        match fault {
            Some(fault) => self.inject(&fault, item),
            None => {
                self.release(item.arrived_at());
                self.waiting.push_back(item);
            }
        }
        Ok(self.waiting.pop_front())
    }

    /// Applies a fault; what is to be delivered now is then waiting.
    fn inject(&mut self, fault: &LastingFault, mut item: T) {
        match fault {
            LastingFault::Unplugged | LastingFault::Silent => return,
            LastingFault::Drops if self.number.is_multiple_of(10) => {
                self.lost += 1;
                return;
            }
            LastingFault::Duplicates => self.waiting.push_back(item.clone()),
            LastingFault::Reordered => {
                self.held.push_back(item);
                if self.held.len() == 2 {
                    self.waiting.extend(self.held.drain(..).rev());
                }
                return;
            }
            LastingFault::Slow(time) | LastingFault::Burst(time) => {
                self.hold(item, *time, matches!(fault, LastingFault::Burst(_)));
                return;
            }
            LastingFault::Garbage => {
                let bytes = item.bytes();
                *bytes = noise(bytes.len(), self.number);
            }
            LastingFault::Half => {
                let half = item.bytes().len() / 2;
                item.bytes().truncate(half);
            }
            LastingFault::FlippedBits => {
                let bytes = item.bytes();
                *bytes = flipped(bytes);
            }
            _ => item.spoil(fault, self.number),
        }
        self.waiting.push_back(item);
    }

    /// Holds deliveries back for a time, then passes on all of them or the newest one.
    fn hold(&mut self, item: T, time: Duration, passes_all: bool) {
        let now = item.arrived_at();
        self.held.push_back(item);
        let first = self.held.front().map_or(now, Faulty::arrived_at);
        if now < first + time {
            return;
        }
        if !passes_all {
            self.held.drain(..self.held.len() - 1);
        }
        self.release(now);
    }

    /// Passes on what is held, which arrives now.
    fn release(&mut self, now: MonotonicTime) {
        for mut held in self.held.drain(..) {
            held.arrive(now);
            self.waiting.push_back(held);
        }
    }
}

/// Bytes without a pattern.
fn noise(len: usize, seed: u64) -> Bytes {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let next = |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state as u8
    };
    (0..len).map(next).collect()
}

/// Flips bits behind the first quarter, where the header of a coded picture ends.
fn flipped(bytes: &Bytes) -> Bytes {
    let quarter = bytes.len() / 4;
    let flip = |(i, byte): (usize, &u8)| match i {
        i if i > quarter && i % 97 == 0 => byte ^ 0x5a,
        _ => *byte,
    };
    bytes.iter().enumerate().map(flip).collect()
}

/// A camera whose faults are switched.
pub struct SwitchedCamera {
    inner: Box<dyn Camera>,
    deliveries: Deliveries<Frame>,
}

impl SwitchedCamera {
    /// Wraps another camera.
    #[must_use]
    pub fn new(name: &str, inner: Box<dyn Camera>, switch: FaultSwitch) -> Self {
        let deliveries = Deliveries::new(name, switch);
        Self { inner, deliveries }
    }
}

impl Camera for SwitchedCamera {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let inner = &mut self.inner;
        self.deliveries.next(|| inner.next_frame(timeout))
    }

    fn report(&self) -> CameraReport {
        let mut report = self.inner.report();
        report.counters.lost += self.deliveries.lost;
        if self.deliveries.switch.fault() == Some(LastingFault::ControlChanged) {
            report.controls = [ControlReport {
                name: "gain".into(),
                wanted: 10,
                in_force: Some(40),
                standing: ControlStanding::Changed,
            }]
            .into();
        }
        report
    }
}

/// A tracker whose faults are switched.
pub struct SwitchedTracker {
    inner: Box<dyn Tracker>,
    deliveries: Deliveries<TrackerBytes>,
}

impl SwitchedTracker {
    /// Wraps another tracker.
    #[must_use]
    pub fn new(name: &str, inner: Box<dyn Tracker>, switch: FaultSwitch) -> Self {
        let deliveries = Deliveries::new(name, switch);
        Self { inner, deliveries }
    }
}

impl Tracker for SwitchedTracker {
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        let inner = &mut self.inner;
        self.deliveries.next(|| inner.next_bytes(timeout))
    }

    fn report(&self) -> TrackerReport {
        self.inner.report()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Delivers "a", "b", … every 10 ms.
    struct Letters(u8);

    impl Tracker for Letters {
        fn next_bytes(&mut self, _: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
            self.0 += 1;
            Ok(Some(TrackerBytes {
                bytes: vec![b'`' + self.0; 4].into(),
                arrived_at: MonotonicTime::from_nanos(i64::from(self.0) * 10_000_000),
            }))
        }

        fn report(&self) -> TrackerReport {
            TrackerReport::default()
        }
    }

    /// Returns the first letters of deliveries and "-" for none, then those after the fault.
    fn deliveries(fault: LastingFault, reads: usize) -> String {
        let switch = FaultSwitch::default();
        let mut tracker = SwitchedTracker::new("t", Box::new(Letters(0)), switch.clone());
        let mut read = |n: usize| -> String {
            let read = |_| match tracker.next_bytes(Duration::ZERO) {
                Ok(Some(got)) => char::from(got.bytes[0]),
                Ok(None) => '-',
                Err(_) => '!',
            };
            (0..n).map(read).collect()
        };
        switch.set(Some(fault));
        let during = read(reads);
        switch.set(None);
        format!("{during} {}", read(2))
    }

    #[test]
    fn faults_last_until_they_are_switched_off() {
        let hold = Duration::from_millis(20);
        for (fault, reads, expected) in [
            (LastingFault::Unplugged, 4, "!!!! ab"),
            (LastingFault::Silent, 4, "---- ef"),
            (LastingFault::Drops, 10, "abcdefghi- kl"),
            (LastingFault::Duplicates, 4, "aabb cd"),
            // In two parts, which the check of spelling takes for no word.
            (LastingFault::Reordered, 4, concat!("-b", "a- cd")),
            (LastingFault::Slow(hold), 4, "--c- de"),
            (LastingFault::Burst(hold), 4, "--ab cd"),
        ] {
            assert_eq!(deliveries(fault.clone(), reads), expected, "{fault:?}");
        }
    }

    #[test]
    fn unplugged_device_cannot_be_opened() {
        let switch = FaultSwitch::default();
        assert!(switch.plugged_in("t").is_ok());
        switch.set(Some(LastingFault::Unplugged));
        assert!(switch.plugged_in("t").is_err());
    }
}
