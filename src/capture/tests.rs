use super::*;
use bytes::Bytes;
use penumbra_faulty::{Fault, FaultyTracker, Plan};
use penumbra_interface::{
    Clock, DeviceError, Frame, ManualClock, MonotonicTime, PixelFormat, SystemClock, Tracker,
    TrackerBytes, TrackerReport,
};
use penumbra_session::SessionEvent;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const MS: i64 = 1_000_000;

/// Simulated time, which passes only in pauses and reads, and stops the loop at `end`.
struct FakeTime {
    clock: ManualClock,
    end: i64,
    pauses: AtomicU64,
}

impl FakeTime {
    fn until_millis(end: i64) -> Self {
        Self {
            clock: ManualClock::default(),
            end: end * MS,
            pauses: AtomicU64::new(0),
        }
    }

    fn millis(&self) -> i64 {
        self.now().as_nanos() / MS
    }
}

impl Clock for FakeTime {
    fn now(&self) -> MonotonicTime {
        self.clock.now()
    }
}

impl StoppableClock for FakeTime {
    fn pause(&self, time: Duration) -> bool {
        self.pauses.fetch_add(1, Ordering::Relaxed);
        self.clock.advance(time.as_nanos() as i64);
        !self.is_stopping()
    }

    fn is_stopping(&self) -> bool {
        self.now().as_nanos() >= self.end
    }
}

/// A tracker that delivers every 10 ms while it is plugged in. It holds a file descriptor.
struct Fake {
    clock: ManualClock,
    plugged: fn(i64) -> bool,
    _descriptor: std::fs::File,
}

impl Fake {
    fn open(
        clock: &ManualClock,
        plugged: fn(i64) -> bool,
    ) -> Result<Box<dyn Tracker>, DeviceError> {
        if !plugged(clock.now().as_nanos() / MS) {
            return Err(DeviceError::NotFound {
                device: "fake".to_owned(),
            });
        }
        Ok(Box::new(Self {
            clock: clock.clone(),
            plugged,
            _descriptor: std::fs::File::open("/dev/null").unwrap(),
        }))
    }
}

impl Tracker for Fake {
    fn next_bytes(&mut self, _: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        self.clock.advance(10 * MS);
        let now = self.clock.now();
        if !(self.plugged)(now.as_nanos() / MS) {
            return Err(DeviceError::Unplugged {
                device: "fake".to_owned(),
            });
        }
        Ok(Some(TrackerBytes {
            bytes: Bytes::from_static(b"abc"),
            arrived_at: now,
        }))
    }

    fn report(&self) -> TrackerReport {
        TrackerReport {
            protocol: "fake".to_owned(),
            ..TrackerReport::default()
        }
    }
}

/// Notes the arrival of each delivery, milliseconds, and counts the reports.
#[derive(Clone, Default)]
struct Notes {
    arrivals: Rc<RefCell<Vec<i64>>>,
    reports: Rc<RefCell<u64>>,
}

impl Sink<TrackerBytes> for Notes {
    fn report(&mut self, report: &DeviceReport) {
        assert!(matches!(report, DeviceReport::Tracker(r) if r.protocol == "fake"));
        *self.reports.borrow_mut() += 1;
    }

    fn deliver(&mut self, item: TrackerBytes) {
        self.arrivals
            .borrow_mut()
            .push(item.arrived_at.as_nanos() / MS);
    }
}

/// Supervises a fake tracker for `millis` of simulated time. Returns the arrivals, the final
/// status and the time.
fn supervised(
    millis: i64,
    mut open: impl FnMut(&ManualClock) -> Result<Box<dyn Tracker>, DeviceError>,
) -> (Vec<i64>, DeviceStatus, FakeTime) {
    let time = FakeTime::until_millis(millis);
    let (monitor, mut notes) = (DeviceMonitor::default(), Notes::default());
    let clock = time.clock.clone();
    supervisor(&monitor, &time).run(&mut || open(&clock), &mut notes);
    let arrivals = notes.arrivals.borrow().clone();
    (arrivals, monitor.status(), time)
}

fn supervisor<'a>(monitor: &'a DeviceMonitor, clock: &'a FakeTime) -> Supervisor<'a> {
    Supervisor {
        name: "fake",
        monitor,
        clock,
        limits: Limits::default(),
    }
}

#[test]
fn device_that_is_plugged_in_late_delivers_within_two_seconds() {
    let plugged = |ms| ms >= 10_000;
    let (arrivals, status, time) = supervised(12_000, |clock| Fake::open(clock, plugged));
    assert!((10_000..12_000).contains(&arrivals[0]), "{}", arrivals[0]);
    assert_eq!(status.received, arrivals.len() as u64);
    assert_eq!((status.losses, status.state), (0, DeviceState::Closed));
    assert_eq!(status.reason, None);
    assert!(status.last_trouble.unwrap().contains("not connected"));
    // Ten seconds without the device take a handful of attempts.
    assert!((5..20).contains(&status.attempts), "{}", status.attempts);
    assert!(time.pauses.load(Ordering::Relaxed) < 20);
}

#[test]
fn reconnects_after_every_replug_and_counts_it() {
    // Four seconds plugged in, three out, for a minute.
    let plugged = |ms| ms % 7000 < 4000;
    let (arrivals, status, _) = supervised(59_000, |clock| Fake::open(clock, plugged));
    assert_eq!(status.losses, 8);
    for lap in 0..8 {
        let back = lap * 7000;
        let first = arrivals.iter().find(|at| **at >= back).unwrap();
        assert!(*first < back + 2000, "back at {back}, delivers at {first}");
    }
}

#[test]
fn silent_device_is_reported_and_opened_again() {
    let states = RefCell::new(Vec::new());
    let time = FakeTime::until_millis(10_000);
    let (monitor, mut notes) = (DeviceMonitor::default(), Notes::default());
    let mut opened = 0;
    let mut open = || {
        states.borrow_mut().push(monitor.status());
        opened += 1;
        let fake = Fake::open(&time.clock, |_| true)?;
        let readings = if opened == 1 { 100_000 } else { 0 };
        let plan = Plan::new([(50, Fault::Silence { readings })]);
        Ok(Box::new(FaultyTracker::new(fake, plan)) as Box<dyn Tracker>)
    };
    supervisor(&monitor, &time).run(&mut open, &mut notes);
    let states = states.into_inner();
    let last = monitor.status();
    assert_eq!((states.len(), last.attempts, last.losses), (2, 2, 1));
    let reason = states[1].reason.clone().unwrap();
    assert!(reason.contains("silent for 3"), "{reason}");
    assert!(last.received > 400);
}

#[test]
fn counts_damaged_data_and_reopens_the_device_only_after_a_flood() {
    let damaged = || {
        Fault::Error(DeviceError::Damaged {
            device: "fake".to_owned(),
            reason: "test".to_owned(),
        })
    };
    let one = std::iter::once((5, damaged()));
    let flood = (0..150).map(|_| (0, damaged()));
    let plan: Vec<_> = one.chain(flood).collect();
    let mut plans = vec![Plan::default(), Plan::new(plan)];
    let (arrivals, status, time) = supervised(8000, |clock| {
        let fake = Fake::open(clock, |_| true)?;
        let plan = plans.pop().unwrap_or_default();
        Ok(Box::new(FaultyTracker::new(fake, plan)))
    });
    // Only the first opening has the flood; the second delivers.
    assert_eq!((status.damaged, status.losses), (101, 1));
    assert!(status.last_trouble.unwrap().contains("damaged data"));
    assert!(arrivals.len() > 400);
    assert!(
        time.pauses.load(Ordering::Relaxed) >= 90,
        "no pauses during the flood"
    );
}

#[test]
fn reopens_a_device_whose_driver_panics() {
    let mut opened = 0;
    let (arrivals, status, _) = supervised(10_000, |clock| {
        opened += 1;
        assert!(opened != 2, "a bug while opening");
        let fake = Fake::open(clock, |_| true)?;
        let plan = Plan::new((opened == 1).then_some((3, Fault::Panic)));
        Ok(Box::new(FaultyTracker::new(fake, plan)))
    });
    assert_eq!((status.attempts, status.losses), (3, 1));
    assert!(status.last_trouble.unwrap().contains("panicked"));
    assert!(arrivals.len() > 300);
}

#[test]
fn retries_slowly_after_an_error_that_only_the_user_can_correct() {
    let allowed_at = 20_000;
    let (arrivals, status, _) = supervised(25_000, |clock| {
        if clock.now().as_nanos() / MS < allowed_at {
            return Err(DeviceError::Refused {
                device: "fake".to_owned(),
                reason: "of another kind".to_owned(),
            });
        }
        Fake::open(clock, |_| true)
    });
    assert!(arrivals[0] < allowed_at + 4000);
    assert!(status.attempts < 12, "{}", status.attempts);
}

#[test]
fn pauses_between_reads_of_a_driver_that_returns_at_once() {
    struct Hasty;
    impl Tracker for Hasty {
        fn next_bytes(&mut self, _: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
            Ok(None)
        }

        fn report(&self) -> TrackerReport {
            TrackerReport {
                protocol: "fake".to_owned(),
                ..TrackerReport::default()
            }
        }
    }
    let (arrivals, status, time) = supervised(2000, |_| Ok(Box::new(Hasty)));
    assert!(arrivals.is_empty());
    assert_eq!(status.state, DeviceState::Closed);
    let pauses = time.pauses.load(Ordering::Relaxed);
    assert!(
        (300..=401).contains(&pauses),
        "{pauses} over {} ms",
        time.millis()
    );
}

#[cfg(target_os = "linux")]
#[test]
fn ten_thousand_reopenings_leak_no_descriptors_or_threads() {
    let open_files = || std::fs::read_dir("/proc/self/fd").unwrap().count();
    let threads = || std::fs::read_dir("/proc/self/task").unwrap().count();
    let before = (open_files(), threads());
    // Each opening delivers once and is then unplugged.
    let (arrivals, status, _) = supervised(i64::MAX / MS, {
        let mut opened = 0;
        move |clock| {
            opened += 1;
            if opened > 10_000 {
                clock.set(MonotonicTime::from_nanos(i64::MAX));
            }
            let fake = Fake::open(clock, |_| true)?;
            let unplugged = DeviceError::Unplugged {
                device: "fake".to_owned(),
            };
            let plan = Plan::new([(1, Fault::Error(unplugged))]);
            Ok(Box::new(FaultyTracker::new(fake, plan)))
        }
    });
    assert_eq!((arrivals.len(), status.losses), (10_000, 10_000));
    // Other tests of this process open and close files meanwhile; a leak would be thousands.
    let after = (open_files(), threads());
    assert!(after.0 < before.0 + 100, "{before:?} {after:?}");
    assert!(after.1 < before.1 + 50, "{before:?} {after:?}");
}

fn frame(millis: i64) -> Frame {
    let at = MonotonicTime::from_nanos(millis * MS);
    Frame {
        data: Bytes::from_static(b"picture"),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence: millis as u64,
        captured_at: at,
        arrived_at: at,
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

fn bytes(millis: i64) -> SessionEvent {
    SessionEvent::TrackerBytes {
        protocol: "fake".into(),
        bytes: Bytes::from_static(b"abc"),
        arrived_at: MonotonicTime::from_nanos(millis * MS),
    }
}

fn waiting(hub: &Hub) -> Vec<String> {
    let text = |delivery| match delivery {
        Delivery::Event(SessionEvent::Scene(f)) => format!("scene {}", f.sequence),
        Delivery::Event(event) => format!("other {}", event.arrived_at().as_nanos() / MS),
        Delivery::Superseded { arrived_at } => format!("superseded {}", arrived_at.as_nanos() / MS),
    };
    std::iter::from_fn(|| hub.take_waiting())
        .map(text)
        .collect()
}

#[test]
fn supersedes_old_pictures_and_keeps_tracker_readings() {
    let hub = Hub::new(Arc::new(SystemClock), true);
    for millis in 0..6 {
        hub.deliver(SessionEvent::Scene(frame(10 * millis)));
        hub.deliver(bytes(10 * millis + 5));
    }
    let expected = "superseded 0,other 5,superseded 10,other 15,scene 20,other 25,scene 30,\
                    other 35,scene 40,other 45,scene 50,other 55";
    assert_eq!(waiting(&hub).join(","), expected);
    assert_eq!(hub.counts().scene_superseded, 2);
    (0..5000).for_each(|millis| hub.deliver(bytes(millis)));
    let kept = waiting(&hub);
    assert_eq!((kept.len() as u64, hub.counts().tracker_lost), (4096, 904));
    assert_eq!(kept.last().unwrap(), "other 4999");
}

#[test]
fn queue_stays_bounded_while_nothing_is_taken() {
    let hub = Hub::new(Arc::new(SystemClock), true);
    (0..10_000).for_each(|millis| hub.deliver(SessionEvent::Scene(frame(millis))));
    let kept = waiting(&hub);
    assert_eq!(kept.len(), 4096 + 4);
    assert_eq!(kept.first().unwrap(), "superseded 5900");
    assert_eq!(kept.last().unwrap(), "scene 9999");
    assert_eq!(hub.counts().scene_superseded, 9996);
    // Taken entries no longer count.
    (0..6).for_each(|millis| hub.deliver(SessionEvent::Scene(frame(millis))));
    assert_eq!(waiting(&hub).len(), 6);
}

#[test]
fn wait_ends_with_a_tick_at_the_deadline_or_idle_at_the_timeout() {
    let hub = Hub::new(Arc::new(SystemClock), true);
    let timeout = Duration::from_millis(20);
    let deadline = SystemClock.now() + Duration::from_millis(5);
    let Next::Item(Delivery::Event(SessionEvent::Tick(at))) = hub.take(Some(deadline), timeout)
    else {
        panic!("expected a tick");
    };
    assert!(at >= deadline);
    assert!(matches!(hub.take(None, timeout), Next::Idle));
    let far = SystemClock.now() + Duration::from_secs(3600);
    assert!(matches!(hub.take(Some(far), timeout), Next::Idle));
    hub.end();
    hub.deliver(bytes(1));
    assert!(matches!(
        hub.take(None, Duration::from_secs(3600)),
        Next::Ended
    ));
}

#[test]
fn recorder_gets_events_in_order_and_drops_those_that_do_not_fit() {
    let hub = Hub::new(Arc::new(SystemClock), false);
    let (sender, receiver) = crossbeam_channel::bounded(3);
    let (waiting, dropped) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    hub.set_recorder(Some(RecorderQueue::new(
        sender,
        waiting.clone(),
        dropped.clone(),
    )));
    (0..5).for_each(|millis| hub.deliver(bytes(millis)));
    assert_eq!(dropped.load(Ordering::Relaxed), 2);
    assert_eq!(waiting.load(Ordering::Relaxed), 9);
    let got: Vec<_> = receiver
        .try_iter()
        .map(|e| e.arrived_at().as_nanos() / MS)
        .collect();
    assert_eq!(got, [0, 1, 2]);
    assert!(hub.take_waiting().is_none(), "the hub has no consumer");
    hub.set_recorder(None);
    hub.deliver(bytes(9));
    assert_eq!(receiver.try_iter().count(), 0);
}
