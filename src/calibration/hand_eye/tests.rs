use super::model::Mounting;
use super::*;
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Random, rotation_vector};

fn ground_truth() -> Mounting {
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

/// A hand-held motion; `angles` are the amplitudes about three axes, radians.
fn motion(n: usize, angles: DVec3) -> Vec<RigidTransform> {
    (0..n)
        .map(|i| {
            let t = i as f64 / 30.0;
            let swing = DVec3::new(
                (1.1 * t).sin(),
                (0.73 * t + 1.0).sin(),
                (0.41 * t + 2.0).sin(),
            );
            let q = DQuat::from_scaled_axis(swing * angles);
            let p = DVec3::new(
                0.4 + 0.15 * (0.6 * t).sin(),
                0.1 * (0.9 * t).cos(),
                -0.3 + 0.1 * (0.5 * t).sin(),
            );
            RigidTransform::new(q, p)
        })
        .collect()
}

fn noisy(
    pose: RigidTransform,
    rotation: f64,
    position: f64,
    random: &mut Random,
) -> RigidTransform {
    RigidTransform::new(
        (DQuat::from_scaled_axis(random.normal3() * rotation) * pose.rotation).normalize(),
        pose.translation + random.normal3() * position,
    )
}

/// Pairs with the noise of a FASTRAK (0.15°, 0.8 mm) and of poses from markers (0.1°, 1 mm).
fn pairs(sensor: &[RigidTransform], random: &mut Random) -> Vec<PosePair> {
    let m = ground_truth();
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

/// Returns the error of the camera's mounting, degrees and metres.
fn errors(found: &HandEye) -> (f64, f64) {
    let m = ground_truth();
    let rotation = rotation_vector(
        m.sensor_from_camera.rotation.inverse() * found.sensor_from_camera.rotation,
    )
    .length();
    let position = found
        .sensor_from_camera
        .translation
        .distance(m.sensor_from_camera.translation);
    (rotation.to_degrees(), position)
}

#[test]
fn recovers_exact_mounting_without_noise() {
    let m = ground_truth();
    let pairs: Vec<PosePair> = motion(240, DVec3::splat(0.5))
        .into_iter()
        .map(|s| PosePair {
            transmitter_from_sensor: s,
            world_from_camera: m.world_from_transmitter * s * m.sensor_from_camera,
        })
        .collect();
    let found = hand_eye(&pairs).unwrap();
    let (rotation, position) = errors(&found);
    assert!(rotation < 1e-7 && position < 1e-9, "{rotation} {position}");
    assert!(found.used.iter().all(|u| *u));
}

#[test]
fn recovers_noisy_mounting_within_a_millimetre_and_a_tenth_of_a_degree() {
    let mut random = Random::new(5);
    let (mut within, mut all) = (0, 0);
    for _ in 0..10 {
        let found = hand_eye(&pairs(&motion(600, DVec3::new(0.5, 0.4, 0.6)), &mut random)).unwrap();
        let (rotation, position) = errors(&found);
        assert!(
            rotation < 0.1 && position < 0.001,
            "{rotation}° {position} m"
        );
        // The stated uncertainty holds.
        let m = ground_truth();
        let error = found.sensor_from_camera.translation - m.sensor_from_camera.translation;
        for axis in 0..3 {
            all += 1;
            within += usize::from(error[axis].abs() < 2.0 * found.sensor_sigma.1[axis]);
        }
        assert!(
            (found.position_rms - 3_f64.sqrt() * 0.00128).abs() < 0.0004,
            "{}",
            found.position_rms
        );
    }
    // 2σ contain 95 %; 80 % allows for the small sample.
    assert!(within * 10 >= all * 8, "{within} of {all}");
}

#[test]
fn rejects_wrong_poses_as_outliers() {
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
    let (rotation, position) = errors(&found);
    assert!(
        rotation < 0.1 && position < 0.001,
        "{rotation}° {position} m"
    );
    let rejected = (0..400).filter(|i| i % 4 == 0 && !found.used[*i]).count();
    assert!(rejected >= 97, "{rejected}");
}

#[test]
fn refuses_degenerate_motion() {
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
        Err(HandEyeError::TooFew {
            pairs: 5,
            needed: 6
        })
    );
    let mut unrelated = pairs(&motion(200, DVec3::splat(0.5)), &mut random);
    for pair in &mut unrelated {
        pair.world_from_camera = noisy(pair.world_from_camera, 1.0, 0.5, &mut random);
    }
    assert!(match hand_eye(&unrelated) {
        Err(_) => true,
        // A result is acceptable if its stated uncertainty is large.
        Ok(found) => found.sensor_sigma.1.max_element() > 0.02,
    });
}
