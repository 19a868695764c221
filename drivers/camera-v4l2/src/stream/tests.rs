#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use super::*;
use crate::testing::{FakeVideo, Shot};
use proptest::prelude::*;

const WAIT: Duration = Duration::from_millis(100);

fn stream(fake: &FakeVideo) -> Stream<FakeVideo> {
    let layout = Layout::of(&fake.lock().geometry).unwrap();
    let buffering = (4, Duration::from_millis(500));
    Stream::start(fake.clone(), "/dev/video7", layout, buffering, fake.clock()).unwrap()
}

fn grey() -> FakeVideo {
    FakeVideo::streaming(b"GREY", 4, 2)
}

fn taken(stream: &mut Stream<FakeVideo>) -> Option<Taken> {
    match stream.next(WAIT).unwrap() {
        Next::Picture(taken) => Some(taken),
        _ => None,
    }
}

fn shot(sequence: u32) -> Shot {
    Shot::new(sequence, vec![sequence as u8; 8])
}

#[test]
fn the_newest_of_several_is_handed_over_and_all_buffers_go_back() {
    let fake = grey();
    let mut stream = stream(&fake);
    for n in 0..3 {
        fake.arrives(10, shot(n));
    }
    let newest = taken(&mut stream).unwrap();
    assert_eq!((newest.sequence, &newest.data[..]), (2, &[2; 8][..]));
    assert_eq!(stream.counters.superseded, 2);
    assert_eq!(fake.lock().free.len(), 4);
    assert!(taken(&mut stream).is_none());
}

#[test]
fn stamps_are_the_drivers_and_arrivals_are_ours() {
    let fake = grey();
    let mut stream = stream(&fake);
    fake.arrives(50, shot(0));
    let taken = taken(&mut stream).unwrap();
    assert_eq!(taken.stamp, MonotonicTime::from_nanos(30_000_000));
    assert_eq!(taken.stamp_source, StampSource::StartOfExposure);
    assert_eq!(taken.arrived_at, MonotonicTime::from_nanos(50_000_000));
}

#[test]
fn only_the_bytes_used_are_taken() {
    let fake = FakeVideo::streaming(b"MJPG", 4, 2);
    let mut stream = stream(&fake);
    let mut padded = Shot::new(0, vec![0xAA; 4000]);
    let jpeg = [
        0xFF, 0xD8, 0xFF, 0xC4, 0, 2, 0xFF, 0xDA, 0, 2, 1, 2, 3, 0xFF, 0xD9,
    ];
    padded.data[..jpeg.len()].copy_from_slice(&jpeg);
    padded.used = 3000;
    fake.arrives(10, padded);
    assert_eq!(&taken(&mut stream).unwrap().data[..], &jpeg);
}

#[test]
fn damaged_pictures_are_counted_and_skipped() {
    let fake = grey();
    let mut stream = stream(&fake);
    let mut flagged = shot(0);
    flagged.flags |= Flags::ERROR;
    let mut empty = shot(1);
    empty.used = 0;
    let mut short = shot(2);
    short.used = 7;
    for (millis, bad) in [(10, flagged), (20, empty), (30, short)] {
        fake.arrives(millis, bad);
    }
    fake.arrives(40, shot(3));
    assert_eq!(taken(&mut stream).unwrap().sequence, 3);
    assert_eq!(stream.counters.damaged, 3);
    assert_eq!(stream.counters.lost, 0, "they did come");
    assert_eq!(fake.lock().free.len(), 4);
}

#[test]
fn a_jpeg_without_end_is_damaged_once_the_camera_has_shown_that_it_sends_ends() {
    let fake = FakeVideo::streaming(b"MJPG", 4, 2);
    let mut stream = stream(&fake);
    let whole = vec![
        0xFF, 0xD8, 0xFF, 0xC4, 0, 2, 0xFF, 0xDA, 0, 2, 1, 0xFF, 0xD9,
    ];
    let cut = whole[..11].to_vec();
    fake.arrives(10, Shot::new(0, cut.clone()));
    assert_eq!(
        taken(&mut stream).unwrap().data[..],
        whole[..],
        "its end was added"
    );
    assert_eq!(stream.unended, 1);
    fake.arrives(20, Shot::new(1, whole.clone()));
    assert_eq!(taken(&mut stream).unwrap().data[..], whole[..]);
    fake.arrives(30, Shot::new(2, cut));
    fake.arrives(30, Shot::new(3, b"no jpeg at all".to_vec()));
    assert!(taken(&mut stream).is_none());
    assert_eq!(stream.counters.damaged, 2);
}

#[test]
fn gaps_of_the_counter_are_losses() {
    let fake = grey();
    let mut stream = stream(&fake);
    for (n, sequence) in [(1, 5), (2, 6), (3, 10), (4, 11)] {
        fake.arrives(n * 10, shot(sequence));
    }
    while taken(&mut stream).is_some() {}
    assert_eq!(stream.counters.lost, 3);
}

#[test]
fn interrupted_calls_are_made_again() {
    let fake = grey();
    let mut stream = stream(&fake);
    fake.lock().wait_faults.extend([Errno::INTR, Errno::INTR]);
    fake.lock().dequeue_faults.push_back(Errno::INTR);
    fake.arrives(10, shot(0));
    assert!(taken(&mut stream).is_some());
}

#[test]
fn a_time_out_is_no_error_until_the_camera_is_silent_too_long() {
    let fake = grey();
    let mut stream = stream(&fake);
    for _ in 0..4 {
        assert!(taken(&mut stream).is_none());
    }
    let error = stream.next(WAIT).unwrap_err();
    let DeviceError::Silent { device, millis } = &error else {
        panic!("{error}");
    };
    assert_eq!((device.as_str(), *millis), ("/dev/video7", 500));
    // The stream goes on should the camera wake up: nothing was queued twice.
    fake.arrives(520, shot(0));
    assert!(taken(&mut stream).is_some());
    assert!(taken(&mut stream).is_none());
}

#[test]
fn unplugging_and_broken_streams_end_it_whichever_call_says_so() {
    for (errno, gone) in [
        (Errno::NODEV, true),
        (Errno::IO, false),
        (Errno::INVAL, false),
    ] {
        for place in 0..3 {
            let fake = grey();
            let mut stream = stream(&fake);
            fake.arrives(10, shot(0));
            match place {
                0 => fake.lock().wait_faults.push_back(errno),
                1 => fake.lock().dequeue_faults.push_back(errno),
                _ => fake.lock().queue_fault = Some(errno),
            }
            let error = stream.next(WAIT).unwrap_err();
            assert_eq!(
                matches!(error, DeviceError::Unplugged { .. }),
                gone,
                "{error}"
            );
            assert_eq!(error.recovery(), penumbra_interface::Recovery::Reopen);
        }
    }
}

#[test]
fn a_stream_that_cannot_be_stopped_is_dropped_without_a_panic() {
    for errno in [Errno::NODEV, Errno::IO, Errno::BUSY] {
        let fake = grey();
        let stream = stream(&fake);
        fake.lock().stop_fault = Some(errno);
        drop(stream);
        assert_eq!(fake.lock().stops, 1);
    }
}

#[test]
fn a_poll_that_lies_does_not_spin() {
    for error in [false, true] {
        let fake = grey();
        let mut stream = stream(&fake);
        fake.lock().poll_lies = !error;
        fake.lock().poll_error = error;
        assert!(matches!(stream.next(WAIT), Err(DeviceError::Broken { .. })));
        assert!(fake.lock().waits <= MAX_VAIN);
    }
}

#[test]
fn a_start_that_fails_says_why() {
    let fake = grey();
    fake.lock().start_fault = Some(Errno::BUSY);
    let layout = Layout::of(&fake.lock().geometry).unwrap();
    let started = Stream::start(fake.clone(), "/dev/video7", layout, (4, WAIT), fake.clock());
    assert!(matches!(started.err(), Some(DeviceError::Busy { .. })));
}

#[test]
fn rows_with_padding_have_a_stride() {
    let mut geometry = FakeVideo::streaming(b"NV12", 6, 4).lock().geometry;
    geometry.bytes_per_line = 8;
    let padded = Layout::of(&geometry).unwrap();
    assert_eq!((padded.stride, padded.least), (8, 8 * 5 + 6));
    geometry.bytes_per_line = 0;
    let tight = Layout::of(&geometry).unwrap();
    assert_eq!((tight.stride, tight.least), (0, 36));
}

#[derive(Clone, Debug)]
enum Fault {
    None,
    Flag,
    Empty,
    Short,
    Interrupt,
    Gap(u32),
}

fn any_fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        4 => Just(Fault::None),
        1 => Just(Fault::Flag),
        1 => Just(Fault::Empty),
        1 => Just(Fault::Short),
        1 => Just(Fault::Interrupt),
        1 => (1..5_u32).prop_map(Fault::Gap),
    ]
}

proptest! {
    /// Every picture is handed over, superseded, damaged or lost, and no buffer is.
    #[test]
    fn nothing_goes_missing(
        faults in proptest::collection::vec((any_fault(), 0..60_i64), 1..60)
    ) {
        let fake = grey();
        let mut stream = stream(&fake);
        let (mut sequence, mut millis, mut gaps) = (0, 1, 0);
        for (n, (fault, pause)) in faults.iter().enumerate() {
            let mut shot = shot(sequence);
            match fault {
                Fault::None => {}
                Fault::Flag => shot.flags |= Flags::ERROR,
                Fault::Empty => shot.used = 0,
                Fault::Short => shot.used = 3,
                Fault::Interrupt => fake.lock().dequeue_faults.push_back(Errno::INTR),
                Fault::Gap(gap) if n > 0 => {
                    shot.sequence += gap;
                    gaps += u64::from(*gap);
                }
                Fault::Gap(_) => {}
            }
            sequence = shot.sequence + 1;
            fake.arrives(millis, shot);
            millis += pause;
        }
        let mut frames = 0;
        let mut last = None;
        for _ in 0..400 {
            match stream.next(WAIT) {
                Ok(Next::Picture(taken)) => {
                    prop_assert!(last.is_none_or(|last| last < taken.sequence));
                    prop_assert_eq!(taken.data.len(), 8);
                    last = Some(taken.sequence);
                    frames += 1;
                }
                Ok(_) => {}
                Err(error) => {
                    prop_assert!(matches!(error, DeviceError::Silent { .. }), "{}", error);
                    break;
                }
            }
        }
        let counted = stream.counters;
        let missed = u64::from(fake.lock().lost);
        prop_assert_eq!(
            frames + counted.superseded + counted.damaged + missed,
            faults.len() as u64
        );
        prop_assert!(counted.lost >= gaps.saturating_sub(missed) && counted.lost <= gaps + missed);
        prop_assert_eq!(fake.lock().free.len(), 4);
    }
}
