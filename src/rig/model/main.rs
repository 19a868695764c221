//! The queues between devices, rig and recorder, run by a model checker: the code of the program
//! itself, whose locks, channels and threads are replaced by those of shuttle (`penumbra_capture::sync`).
//! A schedule decides which thread takes the next step. `make model` runs many more of them than
//! the tests.
#![expect(clippy::unwrap_used, clippy::panic)]

mod composites;
mod hub;
mod recorder;
mod tap;

use bytes::Bytes;
use penumbra_capture::Hub;
use penumbra_capture::sync::{JoinHandle, threads};
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_session::SessionEvent;
use shuttle::scheduler::{DfsScheduler, PctScheduler, RandomScheduler};
use shuttle::{Config, Runner};
use std::sync::Arc;
use std::time::Duration;

/// Waits of this length end only with what they wait for.
const FOREVER: Duration = Duration::from_secs(7200);
/// Maximum number of switches that a schedule forces upon threads which could go on.
const SWITCHES: usize = 4;
/// Bytes of a picture: the recorder's queue holds two.
const PICTURE_BYTES: usize = 400;

fn config() -> Config {
    let mut config = Config::new();
    // Encoders and the writer of sessions need more than shuttle's 60 kB.
    config.stack_size = 1 << 20;
    // That memory is sequentially consistent in the model is known.
    config.silence_warnings = true;
    config
}

fn number(variable: &str, default: usize) -> usize {
    std::env::var(variable).map_or(default, |text| text.parse().unwrap())
}

/// Runs a model under as many random schedules, and as many in which few switches are placed at
/// random, as `PENUMBRA_MODEL_SCHEDULES` says.
fn check(model: impl Fn() + Send + Sync + Clone + 'static) {
    let schedules = number("PENUMBRA_MODEL_SCHEDULES", 1000);
    let seed = number("PENUMBRA_MODEL_SEED", 1) as u64;
    let random = RandomScheduler::new_from_seed(seed, schedules);
    Runner::new(random, config()).run(model.clone());
    let few_switches = PctScheduler::new_from_seed(seed, SWITCHES, schedules);
    Runner::new(few_switches, config()).run(model);
}

/// Runs a small model under every schedule.
fn check_all(model: impl Fn() + Send + Sync + 'static) {
    const MOST: usize = 5_000_000;
    let schedules = Runner::new(DfsScheduler::new(Some(MOST), false), config()).run(model);
    assert!(schedules < MOST, "there are more schedules");
    println!("{schedules} schedules, all of them");
}

fn at(number: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(number)
}

fn frame(number: i64, data: &'static [u8]) -> Frame {
    Frame {
        data: Bytes::from_static(data),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence: number as u64,
        captured_at: at(number),
        arrived_at: at(number),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

fn reading(number: i64) -> SessionEvent {
    SessionEvent::TrackerBytes {
        protocol: "csv".into(),
        bytes: Bytes::from_static(b"abc"),
        arrived_at: at(number),
    }
}

/// A device: delivers its events, of which numbers are given, on a thread of its own.
fn device(
    hub: &Arc<Hub>,
    numbers: impl IntoIterator<Item = i64> + Send + 'static,
    event: fn(i64) -> SessionEvent,
) -> JoinHandle<()> {
    let hub = Arc::clone(hub);
    let deliver = move || numbers.into_iter().for_each(|n| hub.deliver(event(n)));
    threads::spawn("device", deliver).unwrap()
}

fn scene(number: i64) -> SessionEvent {
    SessionEvent::Scene(frame(number, &[7; PICTURE_BYTES]))
}

/// A picture so small that the number of events limits the queues, not their bytes.
fn small(number: i64) -> SessionEvent {
    SessionEvent::Scene(frame(number, &[7]))
}

fn environment(number: i64) -> SessionEvent {
    SessionEvent::Environment(frame(number, &[7; PICTURE_BYTES]))
}

/// The numbers of the events of one device.
fn numbers_of(events: &[SessionEvent], event: fn(i64) -> SessionEvent) -> Vec<i64> {
    let kind = std::mem::discriminant(&event(0));
    let same = events.iter().filter(|e| std::mem::discriminant(*e) == kind);
    same.map(|e| e.arrived_at().as_nanos()).collect()
}

#[track_caller]
fn assert_ascending(numbers: &[i64]) {
    assert!(numbers.is_sorted_by(|a, b| a < b), "{numbers:?}");
}
