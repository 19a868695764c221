#![allow(clippy::unwrap_used, clippy::panic)]
use super::*;
use crate::calibration::intrinsics::Grey;
use crate::calibration::intrinsics::drawn::Random;
use crate::picture::Picture;
use std::path::{Path, PathBuf};

/// A hand that turns a rig to and fro, at seconds.
fn hand(t: f64) -> DQuat {
    let swing = DVec3::new(
        0.25 * (2.9 * t).sin() + 0.1 * (5.3 * t + 1.0).sin(),
        0.3 * (2.1 * t + 0.5).sin() + 0.08 * (6.1 * t).sin(),
        0.15 * (1.3 * t).sin(),
    );
    DQuat::from_scaled_axis(swing)
}

const OFFSET: f64 = 0.0235;

fn track(rate: f64, seconds: f64, noise: f64, random: &mut Random) -> TrackerTrack {
    let readings = (0..(rate * seconds) as i32).map(|i| {
        let t = f64::from(i) / rate;
        let shaken = DQuat::from_scaled_axis(random.normal3() * noise) * hand(t - OFFSET);
        (t, shaken)
    });
    TrackerTrack::new(readings.collect::<Vec<_>>(), 0.02)
}

fn turns(seconds: f64, noise: f64, random: &mut Random) -> Vec<CameraTurn> {
    let mount = DQuat::from_euler(glam::EulerRot::XYZ, 1.2, -0.4, 2.0);
    let stamps: Vec<f64> = (0..(30.0 * seconds) as i32)
        .map(|i| 0.011 + f64::from(i) / 30.0)
        .collect();
    let seen: Vec<DQuat> = stamps
        .iter()
        .map(|t| hand(*t) * mount * DQuat::from_scaled_axis(random.normal3() * noise))
        .collect();
    (1..seen.len())
        .map(|i| CameraTurn {
            from: stamps[i - 1],
            to: stamps[i],
            rotation: seen[i - 1].inverse() * seen[i],
        })
        .collect()
}

#[test]
fn rotations_tell_the_offset_to_a_fraction_of_a_millisecond() {
    let mut random = Random::new(1);
    for rate in [60.0, 120.0, 240.0] {
        for _ in 0..4 {
            let found = from_rotations(
                &track(rate, 20.0, 0.0026, &mut random),
                &turns(20.0, 0.0017, &mut random),
                0.25,
            )
            .unwrap();
            let off = found.seconds - OFFSET;
            assert!(
                off.abs() < 0.002 && off.abs() < 4.0 * found.sigma,
                "{rate}: {off} {found:?}"
            );
            assert!(found.sigma < 0.001 && found.correlation > 0.95, "{found:?}");
        }
    }
}

#[test]
fn amounts_of_motion_tell_it_to_two_milliseconds() {
    let mut random = Random::new(2);
    for _ in 0..5 {
        let motions: Vec<CameraMotion> = turns(30.0, 0.0, &mut random)
            .iter()
            .map(|t| {
                let amount = 700.0 * shortest(t.rotation).to_scaled_axis().length();
                let blurred = (amount * random.between(0.85, 1.15) + 0.8 * random.normal()).abs();
                CameraMotion {
                    from: t.from,
                    to: t.to,
                    amount: blurred,
                }
            })
            .collect();
        let found = from_motion(&track(120.0, 30.0, 0.0026, &mut random), &motions, 0.25).unwrap();
        let off = found.seconds - OFFSET;
        assert!(
            off.abs() < 0.002 && off.abs() < 4.0 * found.sigma,
            "{off} {found:?}"
        );
    }
}

#[test]
fn what_does_not_tell_is_refused() {
    let mut random = Random::new(3);
    let good = track(120.0, 20.0, 0.0026, &mut random);
    let seen = turns(20.0, 0.0017, &mut random);
    assert!(matches!(
        from_rotations(&good, &seen[..10], 0.25),
        Err(LatencyError::TooShort { .. })
    ));
    // At rest.
    let still = TrackerTrack::new(
        (0..2400)
            .map(|i| {
                (
                    f64::from(i) / 120.0,
                    DQuat::from_scaled_axis(random.normal3() * 0.0026),
                )
            })
            .collect::<Vec<_>>(),
        0.02,
    );
    assert!(matches!(
        from_rotations(&still, &seen, 0.25),
        Err(LatencyError::NotAlike { .. })
    ));
    // Another rig's pictures, and clocks that differ by more than is tried.
    let late: Vec<CameraTurn> = seen
        .iter()
        .map(|t| CameraTurn {
            from: t.from + 0.6,
            to: t.to + 0.6,
            ..*t
        })
        .collect();
    assert!(from_rotations(&good, &late, 0.25).is_err());
    // A pendulum looks the same after each swing.
    let swing = |t: f64| DQuat::from_rotation_x(0.3 * (18.0 * t).sin());
    let pendulum = TrackerTrack::new(
        (0..2400)
            .map(|i| (f64::from(i) / 120.0, swing(f64::from(i) / 120.0)))
            .collect::<Vec<_>>(),
        0.0,
    );
    let seen: Vec<CameraTurn> = (12..580)
        .map(|i| {
            let (from, to) = (f64::from(i) / 30.0, f64::from(i + 1) / 30.0);
            CameraTurn {
                from,
                to,
                rotation: swing(from).inverse() * swing(to),
            }
        })
        .collect();
    assert!(
        matches!(
            from_rotations(&pendulum, &seen, 0.5),
            Err(LatencyError::Ambiguous { .. })
        ),
        "{:?}",
        from_rotations(&pendulum, &seen, 0.5)
    );
}

#[test]
fn a_shifted_picture_has_moved_by_its_shift() {
    let texture = |x: f64, y: f64| {
        120.0
            + 20.0 * (0.21 * x).sin() * (0.17 * y).cos()
            + 40.0 * (0.043 * x + 0.061 * y).sin()
            + 40.0 * (0.037 * x - 0.029 * y).cos()
    };
    let picture = |dx: f64, dy: f64| {
        let data = (0..320 * 240)
            .map(|i| texture(f64::from(i % 320) - dx, f64::from(i / 320) - dy) as f32)
            .collect();
        Grey {
            width: 320,
            height: 240,
            data,
        }
    };
    let mut motion = ImageMotion::default();
    assert_eq!(motion.next(&picture(0.0, 0.0)), None);
    for (at, before, length) in [
        ((3.0, 4.0), (0.0, 0.0), 5.0_f64),
        ((3.5, 4.0), (3.0, 4.0), 0.5),
        ((20.0, -6.0), (3.5, 4.0), 19.3),
    ] {
        let found = motion.next(&picture(at.0, at.1)).unwrap();
        assert!(
            (found - length).abs() < 0.15,
            "{at:?} from {before:?}: {found}"
        );
    }
    assert_eq!(motion.next(&Grey::from_bytes(320, 240, &[])), None);
    assert_eq!(motion.next(&Grey::from_bytes(64, 64, &[])), None);
}

/// A small camera with noise that turns as the hand does, in a room of soft spots.
#[test]
fn drawn_pictures_and_a_tracker_tell_the_offset_to_two_milliseconds() {
    let mut random = Random::new(4);
    let spots: Vec<(DVec3, f64)> = (0..60)
        .map(|_| (random.normal3() * 9.0, random.between(0.0, 6.0)))
        .collect();
    let brightness = |ray: DVec3| {
        spots
            .iter()
            .map(|(k, phase)| (k.dot(ray) + phase).sin())
            .sum::<f64>()
    };
    let rays: Vec<DVec3> = (0..96 * 72)
        .map(|i| {
            DVec3::new(
                (f64::from(i % 96) - 47.5) / 85.0,
                (f64::from(i / 96) - 35.5) / 85.0,
                1.0,
            )
            .normalize()
        })
        .collect();
    let mut motion = ImageMotion::default();
    let (mut flows, mut before) = (Vec::new(), None);
    for i in 0..450 {
        let at = 0.3 + f64::from(i) / 30.0;
        let data = rays
            .iter()
            .map(|r| (128.0 + 12.0 * brightness(hand(at) * *r) + 2.0 * random.normal()) as f32);
        let picture = Grey {
            width: 96,
            height: 72,
            data: data.collect(),
        };
        if let (Some(from), Some(amount)) = (before, motion.next(&picture)) {
            flows.push(CameraMotion {
                from,
                to: at,
                amount,
            });
        }
        before = Some(at);
    }
    let found = from_motion(&track(120.0, 16.0, 0.0026, &mut random), &flows, 0.2).unwrap();
    assert!((found.seconds - OFFSET).abs() < 0.002, "{found:?}");
}

/// A table's rows of numbers, without its head; words count as NaN.
fn table(path: PathBuf) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines()
        .skip(1)
        .map(|l| {
            l.split(',')
                .map(|c| c.parse().unwrap_or(f64::NAN))
                .collect()
        })
        .collect()
}

/// A session whose tracker is late by 8 ms and whose pictures are in time; the poses of its
/// pictures stand for those that markers would give.
#[test]
fn the_truth_rigs_latency_is_found() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/truth/desk");
    if !folder.is_dir() {
        eprintln!("skipped: no ../shared/truth");
        return;
    }
    let seconds = |nanos: f64| (nanos - 1e12) * 1e-9;
    let poses = |name: &str| -> Vec<(f64, DQuat)> {
        let quaternion = |r: &[f64]| DQuat::from_xyzw(r[5], r[6], r[7], r[4]).normalize();
        let rows = table(folder.join(name));
        rows.iter()
            .map(|r| (seconds(r[0]), quaternion(r)))
            .collect()
    };
    let rig = std::fs::read(folder.join("rig.json")).unwrap();
    let rig: serde_json::Value = serde_json::from_slice(&rig).unwrap();
    let said = rig["tracker"]["latency_s"].as_f64().unwrap();
    let truth = TrackerTrack::new(poses("camera_truth.csv"), 0.0);
    let stamps: Vec<f64> = table(folder.join("scene_timestamps.csv"))
        .iter()
        .map(|row| seconds(row[2]))
        .collect();
    let turns: Vec<CameraTurn> = stamps
        .windows(2)
        .map(|w| CameraTurn {
            from: w[0],
            to: w[1],
            rotation: truth.at(w[0]).unwrap().inverse() * truth.at(w[1]).unwrap(),
        })
        .collect();
    let track = TrackerTrack::new(poses("tracker.csv"), 0.02);
    let found = from_rotations(&track, &turns, 0.1).unwrap();
    assert!((found.seconds - said).abs() < 0.002, "{found:?}, {said}");
}

/// The same camera circles its subject, so that the picture hardly moves when it turns.
#[test]
fn a_flow_that_is_not_the_turn_is_refused() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/truth/desk");
    if !folder.is_dir() {
        eprintln!("skipped: no ../shared/truth");
        return;
    }
    let seconds = |nanos: f64| (nanos - 1e12) * 1e-9;
    let readings = table(folder.join("tracker.csv"));
    let quaternion = |r: &[f64]| DQuat::from_xyzw(r[5], r[6], r[7], r[4]).normalize();
    let track = TrackerTrack::new(
        readings.iter().map(|r| (seconds(r[0]), quaternion(r))),
        0.02,
    );
    let mut motion = ImageMotion::default();
    let (mut flows, mut before) = (Vec::new(), None);
    for row in table(folder.join("scene_timestamps.csv")) {
        let file = folder.join(format!("scene/{:05}.jpg", row[0] as u32));
        let picture = Picture::from_file_bytes(&std::fs::read(file).unwrap()).unwrap();
        let moved = motion.next(&Grey::from_picture(&picture));
        let to = seconds(row[2]);
        if let (Some(from), Some(amount)) = (before, moved) {
            flows.push(CameraMotion { from, to, amount });
        }
        before = Some(to);
    }
    assert!(flows.len() > 50, "{}", flows.len());
    assert!(from_motion(&track, &flows, 0.1).is_err());
}
