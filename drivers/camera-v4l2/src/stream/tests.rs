use super::*;
use crate::testing::{FakeDevice, FakeFrame};
use proptest::prelude::*;

const WAIT: Duration = Duration::from_millis(100);

fn stream(fake: &FakeDevice) -> Stream<FakeDevice> {
    let layout = FrameLayout::of(&fake.lock().format).unwrap();
    let buffering = (4, Duration::from_millis(500));
    Stream::start(fake.clone(), "/dev/video7", layout, buffering, fake.clock()).unwrap()
}

fn grey() -> FakeDevice {
    FakeDevice::streaming(b"GREY", 4, 2)
}

fn next_frame(stream: &mut Stream<FakeDevice>) -> Option<StreamFrame> {
    match stream.next(WAIT).unwrap() {
        StreamItem::Frame(frame) => Some(frame),
        _ => None,
    }
}

fn frame(sequence: u32) -> FakeFrame {
    FakeFrame::new(sequence, vec![sequence as u8; 8])
}

#[test]
fn the_newest_frame_is_returned_and_all_buffers_are_requeued() {
    let fake = grey();
    let mut stream = stream(&fake);
    for n in 0..3 {
        fake.arrives(10, frame(n));
    }
    let newest = next_frame(&mut stream).unwrap();
    assert_eq!((newest.sequence, &newest.data[..]), (2, &[2; 8][..]));
    assert_eq!(stream.counters.superseded, 2);
    assert_eq!(fake.lock().free.len(), 4);
    assert!(next_frame(&mut stream).is_none());
}

#[test]
fn a_frame_has_the_drivers_time_stamp_and_its_time_of_arrival() {
    let fake = grey();
    let mut stream = stream(&fake);
    fake.arrives(50, frame(0));
    let frame = next_frame(&mut stream).unwrap();
    assert_eq!(frame.timestamp, MonotonicTime::from_nanos(30_000_000));
    assert_eq!(frame.timestamp_source, StampSource::StartOfExposure);
    assert_eq!(frame.arrived_at, MonotonicTime::from_nanos(50_000_000));
}

#[test]
fn only_the_bytes_used_are_read() {
    let fake = FakeDevice::streaming(b"MJPG", 4, 2);
    let mut stream = stream(&fake);
    let mut padded = FakeFrame::new(0, vec![0xAA; 4000]);
    let jpeg = [
        0xFF, 0xD8, 0xFF, 0xC4, 0, 2, 0xFF, 0xDA, 0, 2, 1, 2, 3, 0xFF, 0xD9,
    ];
    padded.data[..jpeg.len()].copy_from_slice(&jpeg);
    padded.bytes_used = 3000;
    fake.arrives(10, padded);
    assert_eq!(&next_frame(&mut stream).unwrap().data[..], &jpeg);
}

#[test]
fn damaged_frames_are_counted_and_skipped() {
    let fake = grey();
    let mut stream = stream(&fake);
    let mut flagged = frame(0);
    flagged.flags |= Flags::ERROR;
    let mut empty = frame(1);
    empty.bytes_used = 0;
    let mut short = frame(2);
    short.bytes_used = 7;
    for (millis, bad) in [(10, flagged), (20, empty), (30, short)] {
        fake.arrives(millis, bad);
    }
    fake.arrives(40, frame(3));
    assert_eq!(next_frame(&mut stream).unwrap().sequence, 3);
    assert_eq!(stream.counters.damaged, 3);
    assert_eq!(stream.counters.lost, 0, "they have arrived");
    assert_eq!(fake.lock().free.len(), 4);
}

#[test]
fn a_jpeg_without_end_marker_is_damaged_if_the_camera_sends_end_markers() {
    let fake = FakeDevice::streaming(b"MJPG", 4, 2);
    let mut stream = stream(&fake);
    let whole = vec![
        0xFF, 0xD8, 0xFF, 0xC4, 0, 2, 0xFF, 0xDA, 0, 2, 1, 0xFF, 0xD9,
    ];
    let cut = whole[..11].to_vec();
    fake.arrives(10, FakeFrame::new(0, cut.clone()));
    assert_eq!(
        next_frame(&mut stream).unwrap().data[..],
        whole[..],
        "the end marker was added"
    );
    assert_eq!(stream.without_end_marker, 1);
    fake.arrives(20, FakeFrame::new(1, whole.clone()));
    assert_eq!(next_frame(&mut stream).unwrap().data[..], whole[..]);
    fake.arrives(30, FakeFrame::new(2, cut));
    fake.arrives(30, FakeFrame::new(3, b"no jpeg at all".to_vec()));
    assert!(next_frame(&mut stream).is_none());
    assert_eq!(stream.counters.damaged, 2);
}

#[test]
fn gaps_in_the_frame_counter_are_lost_frames() {
    let fake = grey();
    let mut stream = stream(&fake);
    for (n, sequence) in [(1, 5), (2, 6), (3, 10), (4, 11)] {
        fake.arrives(n * 10, frame(sequence));
    }
    while next_frame(&mut stream).is_some() {}
    assert_eq!(stream.counters.lost, 3);
}

#[test]
fn interrupted_calls_are_repeated() {
    let fake = grey();
    let mut stream = stream(&fake);
    fake.lock().wait_errors.extend([Errno::INTR, Errno::INTR]);
    fake.lock().dequeue_errors.push_back(Errno::INTR);
    fake.arrives(10, frame(0));
    assert!(next_frame(&mut stream).is_some());
}

#[test]
fn a_time_out_is_an_error_once_the_camera_is_silent_for_too_long() {
    let fake = grey();
    let mut stream = stream(&fake);
    for _ in 0..4 {
        assert!(next_frame(&mut stream).is_none());
    }
    let error = stream.next(WAIT).unwrap_err();
    let DeviceError::Silent { device, millis } = &error else {
        panic!("{error}");
    };
    assert_eq!((device.as_str(), *millis), ("/dev/video7", 500));
    // The stream continues if the camera does: no buffer was queued twice.
    fake.arrives(520, frame(0));
    assert!(next_frame(&mut stream).is_some());
    assert!(next_frame(&mut stream).is_none());
}

#[test]
fn every_call_may_report_unplugging_or_a_broken_stream() {
    for (errno, gone) in [
        (Errno::NODEV, true),
        (Errno::IO, false),
        (Errno::INVAL, false),
    ] {
        for place in 0..3 {
            let fake = grey();
            let mut stream = stream(&fake);
            fake.arrives(10, frame(0));
            match place {
                0 => fake.lock().wait_errors.push_back(errno),
                1 => fake.lock().dequeue_errors.push_back(errno),
                _ => fake.lock().queue_error = Some(errno),
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
fn failing_to_stop_the_stream_does_not_panic() {
    for errno in [Errno::NODEV, Errno::IO, Errno::BUSY] {
        let fake = grey();
        let stream = stream(&fake);
        fake.lock().stop_error = Some(errno);
        drop(stream);
        assert_eq!(fake.lock().stops, 1);
    }
}

#[test]
fn wait_without_frames_ends_with_an_error() {
    for error in [false, true] {
        let fake = grey();
        let mut stream = stream(&fake);
        fake.lock().wait_reports_frame = !error;
        fake.lock().wait_reports_error = error;
        assert!(matches!(stream.next(WAIT), Err(DeviceError::Broken { .. })));
        assert!(fake.lock().waits <= MAX_EMPTY_WAKE_UPS);
    }
}

#[test]
fn a_failing_start_is_reported() {
    let fake = grey();
    fake.lock().start_error = Some(Errno::BUSY);
    let layout = FrameLayout::of(&fake.lock().format).unwrap();
    let started = Stream::start(fake.clone(), "/dev/video7", layout, (4, WAIT), fake.clock());
    assert!(matches!(started.err(), Some(DeviceError::Busy { .. })));
}

#[test]
fn padded_rows_have_a_stride() {
    let mut format = FakeDevice::streaming(b"NV12", 6, 4).lock().format;
    format.bytes_per_line = 8;
    let padded = FrameLayout::of(&format).unwrap();
    assert_eq!((padded.stride, padded.min_bytes), (8, 8 * 5 + 6));
    format.bytes_per_line = 0;
    let packed = FrameLayout::of(&format).unwrap();
    assert_eq!((packed.stride, packed.min_bytes), (0, 36));
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
    /// Every frame is returned, superseded, damaged or lost, and no buffer is lost.
    #[test]
    fn no_frame_and_no_buffer_is_lost(
        faults in proptest::collection::vec((any_fault(), 0..60_i64), 1..60)
    ) {
        let fake = grey();
        let mut stream = stream(&fake);
        let (mut sequence, mut millis, mut gaps) = (0, 1, 0);
        for (n, (fault, pause)) in faults.iter().enumerate() {
            let mut frame = frame(sequence);
            match fault {
                Fault::None => {}
                Fault::Flag => frame.flags |= Flags::ERROR,
                Fault::Empty => frame.bytes_used = 0,
                Fault::Short => frame.bytes_used = 3,
                Fault::Interrupt => fake.lock().dequeue_errors.push_back(Errno::INTR),
                Fault::Gap(gap) if n > 0 => {
                    frame.sequence += gap;
                    gaps += u64::from(*gap);
                }
                Fault::Gap(_) => {}
            }
            sequence = frame.sequence + 1;
            fake.arrives(millis, frame);
            millis += pause;
        }
        let mut frames = 0;
        let mut last = None;
        for _ in 0..400 {
            match stream.next(WAIT) {
                Ok(StreamItem::Frame(frame)) => {
                    prop_assert!(last.is_none_or(|last| last < frame.sequence));
                    prop_assert_eq!(frame.data.len(), 8);
                    last = Some(frame.sequence);
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
