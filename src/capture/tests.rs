#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
use super::*;
use bytes::Bytes;
use penumbra_faulty::{Fault, FaultyTracker, Plan};
use penumbra_interface::{
    Clock, DeviceError, Frame, MonotonicTime, PixelFormat, SystemClock, Tracker, TrackerBytes,
    TrackerReport,
};
use penumbra_session::SessionEvent;
use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::time::Duration;

const MS: i64 = 1_000_000;

/// Time that passes only while somebody waits, and that ends.
struct FakeTime {
    now: Arc<AtomicI64>,
    end: i64,
    pauses: AtomicU64,
}

impl FakeTime {
    fn until_millis(end: i64) -> Self {
        Self {
            now: Arc::default(),
            end: end * MS,
            pauses: AtomicU64::new(0),
        }
    }

    fn millis(&self) -> i64 {
        self.now.load(Ordering::Relaxed) / MS
    }
}

impl Clock for FakeTime {
    fn now(&self) -> MonotonicTime {
        MonotonicTime::from_nanos(self.now.load(Ordering::Relaxed))
    }
}

impl Timekeeper for FakeTime {
    fn pause(&self, time: Duration) -> bool {
        self.pauses.fetch_add(1, Ordering::Relaxed);
        self.now
            .fetch_add(time.as_nanos() as i64, Ordering::Relaxed);
        !self.stopping()
    }

    fn stopping(&self) -> bool {
        self.now.load(Ordering::Relaxed) >= self.end
    }
}

/// A tracker that delivers every 10 ms while it is plugged in. It holds a descriptor.
struct Fake {
    now: Arc<AtomicI64>,
    plugged: fn(i64) -> bool,
    _descriptor: std::fs::File,
}

impl Fake {
    fn open(
        now: &Arc<AtomicI64>,
        plugged: fn(i64) -> bool,
    ) -> Result<Box<dyn Tracker>, DeviceError> {
        if !plugged(now.load(Ordering::Relaxed) / MS) {
            return Err(DeviceError::NotFound {
                device: "fake".to_owned(),
            });
        }
        Ok(Box::new(Self {
            now: Arc::clone(now),
            plugged,
            _descriptor: std::fs::File::open("/dev/null").unwrap(),
        }))
    }
}

impl Tracker for Fake {
    fn next_bytes(&mut self, _: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        let now = self.now.fetch_add(10 * MS, Ordering::Relaxed) + 10 * MS;
        if !(self.plugged)(now / MS) {
            return Err(DeviceError::Unplugged {
                device: "fake".to_owned(),
            });
        }
        Ok(Some(TrackerBytes {
            bytes: Bytes::from_static(b"abc"),
            arrived_at: MonotonicTime::from_nanos(now),
        }))
    }

    fn report(&self) -> TrackerReport {
        TrackerReport {
            protocol: "fake".to_owned(),
            ..TrackerReport::default()
        }
    }
}

/// Notes when something came.
#[derive(Clone, Default)]
struct Notes {
    arrivals: Rc<RefCell<Vec<i64>>>,
    accounts: Rc<RefCell<u64>>,
}

impl Sink<TrackerBytes> for Notes {
    fn account(&mut self, account: &Account) {
        assert!(matches!(account, Account::Tracker(r) if r.protocol == "fake"));
        *self.accounts.borrow_mut() += 1;
    }

    fn deliver(&mut self, item: TrackerBytes) {
        self.arrivals
            .borrow_mut()
            .push(item.arrived_at.as_nanos() / MS);
    }
}

/// Supervises a fake for so long; what was delivered when, and what stands on the board.
fn supervised(
    millis: i64,
    mut open: impl FnMut(&Arc<AtomicI64>) -> Result<Box<dyn Tracker>, DeviceError>,
) -> (Vec<i64>, Condition, FakeTime) {
    let time = FakeTime::until_millis(millis);
    let (board, mut notes) = (Board::default(), Notes::default());
    let now = Arc::clone(&time.now);
    supervise(
        "fake",
        &mut || open(&now),
        &mut notes,
        (&board, &time, Limits::default()),
    );
    let arrivals = notes.arrivals.borrow().clone();
    (arrivals, board.condition(), time)
}

#[test]
fn a_device_that_appears_late_delivers_within_two_seconds() {
    let plugged = |ms| ms >= 10_000;
    let (arrivals, condition, time) = supervised(12_000, |now| Fake::open(now, plugged));
    assert!((10_000..12_000).contains(&arrivals[0]), "{}", arrivals[0]);
    assert_eq!(condition.received, arrivals.len() as u64);
    assert_eq!(
        (condition.losses, condition.state),
        (0, DeviceState::Closed)
    );
    assert_eq!(condition.reason, None);
    assert!(condition.last_trouble.unwrap().contains("not there"));
    // Ten seconds of asking in vain are a handful of attempts.
    assert!(
        (5..20).contains(&condition.attempts),
        "{}",
        condition.attempts
    );
    assert!(time.pauses.load(Ordering::Relaxed) < 20);
}

#[test]
fn every_replug_is_survived_and_counted() {
    // Four seconds in, three out, for a minute.
    let plugged = |ms| ms % 7000 < 4000;
    let (arrivals, condition, _) = supervised(59_000, |now| Fake::open(now, plugged));
    assert_eq!(condition.losses, 8);
    for lap in 0..8 {
        let back = lap * 7000;
        let first = arrivals.iter().find(|at| **at >= back).unwrap();
        assert!(*first < back + 2000, "back at {back}, delivers at {first}");
    }
}

#[test]
fn a_device_that_falls_silent_is_opened_anew_and_said_to_be_silent_meanwhile() {
    let states = RefCell::new(Vec::new());
    let time = FakeTime::until_millis(10_000);
    let (board, mut notes) = (Board::default(), Notes::default());
    let mut opened = 0;
    let mut open = || {
        states.borrow_mut().push(board.condition());
        opened += 1;
        let fake = Fake::open(&time.now, |_| true)?;
        let readings = if opened == 1 { 100_000 } else { 0 };
        let plan = Plan::new([(50, Fault::Silence { readings })]);
        Ok(Box::new(FaultyTracker::new(fake, plan)) as Box<dyn Tracker>)
    };
    supervise(
        "fake",
        &mut open,
        &mut notes,
        (&board, &time, Limits::default()),
    );
    let states = states.into_inner();
    let last = board.condition();
    assert_eq!((states.len(), last.attempts, last.losses), (2, 2, 1));
    let reason = states[1].reason.clone().unwrap();
    assert!(reason.contains("silent for 3"), "{reason}");
    assert!(last.received > 400);
}

#[test]
fn damaged_data_is_counted_and_only_a_flood_of_it_closes_the_device() {
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
    let (arrivals, condition, time) = supervised(8000, |now| {
        let fake = Fake::open(now, |_| true)?;
        let plan = plans.pop().unwrap_or_default();
        Ok(Box::new(FaultyTracker::new(fake, plan)))
    });
    // The flood is one device's; the next one is good.
    assert_eq!((condition.damaged, condition.losses), (101, 1));
    assert!(condition.last_trouble.unwrap().contains("damaged data"));
    assert!(arrivals.len() > 400);
    assert!(
        time.pauses.load(Ordering::Relaxed) >= 90,
        "no spinning through a flood"
    );
}

#[test]
fn a_driver_that_panics_costs_its_device_and_not_the_rig() {
    let mut opened = 0;
    let (arrivals, condition, _) = supervised(10_000, |now| {
        opened += 1;
        assert!(opened != 2, "a bug while opening");
        let fake = Fake::open(now, |_| true)?;
        let plan = Plan::new((opened == 1).then_some((3, Fault::Panic)));
        Ok(Box::new(FaultyTracker::new(fake, plan)))
    });
    assert_eq!((condition.attempts, condition.losses), (3, 1));
    assert!(condition.last_trouble.unwrap().contains("panicked"));
    assert!(arrivals.len() > 300);
}

#[test]
fn what_only_the_user_can_mend_is_tried_again_slowly() {
    let allowed_at = 20_000;
    let (arrivals, condition, _) = supervised(25_000, |now| {
        if now.load(Ordering::Relaxed) / MS < allowed_at {
            return Err(DeviceError::Refused {
                device: "fake".to_owned(),
                reason: "of another kind".to_owned(),
            });
        }
        Fake::open(now, |_| true)
    });
    assert!(arrivals[0] < allowed_at + 4000);
    assert!(condition.attempts < 12, "{}", condition.attempts);
}

#[test]
fn a_driver_that_returns_at_once_with_nothing_is_not_asked_in_a_spin() {
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
    let (arrivals, condition, time) = supervised(2000, |_| Ok(Box::new(Hasty)));
    assert!(arrivals.is_empty());
    assert_eq!(condition.state, DeviceState::Closed);
    let pauses = time.pauses.load(Ordering::Relaxed);
    assert!(
        (300..=401).contains(&pauses),
        "{pauses} over {} ms",
        time.millis()
    );
}

#[cfg(target_os = "linux")]
#[test]
fn ten_thousand_reopenings_leave_nothing_behind() {
    let open_files = || std::fs::read_dir("/proc/self/fd").unwrap().count();
    let threads = || std::fs::read_dir("/proc/self/task").unwrap().count();
    let before = (open_files(), threads());
    // One delivery, then unplugged, again and again.
    let (arrivals, condition, _) = supervised(i64::MAX / MS, {
        let mut opened = 0;
        move |now| {
            opened += 1;
            if opened > 10_000 {
                now.store(i64::MAX, Ordering::Relaxed);
            }
            let fake = Fake::open(now, |_| true)?;
            let unplugged = DeviceError::Unplugged {
                device: "fake".to_owned(),
            };
            let plan = Plan::new([(1, Fault::Error(unplugged))]);
            Ok(Box::new(FaultyTracker::new(fake, plan)))
        }
    });
    assert_eq!((arrivals.len(), condition.losses), (10_000, 10_000));
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

fn told(hub: &Hub) -> Vec<String> {
    let tell = |taken| match taken {
        Taken::Event(SessionEvent::Scene(f)) => format!("scene {}", f.sequence),
        Taken::Event(event) => format!("other {}", event.arrived_at().as_nanos() / MS),
        Taken::Superseded(at) => format!("superseded {}", at.as_nanos() / MS),
        Taken::Idle | Taken::Ended => panic!("something waits"),
    };
    std::iter::from_fn(|| hub.take_waiting())
        .map(tell)
        .collect()
}

#[test]
fn the_newest_pictures_win_and_readings_of_the_tracker_stay() {
    let hub = Hub::new(Arc::new(SystemClock), true);
    for millis in 0..6 {
        hub.deliver(SessionEvent::Scene(frame(10 * millis)));
        hub.deliver(bytes(10 * millis + 5));
    }
    let expected = "superseded 0,other 5,superseded 10,other 15,scene 20,other 25,scene 30,\
                    other 35,scene 40,other 45,scene 50,other 55";
    assert_eq!(told(&hub).join(","), expected);
    assert_eq!(hub.counts().scene_superseded, 2);
    (0..5000).for_each(|millis| hub.deliver(bytes(millis)));
    let kept = told(&hub);
    assert_eq!((kept.len() as u64, hub.counts().tracker_lost), (4096, 904));
    assert_eq!(kept.last().unwrap(), "other 4999");
}

#[test]
fn a_wait_ends_with_a_tick_at_its_deadline_or_idly_without_one() {
    let hub = Hub::new(Arc::new(SystemClock), true);
    let patience = Duration::from_millis(20);
    let deadline = SystemClock.now() + Duration::from_millis(5);
    let Taken::Event(SessionEvent::Tick(at)) = hub.take(Some(deadline), patience) else {
        panic!("a tick");
    };
    assert!(at >= deadline);
    assert!(matches!(hub.take(None, patience), Taken::Idle));
    let far = SystemClock.now() + Duration::from_secs(3600);
    assert!(matches!(hub.take(Some(far), patience), Taken::Idle));
    hub.end();
    hub.deliver(bytes(1));
    assert!(matches!(
        hub.take(None, Duration::from_secs(3600)),
        Taken::Ended
    ));
}

#[test]
fn the_recorder_gets_the_same_order_and_a_full_one_holds_nobody_up() {
    let hub = Hub::new(Arc::new(SystemClock), false);
    let (sender, receiver) = crossbeam_channel::bounded(3);
    let (waiting, dropped) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    hub.set_recorder(Some(hub::Inlet::new(
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
    assert!(hub.take_waiting().is_none(), "nobody takes");
    hub.set_recorder(None);
    hub.deliver(bytes(9));
    assert_eq!(receiver.try_iter().count(), 0);
}
