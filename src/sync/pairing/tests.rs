//! Waiting, faulty streams, and the error on recordings with
//! ground truth.
use super::*;
use bytes::Bytes;
use glam::{DMat4, DQuat, DVec3};
use penumbra_interface::{PixelFormat, RigidTransform};
use proptest::prelude::*;

const MILLI: i64 = 1_000_000;

fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(millis * MILLI)
}

fn picture(captured: i64, arrived: i64, bracket_ev: f64) -> Frame {
    Frame {
        data: Bytes::new(),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence: 0,
        captured_at: at(captured),
        arrived_at: at(arrived),
        exposure: None,
        bracket_ev,
        controls: None,
    }
}

/// Uniform motion, 1 m/s along X.
fn reading(arrived: i64) -> PoseSample {
    PoseSample {
        station: 1,
        transmitter_from_sensor: RigidTransform::new(
            DQuat::IDENTITY,
            DVec3::X * arrived as f64 * 1e-3,
        ),
        arrived_at: at(arrived),
        error: None,
    }
}

fn pairing(change: impl FnOnce(&mut PairingConfig)) -> Pairing {
    let mut config = PairingConfig::default();
    change(&mut config);
    Pairing::new(config)
}

#[test]
fn picture_waits_for_readings_around_its_exposure() {
    let mut pairing = pairing(|config| config.tracker_latency_nanos = 8 * MILLI);
    for millis in (0..=100).step_by(8) {
        pairing.push_pose(&reading(millis));
    }
    pairing.push_scene(picture(100, 100, 0.0));
    assert!(pairing.pop().is_none(), "readings reach 88 ms only");
    pairing.push_pose(&reading(104));
    assert!(pairing.pop().is_none(), "measured at 96 ms");
    pairing.push_pose(&reading(112));
    let frame = pairing.pop().unwrap();
    let pose = frame.pose.unwrap();
    assert_eq!(
        (pose.provenance, pose.age_nanos),
        (Provenance::Interpolated, 4 * MILLI)
    );
    // The reading that arrived at 108 ms was measured at 100 ms.
    assert!((pose.transmitter_from_sensor.translation.x - 0.108).abs() < 1e-9);
    assert_eq!(pairing.counts().predicted, 0);
}

#[test]
fn picture_waits_no_longer_than_the_maximum() {
    let mut pairing = pairing(|config| config.max_wait_nanos = 50 * MILLI);
    for millis in 0..100 {
        pairing.push_pose(&reading(millis));
    }
    pairing.push_scene(picture(120, 120, 0.0));
    pairing.push_environment(picture(165, 165, 0.0));
    assert!(pairing.pop().is_none());
    pairing.push_environment(picture(170, 170, 0.0));
    let frame = pairing.pop().unwrap();
    assert_eq!(frame.pose.unwrap().provenance, Provenance::Predicted);
    assert!((frame.pose.unwrap().transmitter_from_sensor.translation.x - 0.120).abs() < 1e-9);
    assert_eq!(pairing.counts().waited_out, 1);
}

#[test]
fn silent_tracker_is_not_awaited() {
    let mut pairing = pairing(|_| {});
    pairing.push_pose(&reading(0));
    let mut waits = Vec::new();
    for i in 1..20 {
        pairing.push_scene(picture(33 * i, 33 * i, 0.0));
        waits.push(std::iter::from_fn(|| pairing.pop()).count());
    }
    // Before 250 ms of silence a picture waits 50 ms, the time of two pictures.
    assert_eq!(waits[..7], [0, 0, 1, 1, 1, 1, 1]);
    assert_eq!(waits[7], 3, "at 264 ms all that wait are handed on");
    assert!(waits[8..].iter().all(|popped| *popped == 1));
    assert_eq!(pairing.counts().paired, 19);
    assert!(pairing.counts().without_pose >= 15);
}

#[test]
fn nothing_waits_without_a_tracker() {
    let mut pairing = pairing(|config| config.station = None);
    pairing.push_scene(picture(10, 10, 0.0));
    assert!(pairing.pop().unwrap().pose.is_none());
}

#[test]
fn stopped_stream_does_not_stop_pictures() {
    let mut pairing = pairing(|_| {});
    for i in 0..40 {
        pairing.push_scene(picture(10 + i, 10, 0.0));
    }
    // The time does not advance, yet no more than sixteen pictures wait.
    let popped = std::iter::from_fn(|| pairing.pop()).count();
    assert_eq!(popped, 40 - MAX_WAITING);
    pairing.finish();
    assert_eq!(std::iter::from_fn(|| pairing.pop()).count(), MAX_WAITING);
}

#[test]
fn pairs_newest_complete_earlier_view() {
    let mut pairing = pairing(|config| {
        config.station = None;
        config.brackets = 1;
        config.environment_latency_nanos = 5 * MILLI;
    });
    for (captured, ev) in [(100, 0.0), (100, -4.0), (167, 0.0)] {
        pairing.push_environment(picture(captured + 5, captured + 6, ev));
    }
    let mut generation_at = |captured: i64, arrived: i64| {
        pairing.push_scene(picture(captured, arrived, 0.0));
        let environment = pairing.pop().unwrap().environment;
        environment.map(|e| (e.set.generation, e.skew_nanos / MILLI, e.set.frames.len()))
    };
    assert_eq!(generation_at(99, 173), None, "before the first view");
    assert_eq!(generation_at(100, 173), Some((1, 0, 2)));
    assert_eq!(generation_at(166, 173), Some((1, 66, 2)));
    assert_eq!(
        generation_at(170, 174),
        Some((1, 70, 2)),
        "the second lacks its bracket"
    );
    assert_eq!(
        generation_at(670, 680),
        Some((2, 503, 1)),
        "which never came"
    );
}

#[test]
fn first_pictures_wait_for_the_first_view() {
    let mut pairing = pairing(|config| {
        config.station = None;
        config.brackets = 1;
        config.first_view_wait_nanos = 100 * MILLI;
    });
    pairing.push_scene(picture(0, 0, 0.0));
    pairing.push_scene(picture(33, 33, 0.0));
    pairing.push_environment(picture(40, 41, 0.0));
    assert!(pairing.pop().is_none(), "the first view lacks its bracket");
    pairing.push_environment(picture(40, 42, -4.0));
    let mut skew = || {
        pairing
            .pop()
            .map(|f| f.environment.unwrap().skew_nanos / MILLI)
    };
    assert_eq!([skew(), skew(), skew()], [Some(-40), Some(-7), None]);
    assert_eq!(pairing.counts().before_first_view, 2);
    // Afterwards no view is later than its picture.
    pairing.push_environment(picture(100, 110, 0.0));
    pairing.push_scene(picture(99, 111, 0.0));
    let later = pairing.pop().unwrap().environment.unwrap();
    assert_eq!((later.set.generation, later.skew_nanos), (1, 59 * MILLI));
}

#[test]
fn first_pictures_time_out() {
    let mut pairing = pairing(|config| {
        config.station = None;
        config.first_view_wait_nanos = 100 * MILLI;
    });
    pairing.push_scene(picture(0, 0, 0.0));
    pairing.advance(at(99));
    assert!(pairing.pop().is_none());
    pairing.advance(at(100));
    assert!(pairing.pop().unwrap().environment.is_none());
}

#[test]
fn bracket_joins_its_view_once() {
    let mut pairing = pairing(|config| {
        config.station = None;
        config.brackets = 2;
    });
    pairing.push_environment(picture(0, 0, -4.0));
    for (captured, ev) in [(10, 0.0), (11, -4.0), (12, -8.0), (13, -8.0), (900, -4.0)] {
        pairing.push_environment(picture(captured, captured, ev));
    }
    pairing.push_scene(picture(900, 900, 0.0));
    let set = pairing.pop().unwrap().environment.unwrap().set;
    let evs: Vec<_> = set.frames.iter().map(|frame| frame.bracket_ev).collect();
    assert_eq!(evs, [0.0, -4.0, -8.0]);
    assert_eq!(pairing.counts().orphan_brackets, 3);
    assert_eq!(pairing.counts().incomplete_sets, 0);
}

#[test]
fn jump_back_in_time_restarts_without_losing_pictures() {
    let mut pairing = pairing(|_| {});
    for millis in (2000..3000).step_by(8) {
        pairing.push_pose(&reading(millis));
    }
    pairing.push_environment(picture(2900, 2990, 0.0));
    pairing.push_scene(picture(2999, 2999, 0.0));
    pairing.push_scene(picture(1000, 1000, 0.0));
    let frame = pairing.pop().unwrap();
    assert!(frame.pose.is_some() && frame.environment.is_some());
    assert!(
        pairing.pop().is_none(),
        "waits for readings of its own time"
    );
    pairing.push_pose(&reading(996));
    pairing.push_pose(&reading(1004));
    let frame = pairing.pop().unwrap();
    assert_eq!(frame.pose.unwrap().provenance, Provenance::Interpolated);
    assert!(frame.environment.is_none());
    assert_eq!(pairing.counts().time_jumps, 1);
}

#[test]
fn follows_environment_camera_whose_stamps_jump_back() {
    let mut pairing = pairing(|config| config.station = None);
    for i in 0..20 {
        pairing.push_environment(picture(100_000 + i, 100_000 + i, 0.0));
    }
    pairing.push_environment(picture(500, 100_100, 0.0));
    pairing.push_scene(picture(100_110, 100_110, 0.0));
    let environment = pairing.pop().unwrap().environment.unwrap();
    assert_eq!(environment.set.captured_at, at(500));
}

#[derive(Clone, Debug)]
enum Event {
    Scene(i64),
    Environment(i64, f64),
    Pose(f64),
    Advance,
}

fn any_event() -> impl Strategy<Value = Event> {
    prop_oneof![
        (-50..100_i64).prop_map(Event::Scene),
        (-50..100_i64, prop::sample::select(vec![0.0, -4.0]))
            .prop_map(|(l, ev)| Event::Environment(l, ev)),
        prop_oneof![-1.0..1.0_f64, Just(f64::NAN), Just(1e30)].prop_map(Event::Pose),
        Just(Event::Advance),
    ]
}

proptest! {
    #[test]
    fn no_picture_is_lost_or_paired_with_a_later_view(
        events in prop::collection::vec((any_event(), -20..60_i64), 0..120),
        jump in prop::option::of(0..120_usize),
    ) {
        let mut pairing = pairing(|config| config.brackets = 1);
        let mut now = 10_000;
        let (mut pushed, mut popped) = (0, Vec::new());
        for (i, (event, step)) in events.into_iter().enumerate() {
            now += if jump == Some(i) { -5_000 } else { step };
            match event {
                Event::Scene(latency) => {
                    pairing.push_scene(picture(now - latency, now, 0.0));
                    pushed += 1;
                }
                Event::Environment(latency, ev) => {
                    pairing.push_environment(picture(now - latency, now, ev));
                }
                Event::Pose(x) => {
                    let mut sample = reading(now);
                    sample.transmitter_from_sensor.translation.y = x;
                    pairing.push_pose(&sample);
                }
                Event::Advance => pairing.advance(at(now)),
            }
            popped.extend(std::iter::from_fn(|| pairing.pop()));
            prop_assert!(pushed - popped.len() <= MAX_WAITING);
        }
        pairing.finish();
        popped.extend(std::iter::from_fn(|| pairing.pop()));
        prop_assert_eq!(popped.len(), pushed);
        for (i, frame) in popped.iter().enumerate() {
            prop_assert_eq!(frame.index, i as u64);
            if let Some(environment) = &frame.environment {
                prop_assert!(environment.skew_nanos >= 0);
                prop_assert!(environment.set.captured_at <= frame.captured_at);
            }
            if let Some(pose) = frame.pose {
                prop_assert!(pose.age_nanos >= 0);
                prop_assert!(pose.transmitter_from_sensor.translation.is_finite());
            }
        }
        prop_assert_eq!(pairing.counts().paired, pushed as u64);
    }

    #[test]
    fn streams_in_order_give_pairs_in_order(
        scene in prop::collection::vec(1..60_i64, 1..40),
        environment in prop::collection::vec(1..120_i64, 1..40),
        poses in prop::collection::vec(1..30_i64, 1..100),
    ) {
        let times = |steps: &[i64], kind: u8| -> Vec<(i64, u8)> {
            steps.iter().scan(1000, |t, step| { *t += step; Some((*t, kind)) }).collect()
        };
        let mut arrivals = [times(&scene, 0), times(&environment, 1), times(&poses, 2)].concat();
        arrivals.sort_unstable();
        let mut pairing = pairing(|_| {});
        let mut popped = Vec::new();
        for (millis, kind) in arrivals {
            match kind {
                0 => pairing.push_scene(picture(millis, millis, 0.0)),
                1 => pairing.push_environment(picture(millis, millis, 0.0)),
                _ => pairing.push_pose(&reading(millis)),
            }
            popped.extend(std::iter::from_fn(|| pairing.pop()));
        }
        pairing.finish();
        popped.extend(std::iter::from_fn(|| pairing.pop()));
        let generations = popped.iter().map(|f| f.environment.as_ref().map(|e| e.set.generation));
        prop_assert!(generations.is_sorted());
        prop_assert!(popped.iter().is_sorted_by_key(|frame| frame.captured_at));
        for frame in &popped {
            // A single reading gives no motion.
            let interpolated = |pose: &PoseAt| pose.provenance != Provenance::Predicted;
            if let Some(pose) = frame.pose.filter(interpolated) {
                let x = frame.captured_at.as_nanos() as f64 * 1e-9;
                prop_assert!((pose.transmitter_from_sensor.translation.x - x).abs() < 1e-6);
            }
        }
    }
}

mod truth;

#[test]
fn deadline_is_the_end_of_the_wait_without_arrivals() {
    let mut pairing = pairing(|config| config.max_wait_nanos = 50 * MILLI);
    assert_eq!(pairing.deadline(), None);
    pairing.push_pose(&reading(0));
    pairing.push_scene(picture(10, 10, 0.0));
    let deadline = pairing.deadline().unwrap();
    assert_eq!(deadline, at(60));
    pairing.advance(deadline.offset_nanos(-1));
    assert!(pairing.pop().is_none());
    pairing.advance(deadline);
    assert_eq!(pairing.pop().unwrap().index, 0);
    pairing.skip_scene(at(70));
    pairing.push_scene(picture(100, 100, 0.0));
    pairing.push_pose(&reading(120));
    let due = pairing.deadline().unwrap();
    assert!(due <= at(120), "it need not wait at all");
    assert_eq!(pairing.pop().unwrap().index, 2, "one was passed over");
}

#[test]
fn latency_approaches_its_target_by_a_millisecond_per_second() {
    let mut pairing = pairing(|config| config.tracker_latency_nanos = 20 * MILLI);
    pairing.push_pose(&reading(0));
    pairing.set_target_latency(5 * MILLI);
    let mut last = None;
    for millis in (8..=30_000).step_by(8) {
        let before = pairing.tracker_latency();
        pairing.push_pose(&reading(millis));
        let moved = before - pairing.tracker_latency();
        assert!((0..=8_000).contains(&moved), "{moved}");
        if millis == 10_000 {
            last = Some(pairing.tracker_latency());
        }
    }
    assert!((last.unwrap() - 10 * MILLI).abs() < 10_000, "{last:?}");
    assert_eq!(pairing.tracker_latency(), 5 * MILLI);
    assert_eq!(pairing.counts().rejected_poses, 0);
    // It does not jump after a silence.
    pairing.set_target_latency(15 * MILLI);
    pairing.push_pose(&reading(90_000));
    assert!(pairing.tracker_latency() < 6 * MILLI);
}

#[test]
fn wrong_station_is_named_with_those_that_were_seen() {
    let mut pairing = pairing(|config| config.station = Some(2));
    for millis in (0..800).step_by(8) {
        assert!(
            pairing.counts().other_stations >= 30 || pairing.counts().wrong_station().is_none()
        );
        pairing.push_pose(&reading(millis));
    }
    let problem = pairing.counts().wrong_station().unwrap();
    assert!(
        problem.contains("no reading of station 2 among 100; stations seen: 1;"),
        "{problem}"
    );
    let own = PoseSample {
        station: 2,
        ..reading(800)
    };
    pairing.push_pose(&own);
    assert_eq!(pairing.counts().wrong_station(), None);
}
