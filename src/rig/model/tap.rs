//! The tap, a calibration step's queue: bounded, what it skips is counted, and it ends.

use crate::{FOREVER, assert_ascending, check, device, environment, numbers_of, reading, scene};
use penumbra_capture::sync::{JoinHandle, threads};
use penumbra_capture::tap::{MAX_EVENTS, MAX_PICTURES};
use penumbra_capture::{FrameTap, Hub, Next, TapFilter, TapReader};
use penumbra_interface::ManualClock;
use penumbra_session::SessionEvent;
use std::sync::Arc;

const ALL: TapFilter = TapFilter {
    scene: true,
    environment: true,
    poses: true,
};

fn new_hub() -> Arc<Hub> {
    Hub::new(Arc::new(ManualClock::default()), false)
}

/// Reads to the end.
fn read(reader: TapReader) -> JoinHandle<(Vec<SessionEvent>, TapReader)> {
    let take = move || {
        let mut taken = Vec::new();
        while let Next::Item(event) = reader.next(FOREVER) {
            taken.push(event);
        }
        (taken, reader)
    };
    threads::spawn("reader", take).unwrap()
}

#[test]
fn every_delivery_is_read_or_counted() {
    check(|| {
        let hub = new_hub();
        let (tap, reader) = FrameTap::new(ALL);
        hub.set_tap(Some(tap));
        let reader = read(reader);
        let devices = [
            device(&hub, 1..=4, scene),
            device(&hub, 1..=3, environment),
            device(&hub, 1..=4, reading),
        ];
        devices.into_iter().for_each(|d| d.join().unwrap());
        hub.end();
        let (taken, reader) = reader.join().unwrap();
        let numbers = [scene as fn(i64) -> _, environment, reading].map(|e| numbers_of(&taken, e));
        numbers.iter().for_each(|n| assert_ascending(n));
        let [pictures, views, readings] = numbers.map(|n| n.len() as u64);
        assert_eq!(pictures + views + reader.pictures_skipped(), 7);
        assert_eq!(readings + reader.readings_lost(), 4);
    });
}

#[test]
fn tap_that_nobody_reads_delays_no_device_and_stays_bounded() {
    check(|| {
        let hub = new_hub();
        let (tap, reader) = FrameTap::new(ALL);
        hub.set_tap(Some(tap));
        let devices = [device(&hub, 1..=4, scene), device(&hub, 1..=6, reading)];
        devices.into_iter().for_each(|d| d.join().unwrap());
        hub.set_tap(None);
        let (taken, _) = read(reader).join().unwrap();
        assert!(numbers_of(&taken, scene).len() <= MAX_PICTURES);
        assert!(taken.len() <= MAX_EVENTS);
    });
}

/// A tap can come at any time, also together with the end.
#[test]
fn a_new_tap_ends_the_old_one_and_each_ends_with_the_hub() {
    check(|| {
        let hub = new_hub();
        let (first, first_reader) = FrameTap::new(ALL);
        let (second, second_reader) = FrameTap::new(ALL);
        hub.set_tap(Some(first));
        let readers = [first_reader, second_reader].map(read);
        let device = device(&hub, 1..=2, reading);
        let set = {
            let hub = Arc::clone(&hub);
            threads::spawn("step", move || hub.set_tap(Some(second))).unwrap()
        };
        hub.end();
        let taken = readers.map(|r| numbers_of(&r.join().unwrap().0, reading));
        set.join().unwrap();
        device.join().unwrap();
        assert_ascending(&taken.concat());
    });
}
