use super::super::tests::{Rig, fisheye, photograph, sphere};
use super::*;
use crate::geodesic::sum_faces;

fn with_faces(frequency: u32) -> EnvironmentSettings {
    EnvironmentSettings {
        faces: Some(frequency),
        ..EnvironmentSettings::default()
    }
}

/// Two coloured walls, and a lamp of 3° in one direction.
fn room(lamp: Vec3) -> impl Fn(Vec3) -> Vec3 {
    move |d: Vec3| {
        let wall = if d.x > 0.0 {
            Vec3::new(0.5, 0.4, 0.3)
        } else {
            Vec3::new(0.2, 0.3, 0.4)
        };
        let in_lamp = d.dot(lamp) > 3.0_f32.to_radians().cos();
        wall + if in_lamp {
            Vec3::splat(300.0)
        } else {
            Vec3::ZERO
        }
    }
}

#[test]
fn no_face_light_without_faces() {
    let mut rig = Rig::new(&fisheye(0.0), EnvironmentSettings::default());
    assert!(rig.observe(&|_| Vec3::ONE, Vec3::ONE).faces.is_none());
    rig.estimator.set_faces(Some(2));
    assert!(rig.observe(&|_| Vec3::ONE, Vec3::ONE).faces.is_some());
    rig.estimator.set_faces(Some(3));
    assert!(rig.observe(&|_| Vec3::ONE, Vec3::ONE).faces.is_none());
}

#[test]
fn uniform_sky_gives_each_face_its_solid_angle() {
    let dome = GeodesicDome::new(4).unwrap();
    for view in [fisheye(0.3), sphere(false).0] {
        let mut rig = Rig::new(&view, with_faces(4));
        let lighting = rig.observe(&|_| Vec3::splat(0.5), Vec3::splat(0.5));
        let light = lighting.faces.as_ref().unwrap();
        assert_eq!(light.frequency, 4);
        for (sum, face) in sum_faces(light).iter().zip(&dome.faces) {
            // The pictures have 256 codes: half a per cent here.
            assert!((*sum / face.solid_angle / 0.5 - 1.0).abs().max_element() < 0.01);
        }
    }
}

/// The faces hold the same light as the dome lights and the irradiance.
#[test]
fn faces_and_dome_hold_equal_light() {
    let (dome, at) = (GeodesicDome::new(2).unwrap(), 8);
    let lamp = dome.faces[at].centre;
    for view in [fisheye(0.0), sphere(false).0] {
        let mut rig = Rig::new(&view, with_faces(2));
        let dark = rig.observe(&room(Vec3::NEG_Z), Vec3::splat(0.1));
        let bright = rig.observe(&room(lamp), Vec3::splat(0.1));
        let sums = |l: &Lighting| sum_faces(l.faces.as_ref().unwrap());
        let (before, after) = (sums(&dark), sums(&bright));
        let compact: Vec3 = rig.estimator.sources().iter().map(|s| s.irradiance).sum();
        let gained = after[at] - before[at];
        assert!(
            (gained / compact - 1.0).abs().max_element() < 0.03,
            "{gained} {compact}"
        );
        for (k, (a, b)) in after
            .iter()
            .zip(&before)
            .enumerate()
            .filter(|(k, _)| *k != at)
        {
            assert!(
                (*a - *b).abs().max_element() < 0.02 * b.max_element(),
                "{k}: {a} {b}"
            );
        }
    }
}

#[test]
fn face_light_is_in_scene_camera_units() {
    let mut rig = Rig::new(&fisheye(0.0), with_faces(2));
    let plain = sum_faces(
        rig.observe(&|_| Vec3::splat(0.4), Vec3::ONE)
            .faces
            .as_ref()
            .unwrap(),
    );
    rig.gains = Mat3::from_diagonal(Vec3::new(2.0, 1.0, 0.5));
    let gained = sum_faces(
        rig.observe(&|_| Vec3::splat(0.4), Vec3::ONE)
            .faces
            .as_ref()
            .unwrap(),
    );
    for (a, b) in plain.iter().zip(&gained).skip(3).take(2) {
        assert!(
            (*b / *a - Vec3::new(2.0, 1.0, 0.5)).abs().max_element() < 0.02,
            "{a} {b}"
        );
    }
}

#[test]
fn unseen_directions_are_filled() {
    let turned = match fisheye(0.0) {
        EnvironmentView::Fisheye { lens, .. } => EnvironmentView::Fisheye {
            lens,
            world_from_camera: penumbra_interface::RigidTransform::new(
                glam::DQuat::from_rotation_x(0.9),
                DVec3::ZERO,
            ),
        },
        other => other,
    };
    let mut rig = Rig::new(&turned, with_faces(2));
    let lighting = rig.observe(&|_| Vec3::splat(0.5), Vec3::splat(0.5));
    let dome = GeodesicDome::new(2).unwrap();
    for (sum, face) in sum_faces(lighting.faces.as_ref().unwrap())
        .iter()
        .zip(&dome.faces)
    {
        assert!((*sum / face.solid_angle / 0.5 - 1.0).abs().max_element() < 0.01);
    }
}

#[test]
fn buffers_are_recycled() {
    let mut rig = Rig::new(&fisheye(0.0), with_faces(2));
    let mut places = std::collections::BTreeSet::new();
    let mut before = None;
    for _ in 0..8 {
        let lighting = rig.observe(&|_| Vec3::splat(0.4), Vec3::ONE);
        places.insert(lighting.faces.as_ref().unwrap().radiance.as_ptr() as usize);
        before = Some(lighting);
    }
    assert!(before.is_some() && places.len() == 2, "{}", places.len());
}

/// The sphere in the scene's picture: the cube holds what was seen.
#[test]
fn moving_view_sums_accumulated_radiance() {
    let (view, pose, camera) = sphere(true);
    let placed = PlacedView::new(&view, Some((pose, &camera)), None).unwrap();
    let estimator = EnvironmentEstimator::new(&view, &Response::srgb(), with_faces(2), None);
    let picture = photograph(&placed, Vec3::new(0.9, 0.8, 0.7), 0.0, &|_| {
        Vec3::splat(0.5)
    });
    let brackets = [Bracket {
        picture: &picture,
        ev: 0.0,
    }];
    let mut input = EnvironmentInput::new(&brackets, MonotonicTime::from_nanos(1));
    input.scene = Some((pose, &camera));
    let lighting = estimator.unwrap().update(&input).unwrap();
    let dome = GeodesicDome::new(2).unwrap();
    for (sum, face) in sum_faces(lighting.faces.as_ref().unwrap())
        .iter()
        .zip(&dome.faces)
    {
        assert!(
            (*sum / face.solid_angle / 0.5 - 1.0).abs().max_element() < 0.01,
            "{sum}"
        );
    }
}

/// A lamp is a part of the faces in which it lies, and of no others; its direction and brightness
/// are those of its dome light.
#[test]
fn compact_sources_are_part_of_their_faces() {
    let dome = GeodesicDome::new(2).unwrap();
    let corner = dome.faces[8].corners[0] + dome.faces[8].corners[1];
    for (view, lamp, max) in [
        (fisheye(0.0), dome.faces[8].centre, 1),
        (fisheye(0.0), corner.normalize(), 2),
        (sphere(false).0, dome.faces[8].centre, 1),
    ] {
        let mut rig = Rig::new(&view, with_faces(2));
        let lighting = rig.observe(&room(lamp), Vec3::splat(0.1));
        let light = lighting.faces.as_ref().unwrap();
        let [source] = light.sources.as_slice() else {
            panic!("{:?}", light.sources);
        };
        assert!(source.direction.angle_between(lamp) < 0.01);
        let near = |face: usize| dome.faces[face].corners.iter().map(|c| c.dot(lamp));
        let compact = rig.estimator.sources()[0].irradiance;
        let share = source.irradiance() / compact;
        assert!((share - 1.0).abs().max_element() < 0.02, "{share}");
        let sums = sum_faces(light);
        let bright = |taken: &&(u32, Vec3)| taken.1.max_element() > 0.01 * compact.max_element();
        assert_eq!(
            source.irradiance_in_faces.iter().filter(bright).count(),
            max
        );
        for (face, taken) in &source.irradiance_in_faces {
            let left = sums[*face as usize] - *taken;
            assert!(left.min_element() > 0.0, "{face}: {left}");
            assert!(near(*face as usize).fold(-1.0, f32::max) > 0.8);
        }
        let shares: f32 = source.spread.iter().map(|(_, share)| share).sum();
        assert!((shares - 1.0).abs() < 1e-4);
        let spread = source.spread.iter();
        assert!(
            spread
                .map(|(d, _)| d.angle_between(lamp))
                .all(|off| off < 0.06)
        );
    }
}

#[test]
fn source_keeps_its_number_across_an_edge() {
    let dome = GeodesicDome::new(2).unwrap();
    let (from, to) = (dome.faces[8].centre, dome.faces[9].centre);
    let mut rig = Rig::new(&fisheye(0.0), with_faces(2));
    let mut at = |share: f32| {
        let lamp = from.lerp(to, share).normalize();
        let lighting = rig.observe(&room(lamp), Vec3::splat(0.1));
        lighting.faces.as_ref().unwrap().sources[0].clone()
    };
    let first = at(0.0);
    for step in 1..=10 {
        let source = at(0.1 * step as f32);
        assert_eq!(source.id, first.id);
        let share = source.irradiance() / first.irradiance();
        assert!((share - 1.0).abs().max_element() < 0.03, "{share}");
    }
    assert_ne!(
        at(1.0).irradiance_in_faces[0].0,
        first.irradiance_in_faces[0].0
    );
}
