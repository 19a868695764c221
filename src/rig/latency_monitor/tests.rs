use super::*;
use glam::DVec3;

fn picture(width: u32, height: u32, value: impl Fn(u32, u32) -> u8) -> Picture {
    let pixel = |i: u32| {
        let grey = value(i % width, i / width);
        [grey, grey, grey, 255]
    };
    Picture {
        width,
        height,
        rgba: (0..width * height).flat_map(pixel).collect(),
    }
}

#[test]
fn shrink_averages_cells_and_keeps_small_pictures() {
    let mut small = empty_grey();
    shrink(&picture(640, 480, |x, y| (x / 4 + y / 4) as u8), &mut small);
    assert_eq!((small.width, small.height), (160, 120));
    assert_eq!(small.data.len(), 160 * 120);
    let error = |x: usize, y: usize| small.data[y * 160 + x] - (x + y) as f32;
    assert!(error(0, 0).abs() < 1e-3 && error(120, 100).abs() < 1e-3);
    // The size is not a multiple of the cell: the remainder is omitted.
    shrink(&picture(1921, 1083, |_, _| 77), &mut small);
    assert_eq!((small.width, small.height), (147, 83));
    assert!(small.data.iter().all(|v| (v - 77.0).abs() < 1e-3));
    shrink(&picture(7, 5, |x, _| x as u8), &mut small);
    assert_eq!((small.width, small.height), (7, 5));
    shrink(&Picture::default(), &mut small);
    assert!(small.data.is_empty());
}

fn hand_rotation(t: f64) -> DQuat {
    let swing = DVec3::new(
        0.25 * (2.9 * t).sin() + 0.1 * (5.3 * t + 1.0).sin(),
        0.3 * (2.1 * t + 0.5).sin() + 0.08 * (6.1 * t).sin(),
        0.15 * (1.3 * t).sin(),
    );
    DQuat::from_scaled_axis(swing)
}

fn measure(mut monitor: LatencyMonitor) -> (LatencyMonitor, OffsetState) {
    let stamp = |t: f64| MonotonicTime::from_nanos((t * 1e9) as i64);
    for i in 0..12 * 60 {
        let t = f64::from(i) / 60.0;
        monitor.reading(&PoseSample {
            station: 2,
            transmitter_from_sensor: RigidTransform::new(hand_rotation(t), DVec3::ZERO),
            arrived_at: stamp(t + 0.035),
            error: None,
        });
        if i % 4 == 0 {
            let pose = RigidTransform::new(hand_rotation(t), DVec3::X);
            monitor.picture(stamp(t), &Picture::default(), Some(pose));
        }
    }
    let known = monitor.finish();
    (monitor, known)
}

fn monitor(mode: Mode, apply: bool) -> LatencyMonitor {
    LatencyMonitor {
        station: Some(2),
        apply,
        mode,
        requested: None,
        last_picture: None,
    }
}

#[test]
fn both_modes_measure_the_same_latency_and_only_apply_requests_it() {
    let monitor_thread =
        || Mode::MonitorThread(MonitorThread::start(Measurement::default(), true).unwrap());
    let (reported, by_thread) = measure(monitor(monitor_thread(), false));
    let (applied, inline) = measure(monitor(Mode::SameThread(Box::default()), true));
    assert_eq!(by_thread, inline);
    let measured = inline.offset.unwrap();
    assert!((measured.seconds - 0.035).abs() < 5e-4, "{measured:?}");
    assert_eq!(reported.requested_latency(), None);
    let requested = applied.requested_latency().unwrap();
    assert!((requested - 35_000_000).abs() < 500_000, "{requested}");
    // Readings of another station are ignored.
    let mut other = monitor(monitor_thread(), true);
    other.station = Some(1);
    assert_eq!(measure(other).1.offset, None);
}

#[test]
fn live_monitor_drops_pictures_while_its_thread_is_busy() {
    let mut live = monitor(
        Mode::MonitorThread(MonitorThread::start(Measurement::default(), false).unwrap()),
        false,
    );
    let textured = picture(160, 120, |x, y| (x * 7 + y * 13) as u8);
    for i in 0..200 {
        let at = MonotonicTime::from_nanos(i * 70_000_000);
        live.picture(at, &textured, None);
    }
    // The thread ends although messages are pending.
    drop(live);
}
