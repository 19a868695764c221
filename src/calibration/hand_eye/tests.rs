#![allow(clippy::unwrap_used, clippy::panic)]
use super::*;
use glam::DQuat;
use penumbra_numerics::Random;

fn truth() -> Mounting {
    Mounting {
        sensor_from_camera: RigidTransform::new(
            DQuat::from_euler(glam::EulerRot::XYZ, 1.5, 0.1, -0.2),
            DVec3::new(0.03, -0.05, 0.08),
        ),
        world_from_transmitter: RigidTransform::new(
            DQuat::from_euler(glam::EulerRot::XYZ, 3.0, 0.05, 0.7),
            DVec3::new(-0.4, 0.6, 0.25),
        ),
    }
}

/// A hand-held motion; `turns` about three axes, radians.
fn motion(n: usize, turns: DVec3) -> Vec<RigidTransform> {
    (0..n)
        .map(|i| {
            let t = i as f64 / 30.0;
            let swing = DVec3::new(
                (1.1 * t).sin(),
                (0.73 * t + 1.0).sin(),
                (0.41 * t + 2.0).sin(),
            );
            let q = DQuat::from_scaled_axis(swing * turns);
            let p = DVec3::new(
                0.4 + 0.15 * (0.6 * t).sin(),
                0.1 * (0.9 * t).cos(),
                -0.3 + 0.1 * (0.5 * t).sin(),
            );
            RigidTransform::new(q, p)
        })
        .collect()
}

fn noisy(pose: RigidTransform, turn: f64, shift: f64, random: &mut Random) -> RigidTransform {
    RigidTransform::new(
        (DQuat::from_scaled_axis(random.normal3() * turn) * pose.rotation).normalize(),
        pose.translation + random.normal3() * shift,
    )
}

/// A FASTRAK's noise (0.15°, 0.8 mm) and that of poses from markers (0.1°, 1 mm).
fn pairs(sensor: &[RigidTransform], random: &mut Random) -> Vec<PosePair> {
    let m = truth();
    sensor
        .iter()
        .map(|&s| {
            let camera = m.world_from_transmitter * s * m.sensor_from_camera;
            PosePair {
                transmitter_from_sensor: noisy(s, 0.0026, 0.0008, random),
                world_from_camera: noisy(camera, 0.0017, 0.001, random),
            }
        })
        .collect()
}

/// Degrees and metres by which the camera's mounting is off.
fn errors(found: &HandEye) -> (f64, f64) {
    let m = truth();
    let turn = closed::rotation_vector(
        m.sensor_from_camera.rotation.inverse() * found.sensor_from_camera.rotation,
    )
    .length();
    let shift = found
        .sensor_from_camera
        .translation
        .distance(m.sensor_from_camera.translation);
    (turn.to_degrees(), shift)
}

#[test]
fn without_noise_the_mounting_is_exact() {
    let m = truth();
    let pairs: Vec<PosePair> = motion(240, DVec3::splat(0.5))
        .into_iter()
        .map(|s| PosePair {
            transmitter_from_sensor: s,
            world_from_camera: m.world_from_transmitter * s * m.sensor_from_camera,
        })
        .collect();
    let found = hand_eye(&pairs).unwrap();
    let (turn, shift) = errors(&found);
    assert!(turn < 1e-7 && shift < 1e-9, "{turn} {shift}");
    assert!(found.used.iter().all(|u| *u));
}

#[test]
fn with_noise_it_is_right_to_a_millimetre_and_a_tenth_of_a_degree() {
    let mut random = Random::new(5);
    let (mut within, mut all) = (0, 0);
    for _ in 0..10 {
        let found = hand_eye(&pairs(&motion(600, DVec3::new(0.5, 0.4, 0.6)), &mut random)).unwrap();
        let (turn, shift) = errors(&found);
        assert!(turn < 0.1 && shift < 0.001, "{turn}° {shift} m");
        // And as near as it says.
        let m = truth();
        let off = found.sensor_from_camera.translation - m.sensor_from_camera.translation;
        for axis in 0..3 {
            all += 1;
            within += usize::from(off[axis].abs() < 2.0 * found.sensor_sigma.1[axis]);
        }
        assert!(
            (found.position_rms - 3_f64.sqrt() * 0.00128).abs() < 0.0004,
            "{}",
            found.position_rms
        );
    }
    // Two σ hold 95 %; a few draws more or less.
    assert!(within * 10 >= all * 8, "{within} of {all}");
}

#[test]
fn wrong_poses_are_left_out() {
    let mut random = Random::new(6);
    let mut pairs = pairs(&motion(400, DVec3::new(0.5, 0.4, 0.6)), &mut random);
    // The picture's pose flips, as a single tag's does; the tracker jumps near metal.
    for (i, pair) in pairs.iter_mut().enumerate() {
        if i % 4 == 0 {
            pair.world_from_camera = noisy(pair.world_from_camera, 0.4, 0.1, &mut random);
        } else if i % 9 == 0 {
            pair.transmitter_from_sensor.translation += DVec3::new(0.05, 0.0, -0.02);
        }
    }
    let found = hand_eye(&pairs).unwrap();
    let (turn, shift) = errors(&found);
    assert!(turn < 0.1 && shift < 0.001, "{turn}° {shift} m");
    let left_out = (0..400).filter(|i| i % 4 == 0 && !found.used[*i]).count();
    assert!(left_out >= 97, "{left_out}");
}

#[test]
fn motion_that_does_not_tell_is_refused() {
    let mut random = Random::new(7);
    let still = pairs(&motion(200, DVec3::ZERO), &mut random);
    assert!(matches!(
        hand_eye(&still),
        Err(HandEyeError::NoRotation { .. })
    ));
    let one_axis = pairs(&motion(200, DVec3::new(0.0, 0.0, 0.6)), &mut random);
    assert!(
        matches!(hand_eye(&one_axis), Err(HandEyeError::OneAxis { .. })),
        "{:?}",
        hand_eye(&one_axis)
    );
    assert_eq!(
        hand_eye(&still[..5]),
        Err(HandEyeError::TooFew { pairs: 5, least: 6 })
    );
    let mut unrelated = pairs(&motion(200, DVec3::splat(0.5)), &mut random);
    for pair in &mut unrelated {
        pair.world_from_camera = noisy(pair.world_from_camera, 1.0, 0.5, &mut random);
    }
    assert!(match hand_eye(&unrelated) {
        Err(_) => true,
        // If it is called a result, its own uncertainty says what it is worth.
        Ok(found) => found.sensor_sigma.1.max_element() > 0.02,
    });
}
