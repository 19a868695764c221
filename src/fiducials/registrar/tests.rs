use super::*;
use crate::family::Family;
use crate::map::Tag;
use crate::synthetic::{camera, tag};
use glam::{DQuat, DVec2, DVec3};

fn map() -> TagMap {
    let tags = vec![
        tag(3, 0.06, DVec3::new(0.2, 0.0, 0.0)),
        tag(1, 0.06, DVec3::ZERO),
    ];
    TagMap::new(tags).unwrap()
}

fn observation(tag: &Tag, pose: RigidTransform, off: [DVec2; 4]) -> TagObservation {
    let pixels = tag
        .corners()
        .map(|c| camera().project(pose.transform_point(c)).unwrap());
    TagObservation {
        family: tag.family,
        id: tag.id,
        corners: std::array::from_fn(|i| pixels[i] + off[i]),
        margin: 1.0,
        wrong_bits: 0,
    }
}

fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(millis * 1_000_000)
}

/// A distant tag, almost straight ahead: its corners are consistent with two poses.
fn far(tilt: f64) -> RigidTransform {
    RigidTransform::new(DQuat::from_rotation_x(tilt), DVec3::new(0.05, 0.05, 1.6))
}

#[test]
fn ambiguous_tag_is_resolved_by_previous_pose_or_reported_as_guess() {
    let map = map();
    let one = *map.get(Family::Tag36h11, 1).unwrap();
    let off = [(0.1, -0.05), (-0.08, 0.1), (0.06, 0.1), (-0.1, -0.1)].map(DVec2::from);
    let mut fresh = Registrar::new(map.clone());
    let found = fresh
        .register(&camera(), &[observation(&one, far(0.3), off)], at(0))
        .unwrap();
    assert_eq!(found.method, RegistrationMethod::TagGuessed);
    for tilt in [0.3, -0.3] {
        let mut registrar = Registrar::new(map.clone());
        let all: Vec<_> = map
            .tags()
            .iter()
            .map(|t| observation(t, far(tilt), off))
            .collect();
        let both = registrar.register(&camera(), &all, at(0)).unwrap();
        assert_eq!(both.method, RegistrationMethod::Map { tags: 2 });
        let alone = registrar
            .register(&camera(), &[observation(&one, far(tilt), off)], at(33))
            .unwrap();
        assert_eq!(alone.method, RegistrationMethod::TagByPreviousPose);
        let angle = alone
            .estimate
            .camera_from_frame
            .rotation
            .angle_between(far(tilt).rotation);
        assert!(angle < 0.25, "{tilt} {angle}");
        // Too long ago.
        let late = registrar
            .register(&camera(), &[observation(&one, far(tilt), off)], at(5000))
            .unwrap();
        assert_eq!(late.method, RegistrationMethod::TagGuessed);
    }
}

#[test]
fn near_tag_needs_no_previous_pose_and_unknown_or_moved_tags_give_none() {
    let map = map();
    let near = RigidTransform::new(DQuat::from_rotation_x(0.8), DVec3::new(0.0, 0.0, 0.3));
    let one = *map.get(Family::Tag36h11, 1).unwrap();
    let mut registrar = Registrar::new(map);
    let seen = observation(&one, near, [DVec2::ZERO; 4]);
    let found = registrar.register(&camera(), &[seen], at(0)).unwrap();
    assert_eq!(found.method, RegistrationMethod::Tag);
    let back = found.map_from_camera * near;
    assert!(back.translation.length() < 1e-6);
    let foreign = TagObservation { id: 99, ..seen };
    assert!(registrar.register(&camera(), &[foreign], at(1)).is_none());
    // The same number twice: either could be the map's.
    let twin = TagObservation {
        corners: seen.corners.map(|c| c + 200.0),
        ..seen
    };
    assert!(
        registrar
            .register(&camera(), &[seen, twin], at(2))
            .is_none()
    );
    let moved = observation(
        &tag(3, 0.06, DVec3::new(0.2, 0.1, 0.0)),
        near,
        [DVec2::ZERO; 4],
    );
    assert!(
        registrar
            .register(&camera(), &[seen, moved], at(3))
            .is_none()
    );
}

#[test]
fn rejects_map_with_repeated_tag() {
    let twice = vec![tag(3, 0.06, DVec3::X), tag(3, 0.05, DVec3::ZERO)];
    let error = TagMap::new(twice).unwrap_err().to_string();
    assert_eq!(error, "tag36h11 3 is in the map twice; remove one of them");
}
