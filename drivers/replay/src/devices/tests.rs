use super::*;
use crate::playback::{Items, LATE_NANOS};
use bytes::Bytes;
use penumbra_interface::{Clock, ManualClock, MonotonicTime, PixelFormat};

thread_local! {
    /// Each test runs on its own thread.
    static CLOCK: ManualClock = ManualClock::new(MonotonicTime::from_nanos(5_000_000_000));
}

fn clock() -> ManualClock {
    CLOCK.with(Clone::clone)
}

fn sleep(time: Duration) {
    clock().advance(time.as_nanos() as i64);
}

const MS: i64 = 1_000_000;

fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(900_000_000_000_000 + millis * MS)
}

fn frame(sequence: u64, millis: i64) -> Frame {
    Frame {
        data: Bytes::from_static(b"x"),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence,
        captured_at: at(millis - 10),
        arrived_at: at(millis),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

fn timeline() -> Arc<Timeline> {
    Arc::new(Timeline::new((at(0), at(100)), Arc::new(clock()), sleep))
}

fn camera(timeline: &Arc<Timeline>) -> ReplayCamera {
    let frames =
        || Box::new([frame(7, 0), frame(8, 40), frame(10, 100)].into_iter()) as Items<Frame>;
    ReplayCamera::new("scene", timeline.clone(), Box::new(frames))
}

const LONG: Duration = Duration::from_secs(1);

#[test]
fn frames_are_repeated_at_their_intervals_with_continuing_numbers() {
    let timeline = timeline();
    let mut camera = camera(&timeline);
    let start = clock().now();
    let got: Vec<Frame> = (0..5)
        .map(|_| camera.next_frame(LONG).unwrap().unwrap())
        .collect();
    let millis = |t: MonotonicTime| t.nanos_since(start) / MS;
    let arrivals: Vec<_> = got.iter().map(|f| millis(f.arrived_at)).collect();
    assert_eq!(arrivals, [0, 40, 100, 133, 173]);
    assert_eq!(millis(got[1].captured_at), 30);
    let numbers: Vec<_> = got.iter().map(|f| f.sequence).collect();
    assert_eq!(numbers, [0, 1, 3, 4, 5]);
    let report = camera.report();
    assert_eq!((report.counters.frames, report.counters.lost), (5, 1));
    assert_eq!(report.stamps, StampSource::Recorded);
}

#[test]
fn frames_are_not_early_and_the_timeout_is_obeyed() {
    let timeline = timeline();
    let mut camera = camera(&timeline);
    camera.next_frame(LONG).unwrap().unwrap();
    let before = clock().now();
    assert!(
        camera
            .next_frame(Duration::from_millis(15))
            .unwrap()
            .is_none()
    );
    assert_eq!(clock().now().nanos_since(before), 15 * MS);
    assert!(
        camera
            .next_frame(Duration::from_millis(30))
            .unwrap()
            .is_some()
    );
}

#[test]
fn a_device_that_is_opened_later_starts_at_the_present_position() {
    let timeline = timeline();
    let mut first = camera(&timeline);
    first.next_frame(LONG).unwrap().unwrap();
    sleep(Duration::from_millis(150));
    let start = clock().now();
    let mut second = camera(&timeline);
    let frame = second.next_frame(LONG).unwrap().unwrap();
    // The second pass began 133 ms after the first.
    assert_eq!(frame.arrived_at.nanos_since(start) / MS, 173 - 150);
    // The first device was not read meanwhile: it skips what it missed.
    let frame = first.next_frame(LONG).unwrap().unwrap();
    assert!(frame.arrived_at >= start.offset_nanos(-LATE_NANOS));
}

#[test]
fn an_empty_recording_is_silent_without_spinning() {
    let timeline = timeline();
    let nothing = || Box::new(std::iter::empty()) as Items<TrackerBytes>;
    let mut tracker = ReplayTracker::new("t", "fastrak", timeline, Box::new(nothing));
    let before = clock().now();
    assert!(tracker.next_bytes(LONG).unwrap().is_none());
    assert_eq!(clock().now().nanos_since(before), 1000 * MS);
    assert_eq!(tracker.report().protocol, "fastrak");
}
