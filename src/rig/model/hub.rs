//! The hub: no notification is lost, the queue stays bounded, what is dropped is counted, the newest
//! is kept, the end loses nothing, and ticks come when they are due.

use crate::{
    FOREVER, assert_ascending, check, check_all, device, environment, numbers_of, reading, scene,
    small,
};
use penumbra_capture::hub::{
    MAX_ENVIRONMENT_PICTURES, MAX_SCENE_PICTURES, MAX_SUPERSEDED, MAX_TRACKER_READINGS,
};
use penumbra_capture::sync::atomic::AtomicU64;
use penumbra_capture::sync::channel::bounded;
use penumbra_capture::sync::{JoinHandle, threads};
use penumbra_capture::{Delivery, Hub, Next, RecorderQueue};
use penumbra_interface::{Clock, ManualClock, MonotonicTime};
use penumbra_session::SessionEvent;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicUsize, Ordering};
use std::time::Duration;

const MS: i64 = 1_000_000;

/// What a consumer took until the end.
#[derive(Default)]
struct Taken {
    events: Vec<SessionEvent>,
    superseded: Vec<i64>,
    /// Arrivals of pictures of the scene camera, superseded or not.
    scene: Vec<i64>,
}

impl Taken {
    fn add(&mut self, delivery: Delivery) {
        match delivery {
            Delivery::Event(event) => {
                if matches!(event, SessionEvent::Scene(_)) {
                    self.scene.push(event.arrived_at().as_nanos());
                }
                self.events.push(event);
            }
            Delivery::Superseded { arrived_at } => {
                self.scene.push(arrived_at.as_nanos());
                self.superseded.push(arrived_at.as_nanos());
            }
        }
    }
}

fn new_hub() -> Arc<Hub> {
    Hub::new(Arc::new(ManualClock::default()), true)
}

/// A consumer that never stops to wait by itself: if it is not woken, the model hangs.
fn consumer(hub: &Arc<Hub>) -> JoinHandle<Taken> {
    let hub = Arc::clone(hub);
    let take = move || {
        let mut taken = Taken::default();
        loop {
            match hub.take(None, FOREVER) {
                Next::Item(delivery) => taken.add(delivery),
                Next::Ended => return taken,
                Next::Idle => panic!("a wait of hours has ended"),
            }
        }
    };
    threads::spawn("consumer", take).unwrap()
}

#[test]
fn every_delivery_is_taken_or_counted_and_the_newest_is_taken() {
    check(|| {
        let hub = new_hub();
        let consumer = consumer(&hub);
        let devices = [
            device(&hub, 1..=5, scene),
            device(&hub, 1..=4, environment),
            device(&hub, 1..=6, reading),
        ];
        devices.into_iter().for_each(|d| d.join().unwrap());
        hub.end();
        let taken = consumer.join().unwrap();
        let counts = hub.counts();
        for (event, delivered, lost) in [
            (scene as fn(i64) -> _, 5, counts.scene_superseded),
            (environment, 4, counts.environment_lost),
            (reading, 6, counts.tracker_lost),
        ] {
            let numbers = numbers_of(&taken.events, event);
            assert_ascending(&numbers);
            assert_eq!(numbers.len() as u64 + lost, delivered as u64);
            assert_eq!(numbers.last(), Some(&delivered));
        }
        assert_ascending(&taken.scene);
        // Their arrivals are lost only beyond the limit.
        let (seen, all) = (taken.superseded.len(), counts.scene_superseded as usize);
        assert!((all.min(MAX_SUPERSEDED)..=all).contains(&seen));
    });
}

#[test]
fn queue_stays_bounded_and_its_counters_are_right_whenever_something_is_taken() {
    check(|| {
        let hub = new_hub();
        let devices = [
            device(&hub, 1..=6, scene),
            device(&hub, 1..=4, environment),
            device(&hub, 1..=5, reading),
        ];
        let mut taken = Taken::default();
        (0..4).for_each(|_| hub.take_waiting().into_iter().for_each(|d| taken.add(d)));
        devices.into_iter().for_each(|d| d.join().unwrap());
        assert_bounded(&hub);
        // Nothing is left over of what was counted as waiting.
        let before = hub.counts();
        (0..MAX_SCENE_PICTURES as i64).for_each(|n| hub.deliver(scene(n)));
        (0..MAX_ENVIRONMENT_PICTURES as i64).for_each(|n| hub.deliver(environment(n)));
        (0..MAX_TRACKER_READINGS as i64).for_each(|n| hub.deliver(reading(n)));
        assert_eq!(hub.counts(), before);
        assert_bounded(&hub);
        let all = MAX_SCENE_PICTURES + MAX_SUPERSEDED;
        (0..all as i64).for_each(|n| hub.deliver(scene(n)));
        assert_eq!(std::iter::from_fn(|| hub.take_waiting()).count(), all);
    });
}

/// Takes what is waiting.
fn assert_bounded(hub: &Hub) {
    let mut taken = Taken::default();
    std::iter::from_fn(|| hub.take_waiting()).for_each(|d| taken.add(d));
    for (event, most) in [
        (scene as fn(i64) -> _, MAX_SCENE_PICTURES),
        (environment, MAX_ENVIRONMENT_PICTURES),
        (reading, MAX_TRACKER_READINGS),
    ] {
        assert!(numbers_of(&taken.events, event).len() <= most);
    }
    assert!(taken.superseded.len() <= MAX_SUPERSEDED);
    assert_ascending(&taken.scene);
}

#[test]
fn end_wakes_the_consumer_and_loses_nothing_delivered_before() {
    check(|| {
        let hub = new_hub();
        let consumer = consumer(&hub);
        let delivered = Arc::<AtomicUsize>::default();
        let device = {
            let (hub, delivered) = (Arc::clone(&hub), Arc::clone(&delivered));
            let deliver = move || {
                for n in 1..=3 {
                    hub.deliver(reading(n));
                    delivered.fetch_add(1, Ordering::Relaxed);
                }
            };
            threads::spawn("device", deliver).unwrap()
        };
        let before = delivered.load(Ordering::Relaxed);
        hub.end();
        let taken = consumer.join().unwrap();
        device.join().unwrap();
        let numbers = numbers_of(&taken.events, reading);
        assert!(numbers.len() >= before, "{before}: {numbers:?}");
        assert!(numbers.iter().copied().eq(1..=numbers.len() as i64));
        assert!(hub.take_waiting().is_none() && matches!(hub.take(None, FOREVER), Next::Ended));
    });
}

/// The smallest complete models. The end comes only after both deliveries are taken, so that its
/// notification cannot replace a lost one.
#[test]
fn no_schedule_loses_a_delivery_or_its_notification() {
    check_all(|| {
        let hub = new_hub();
        let device = device(&hub, 1..=2, reading);
        let mut taken = Taken::default();
        for _ in 0..2 {
            match hub.take(None, FOREVER) {
                Next::Item(delivery) => taken.add(delivery),
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(numbers_of(&taken.events, reading), [1, 2]);
        device.join().unwrap();
    });
}

#[test]
fn no_schedule_loses_the_end() {
    check_all(|| {
        let hub = new_hub();
        let consumer = consumer(&hub);
        let device = device(&hub, 1..=1, reading);
        hub.end();
        let taken = consumer.join().unwrap();
        device.join().unwrap();
        assert!(numbers_of(&taken.events, reading).len() <= 1);
    });
}

/// A clock that shows another millisecond whenever it is asked.
#[derive(Default)]
struct PassingTime(AtomicI64);

impl Clock for PassingTime {
    fn now(&self) -> MonotonicTime {
        MonotonicTime::from_nanos(self.0.fetch_add(MS, Ordering::Relaxed))
    }
}

#[test]
fn ticks_come_at_their_deadline_and_the_recorder_gets_the_order_of_the_rig() {
    check(|| {
        let hub = Hub::new(Arc::new(PassingTime::default()), true);
        let devices = [device(&hub, 1..=2, small), device(&hub, 1..=3, reading)];
        let consumer = {
            let hub = Arc::clone(&hub);
            threads::spawn("consumer", move || take_with_deadlines(&hub)).unwrap()
        };
        devices.into_iter().for_each(|d| d.join().unwrap());
        hub.end();
        let (taken, recorded) = consumer.join().unwrap();
        assert_eq!(numbers_of(&taken, small), [1, 2]);
        assert_eq!(numbers_of(&taken, reading), [1, 2, 3]);
        let name = |e: &SessionEvent| (std::mem::discriminant(e), e.arrived_at());
        let [taken, recorded] = [taken, recorded].map(|e| e.iter().map(name).collect::<Vec<_>>());
        assert!(taken.ends_with(&recorded), "{taken:?} {recorded:?}");
    });
}

/// Takes to the end. Returns also what a recorder got meanwhile, whose queue comes some time after
/// the first delivery.
fn take_with_deadlines(hub: &Hub) -> (Vec<SessionEvent>, Vec<SessionEvent>) {
    let (sender, queue) = bounded(1000);
    let bytes = Arc::<AtomicU64>::default();
    hub.set_recorder(Some(RecorderQueue::new(
        sender,
        bytes.clone(),
        Arc::default(),
    )));
    let mut deadline = MonotonicTime::from_nanos(3 * MS);
    let (mut taken, mut recorded) = (Vec::new(), Vec::new());
    loop {
        let next = hub.take(Some(deadline), Duration::from_millis(5));
        while let Ok(event) = queue.try_recv() {
            bytes.fetch_sub(event.bytes() as u64, Ordering::Relaxed);
            recorded.push(event);
        }
        match next {
            Next::Item(Delivery::Event(event)) => {
                if let SessionEvent::Tick(at) = event {
                    assert!(at >= deadline);
                    deadline = at + Duration::from_millis(3);
                }
                taken.push(event);
            }
            Next::Item(Delivery::Superseded { .. }) => panic!("the queue holds two pictures"),
            Next::Idle => (),
            Next::Ended => return (taken, recorded),
        }
    }
}
