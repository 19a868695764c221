use super::*;
use crate::intrinsics::Grey;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;
use penumbra_picture::Picture;
use std::path::PathBuf;

/// Orientation of a hand-held rig that is rotated back and forth, at a time in seconds.
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

fn camera_rotations(seconds: f64, noise: f64, random: &mut Random) -> Vec<CameraRotation> {
    let mount = DQuat::from_euler(glam::EulerRot::XYZ, 1.2, -0.4, 2.0);
    let stamps: Vec<f64> = (0..(30.0 * seconds) as i32)
        .map(|i| 0.011 + f64::from(i) / 30.0)
        .collect();
    let seen: Vec<DQuat> = stamps
        .iter()
        .map(|t| hand(*t) * mount * DQuat::from_scaled_axis(random.normal3() * noise))
        .collect();
    (1..seen.len())
        .map(|i| CameraRotation {
            from: stamps[i - 1],
            to: stamps[i],
            rotation: seen[i - 1].inverse() * seen[i],
        })
        .collect()
}

#[test]
fn rotations_determine_offset_within_two_milliseconds() {
    let mut random = Random::new(1);
    for rate in [60.0, 120.0, 240.0] {
        for _ in 0..4 {
            let found = from_rotations(
                &track(rate, 20.0, 0.0026, &mut random),
                &camera_rotations(20.0, 0.0017, &mut random),
                0.25,
            )
            .unwrap();
            let error = found.seconds - OFFSET;
            assert!(
                error.abs() < 0.002 && error.abs() < 4.0 * found.sigma,
                "{rate}: {error} {found:?}"
            );
            assert!(found.sigma < 0.001 && found.correlation > 0.95, "{found:?}");
        }
    }
}

/// Pose of a rig that orbits its subject at 0.7 m and rolls: the picture's centre hardly moves.
fn orbiting(t: f64) -> RigidTransform {
    let rotation = hand(t) * DQuat::from_rotation_z(0.2 * (3.7 * t).sin());
    RigidTransform::new(rotation, -(rotation * DVec3::Z * 0.7))
}

/// The flow of the orbiting rig's pictures.
fn flows(seconds: f64, rate: f64, random: &mut Random) -> Vec<CameraMotion> {
    let mut shaken = Random::new(8);
    (1..(rate * seconds) as i32)
        .map(|i| {
            let (from, to) = (0.011 + f64::from(i - 1) / rate, 0.011 + f64::from(i) / rate);
            let back = orbiting(from).inverse() * orbiting(to);
            let project = |p: DVec3| 700.0 * p.truncate() / p.z;
            let moved = |p: DVec3| project(back.inverse().transform_point(p)) - project(p);
            // Sloping ground.
            let depth = 0.7 + 0.6 * orbiting(from).translation.x;
            let at = |x: f64, y: f64| DVec3::new(x * depth, y * depth, depth);
            let (left, right) = (moved(at(-0.3, 0.0)), moved(at(0.3, 0.0)));
            let noise = DVec2::new(random.normal(), random.normal()) * 0.3;
            let patches = std::array::from_fn(|k| {
                let position =
                    DVec2::new((k % 6) as f64 + 0.5, (k / 6) as f64 + 0.5) / DVec2::new(6.0, 4.0);
                // Objects at several depths.
                let away = depth * [1.0, 0.6, 1.0, 3.0, 1.0][(k * 7 + 3 * i as usize) % 5];
                let direction = (position - 0.5) * DVec2::new(640.0, 480.0) / 700.0;
                let shift = moved((direction * away).extend(away));
                let noise = DVec2::new(shaken.normal(), shaken.normal()) * 0.3;
                (k % 4 != 3).then(|| Patch {
                    from: position,
                    to: position + (shift + noise) / DVec2::new(640.0, 480.0),
                })
            });
            CameraMotion {
                from,
                to,
                flow: Flow {
                    length: 1.0,
                    shift: moved(at(0.0, 0.0)) + noise,
                    growth: (right.x - left.x) / 420.0 + 5e-4 * random.normal(),
                    rotation: (right.y - left.y) / 420.0 + 5e-4 * random.normal(),
                    patches,
                },
            }
        })
        .collect()
}

fn camera_from_sensor() -> RigidTransform {
    RigidTransform::new(
        DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 2.0, -1.0),
        DVec3::new(0.04, 0.01, -0.06),
    )
}

/// Track of the orbiting rig's tracker, with an arbitrary mounting.
fn orbiting_track(seconds: f64, random: &mut Random) -> TrackerTrack {
    let sensor = camera_from_sensor();
    let readings = (0..(120.0 * seconds) as i32).map(|i| {
        let t = f64::from(i) / 120.0;
        let pose = orbiting(t - OFFSET) * sensor;
        let shaken = DQuat::from_scaled_axis(random.normal3() * 1e-3);
        let position = pose.translation + random.normal3() * 5e-4;
        (t, RigidTransform::new(shaken * pose.rotation, position))
    });
    TrackerTrack::from_poses(readings.collect::<Vec<_>>(), 0.02)
}

#[test]
fn flow_of_orbiting_camera_determines_offset_within_two_milliseconds() {
    let mut random = Random::new(2);
    for _ in 0..5 {
        let track = orbiting_track(20.0, &mut random);
        let mut flows = flows(20.0, 30.0, &mut random);
        // Pictures that jump, as by a hand in front of the camera.
        for i in [50, 51, 200, 333] {
            flows[i].flow.shift += DVec2::new(80.0, -30.0);
        }
        let found = from_flow(&track, &flows, 0.25).unwrap();
        let error = found.seconds - OFFSET;
        println!("error {:.2} ms, {found:?}", 1e3 * error);
        assert!(
            error.abs() < 0.002 && error.abs() < 4.0 * found.sigma,
            "{error} {found:?}"
        );
        assert!(found.sigma < 0.002, "{found:?}");
    }
}

fn mounted(error: DQuat) -> MountedCamera {
    let camera = PinholeCamera {
        width: 640,
        height: 480,
        focal: DVec2::splat(700.0),
        centre: DVec2::new(319.5, 239.5),
        distortion: [0.0; 5],
    };
    let turned = RigidTransform::new(error, DVec3::ZERO);
    MountedCamera::new(camera, camera_from_sensor().inverse() * turned)
}

#[test]
fn patches_determine_offset_with_known_mounting_and_are_rejected_with_a_wrong_one() {
    let mut random = Random::new(3);
    for _ in 0..5 {
        let track = orbiting_track(20.0, &mut random);
        // At the rate at which a running rig analyses its pictures.
        let mut flows = flows(20.0, 15.0, &mut random);
        for i in [50, 51, 200, 233] {
            for patch in flows[i].flow.patches.iter_mut().flatten() {
                patch.to += DVec2::new(0.1, -0.05);
            }
        }
        let right = mounted(DQuat::IDENTITY);
        let found = from_patches(&track, &flows, &right, 0.25).unwrap();
        let error = found.seconds - OFFSET;
        println!("error {:.2} ms, {found:?}", 1e3 * error);
        assert!(
            error.abs() < 0.003 && error.abs() < 4.0 * found.sigma,
            "{error} {found:?}"
        );
        assert!(found.sigma < 0.005, "{found:?}");
        // The more certain method is used, but never one with a wrong mounting.
        let (found, _) = from_image_motion(&track, &flows, Some(&right), 0.25).unwrap();
        assert!((found.seconds - OFFSET).abs() < 0.003, "{found:?}");
        let wrong = mounted(DQuat::from_rotation_z(1.2));
        let (found, method) = from_image_motion(&track, &flows, Some(&wrong), 0.25).unwrap();
        assert!(
            (found.seconds - OFFSET).abs() < 0.003,
            "{found:?} {method:?}"
        );
    }
}

/// Rotation and translation a quarter of a period apart compensate for any offset.
#[test]
fn refuses_harmonic_oscillation() {
    let swing = |t: f64| {
        let rotation = DQuat::from_rotation_y(0.2 * (9.0 * t).sin());
        RigidTransform::new(rotation, DVec3::X * 0.1 * (9.0 * t).cos())
    };
    let mut random = Random::new(9);
    let readings = (0..2400).map(|i| {
        let t = f64::from(i) / 120.0;
        let pose = swing(t - OFFSET);
        let position = pose.translation + random.normal3() * 1e-4;
        (t, RigidTransform::new(pose.rotation, position))
    });
    let track = TrackerTrack::from_poses(readings.collect::<Vec<_>>(), 0.02);
    let motion = |i: i32| {
        let (from, to) = (f64::from(i - 1) / 30.0, f64::from(i) / 30.0);
        let back = swing(from).inverse() * swing(to);
        let rotation = back.rotation.to_scaled_axis();
        let shift = DVec2::new(-700.0 * rotation.y - 500.0 * back.translation.x, 0.0);
        CameraMotion {
            from,
            to,
            flow: Flow {
                length: shift.length(),
                shift,
                ..Flow::default()
            },
        }
    };
    let motions: Vec<CameraMotion> = (1..600).map(motion).collect();
    let found = from_flow(&track, &motions, 0.25);
    assert_eq!(found, Err(LatencyError::AnyOffset));
}

#[test]
fn refuses_short_and_unrelated_flow() {
    let mut random = Random::new(6);
    let track = orbiting_track(20.0, &mut random);
    let flows = flows(20.0, 30.0, &mut random);
    let short = from_flow(&track, &flows[..100], 0.25);
    assert!(
        matches!(short, Err(LatencyError::TooShort { .. })),
        "{short:?}"
    );
    let mut backwards: Vec<CameraMotion> = flows.clone();
    for (motion, other) in backwards.iter_mut().zip(flows.iter().rev()) {
        motion.flow = other.flow;
    }
    let other = from_flow(&track, &backwards, 0.25);
    assert!(other.is_err(), "{other:?}");
}

/// The tracker is silent for a quarter of a second now and then.
#[test]
fn gaps_in_tracker_record_do_not_bias_offset() {
    let mut random = Random::new(7);
    for _ in 0..3 {
        let readings = (0..2400).filter_map(|i| {
            let t = f64::from(i) / 120.0;
            let silent = (t / 2.3).fract() < 0.11;
            (!silent).then(|| {
                (
                    t,
                    hand(t - OFFSET) * DQuat::from_rotation_x(1e-3 * random.normal()),
                )
            })
        });
        let track = TrackerTrack::new(readings.collect::<Vec<_>>(), 0.02);
        let found =
            from_rotations(&track, &camera_rotations(20.0, 0.0017, &mut random), 0.25).unwrap();
        let error = found.seconds - OFFSET;
        assert!(error.abs() < 0.001, "{error} {found:?}");
    }
}

#[test]
fn refuses_motion_that_does_not_determine_the_offset() {
    let mut random = Random::new(3);
    let good = track(120.0, 20.0, 0.0026, &mut random);
    let seen = camera_rotations(20.0, 0.0017, &mut random);
    assert!(matches!(
        from_rotations(&good, &seen[..10], 0.25),
        Err(LatencyError::TooShort { .. })
    ));
    // A tracker at rest.
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
        Err(LatencyError::Uncorrelated { .. })
    ));
    // Pictures of another rig, and clocks that differ by more than the range.
    let late: Vec<CameraRotation> = seen
        .iter()
        .map(|t| CameraRotation {
            from: t.from + 0.6,
            to: t.to + 0.6,
            ..*t
        })
        .collect();
    assert!(from_rotations(&good, &late, 0.25).is_err());
    // A pendulum repeats its motion after each period.
    let swing = |t: f64| DQuat::from_rotation_x(0.3 * (18.0 * t).sin());
    let pendulum = TrackerTrack::new(
        (0..2400)
            .map(|i| (f64::from(i) / 120.0, swing(f64::from(i) / 120.0)))
            .collect::<Vec<_>>(),
        0.0,
    );
    let seen: Vec<CameraRotation> = (12..580)
        .map(|i| {
            let (from, to) = (f64::from(i) / 30.0, f64::from(i + 1) / 30.0);
            CameraRotation {
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
fn measures_displacement_of_shifted_picture() {
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
            (found.length - length).abs() < 0.15,
            "{at:?} from {before:?}: {found:?}"
        );
        let shift = DVec2::from(at) - DVec2::from(before);
        assert!(found.shift.distance(shift) < 0.15, "{found:?}");
        assert!(
            found.growth.abs() < 2e-3 && found.rotation.abs() < 2e-3,
            "{found:?}"
        );
    }
    assert_eq!(motion.next(&Grey::from_bytes(320, 240, &[])), None);
    assert_eq!(motion.next(&Grey::from_bytes(64, 64, &[])), None);
}

/// A small noisy camera that rotates as the hand does, among smooth waves of brightness.
#[test]
fn recovers_offset_from_rendered_pictures_within_two_milliseconds() {
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
        if let (Some(from), Some(flow)) = (before, motion.next(&picture)) {
            flows.push(CameraMotion { from, to: at, flow });
        }
        before = Some(at);
    }
    let found = from_flow(&track(120.0, 16.0, 0.0026, &mut random), &flows, 0.2).unwrap();
    assert!((found.seconds - OFFSET).abs() < 0.002, "{found:?}");
}

/// Reads a table's rows of numbers, without its header; text becomes NaN.
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

/// A session with a tracker latency of 8 ms and no camera latency; the pictures' ground-truth poses
/// stand in for poses from markers.
#[test]
fn recovers_latency_of_ground_truth_rig() {
    let Some(folder) = penumbra_test_data::shared("truth/desk") else {
        return;
    };
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
    let expected = rig["tracker"]["latency_s"].as_f64().unwrap();
    let ground_truth = TrackerTrack::new(poses("camera_truth.csv"), 0.0);
    let stamps: Vec<f64> = table(folder.join("scene_timestamps.csv"))
        .iter()
        .map(|row| seconds(row[2]))
        .collect();
    let camera_rotations: Vec<CameraRotation> = stamps
        .windows(2)
        .map(|w| CameraRotation {
            from: w[0],
            to: w[1],
            rotation: ground_truth.rotation_at(w[0]).unwrap().inverse()
                * ground_truth.rotation_at(w[1]).unwrap(),
        })
        .collect();
    let track = TrackerTrack::new(poses("tracker.csv"), 0.02);
    let found = from_rotations(&track, &camera_rotations, 0.1).unwrap();
    assert!(
        (found.seconds - expected).abs() < 0.002,
        "{found:?}, {expected}"
    );
}

/// Four seconds are too short for the flow alone.
#[test]
fn refuses_flow_of_ground_truth_rig_as_too_short() {
    let Some(folder) = penumbra_test_data::shared("truth/desk") else {
        return;
    };
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
        if let (Some(from), Some(flow)) = (before, moved) {
            flows.push(CameraMotion { from, to, flow });
        }
        before = Some(to);
    }
    assert!(flows.len() > 50, "{}", flows.len());
    let found = from_flow(&track, &flows, 0.1);
    assert!(
        matches!(found, Err(LatencyError::TooShort { .. })),
        "{found:?}"
    );
}
