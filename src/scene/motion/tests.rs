use super::*;
use crate::scene::Scene;
use crate::virtual_light::{VirtualLight, VirtualLightKey, VirtualLightKind};
use glam::Vec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

fn channel<T: Value>(keys: &[(f64, T)], easing: Easing) -> Channel<T> {
    let (seconds, values) = keys.iter().copied().unzip();
    Channel::new(seconds, values, easing).unwrap()
}

#[test]
fn easings_interpolate_between_two_keys() {
    let x = |easing| {
        let c = channel(&[(1.0, DVec3::ZERO), (3.0, DVec3::X * 8.0)], easing);
        [0.0, 1.5, 2.0, 3.0, 9.0].map(|t| c.at(t).unwrap().x)
    };
    assert_eq!(x(Easing::Step), [0.0, 0.0, 0.0, 8.0, 8.0]);
    assert_eq!(x(Easing::Linear), [0.0, 2.0, 4.0, 8.0, 8.0]);
    // Smoothstep of a quarter is 5/32.
    assert_eq!(x(Easing::Smooth), [0.0, 8.0 * 5.0 / 32.0, 4.0, 8.0, 8.0]);
}

#[test]
fn cubic_spline_reproduces_a_cubic() {
    // x = t³ − 2t² + 3 with its slopes as tangents.
    let (f, slope) = (
        |t: f64| t.powi(3) - 2.0 * t * t + 3.0,
        |t: f64| 3.0 * t * t - 4.0 * t,
    );
    let seconds = vec![0.5, 1.25, 3.0];
    let key = |t: &f64| [slope(*t), f(*t), slope(*t)].map(DVec3::splat);
    let values = seconds.iter().flat_map(key).collect();
    let c = Channel::new(seconds, values, Easing::Cubic).unwrap();
    for i in 0..=50 {
        let t = 0.5 + 0.05 * f64::from(i);
        let error = c.at(t).unwrap() - DVec3::splat(f(t));
        assert!(error.abs().max_element() < 1e-12, "{t}: {error}");
    }
    assert!((c.at(0.0).unwrap().x - f(0.5)).abs() < 1e-15);
}

#[test]
fn angles_make_full_turns_and_quaternions_take_the_shorter_arc() {
    let turned = |turning| {
        let track = Track {
            turning: Some(turning),
            ..Track::resting(DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE)
        };
        Motion::default().then_along(Arc::new(track))
    };
    let full = [(0.0, DVec3::ZERO), (4.0, DVec3::X * TAU)];
    let full = turned(Turning::Angles(channel(&full, Easing::Linear)));
    let half_way = full.at(1.0).transform_vector3(DVec3::X);
    assert!(half_way.distance(DVec3::Y) < 1e-12, "{half_way}");
    let far = DQuat::from_rotation_z(1.5 * PI);
    let keys = [(0.0, DQuat::IDENTITY), (1.0, far)];
    let short = turned(Turning::Quaternions(channel(&keys, Easing::Linear)));
    let x = short.at(0.5).transform_vector3(DVec3::X);
    let expected = DQuat::from_rotation_z(-0.5 * FRAC_PI_2) * DVec3::X;
    assert!(x.distance(expected) < 1e-9, "{x}");
}

#[test]
fn tracks_repeat_and_constant_transforms_are_merged() {
    let swing = Track {
        position: Some(channel(
            &[(0.0, DVec3::ZERO), (2.0, DVec3::X)],
            Easing::Linear,
        )),
        repeat: Some(2.0),
        ..Track::resting(DVec3::ZERO, DQuat::IDENTITY, DVec3::splat(2.0))
    };
    let up = DMat4::from_translation(DVec3::Z);
    let chain = Motion::default()
        .then(up)
        .then(up)
        .then_along(Arc::new(swing))
        .then(up);
    assert_eq!((chain.joints.len(), chain.moves()), (3, true));
    assert!(!Motion::default().then(up).moves());
    for seconds in [1.0, 3.0, -1.0] {
        let origin = chain.at(seconds).transform_point3(DVec3::ZERO);
        // Two up, half a metre along, and one up twice as long.
        assert!(
            origin.distance(DVec3::new(0.5, 0.0, 4.0)) < 1e-12,
            "{origin}"
        );
    }
}

#[test]
fn scale_stays_positive() {
    let keys = [(0.0, DVec3::ONE), (1.0, DVec3::new(-1.0, 0.0, 1.0))];
    let track = Track {
        scale: Some(channel(&keys, Easing::Linear)),
        ..Track::resting(DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE)
    };
    let motion = Motion::default().then_along(Arc::new(track));
    for i in 0..=20 {
        let place = motion.at(f64::from(i) / 20.0);
        assert!(
            place.determinant() > 0.0 && place.inverse().is_finite(),
            "{place}"
        );
    }
}

#[test]
fn refuses_times_that_do_not_increase_and_wrong_value_counts() {
    let none = |seconds: &[f64], values: usize, easing| {
        Channel::new(seconds.to_vec(), vec![DVec3::ZERO; values], easing).is_none()
    };
    assert!(none(&[], 0, Easing::Linear) && none(&[1.0, 1.0], 2, Easing::Linear));
    assert!(none(&[0.0, f64::NAN], 2, Easing::Step) && none(&[0.0, 1.0], 2, Easing::Cubic));
    assert!(!none(&[0.0, 1.0], 6, Easing::Cubic));
}

#[test]
fn lamps_follow_their_carriers() {
    let lamp = |x: f64, gain: f64| VirtualLight {
        screen: None,
        name: "spot".into(),
        kind: VirtualLightKind::Spot {
            beam: 0.4,
            cutoff: 0.6,
        },
        intensity: Vec3::ONE,
        keys: vec![VirtualLightKey {
            seconds: 0.0,
            position: DVec3::new(x, 0.0, 0.0),
            target: Some(DVec3::new(x + 1.0, 0.0, 0.0)),
            gain,
        }],
        repeat: None,
    };
    let spin = [(0.0, DVec3::ZERO), (1.0, DVec3::X * FRAC_PI_2)];
    let track = Track {
        turning: Some(Turning::Angles(channel(&spin, Easing::Linear))),
        ..Track::resting(DVec3::Z, DQuat::IDENTITY, DVec3::splat(2.0))
    };
    let motion = Motion::default().then_along(Arc::new(track));
    let mut scene = Scene {
        lamps: vec![lamp(1.0, 0.0), lamp(1.0, 1.0), lamp(3.0, 1.0)],
        ..Scene::default()
    };
    scene.motions.lamps = vec![Mover { index: 1, motion }];
    let mut placed = Vec::new();
    scene.lamps_at(1.0, &mut placed);
    assert_eq!(placed.len(), 2, "the first is dark");
    assert!(placed[0].position.distance(Vec3::new(0.0, 2.0, 1.0)) < 1e-6);
    assert!(placed[0].direction.distance(Vec3::Y) < 1e-6);
    assert_eq!(placed[1].position, Vec3::new(3.0, 0.0, 0.0));
    let room = placed.as_ptr();
    (0..100).for_each(|i| scene.lamps_at(0.01 * f64::from(i), &mut placed));
    assert_eq!(placed.as_ptr(), room, "nothing is allocated");
}
