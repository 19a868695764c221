#![allow(clippy::unwrap_used)]
use super::super::rays::Dice;
use super::super::view::View;
use super::*;
use glam::DVec2;
use penumbra_camera::FisheyeLens;

fn view() -> View {
    View::Fisheye(FisheyeLens {
        width: 480,
        height: 480,
        focal: 151.0,
        centre: DVec2::new(241.0, 238.0),
        distortion: [0.0; 4],
        max_theta: 1.57,
    })
}

fn bearing(pixel: DVec2) -> DVec3 {
    view().bearing(pixel).unwrap()
}

fn truth() -> RigidTransform {
    let turn = DQuat::from_euler(glam::EulerRot::ZYX, 0.7, 0.2, -0.15);
    RigidTransform::new(turn, DVec3::new(0.1, -0.05, 0.06))
}

/// Points about the camera, seen with so much noise (pixels).
fn sights(count: usize, noise: f64, far: bool) -> Vec<Sight> {
    let mut dice = Dice::new();
    let mut even = move || dice.below(1000) as f64 / 500.0 - 1.0;
    let camera = truth().inverse();
    (0..count)
        .map(|_| {
            let (phi, theta) = (std::f64::consts::PI * even(), 0.7 + 0.6 * even());
            let d = DVec3::new(
                theta.sin() * phi.cos(),
                theta.sin() * phi.sin(),
                theta.cos(),
            );
            let point = truth().transform_point(d * (0.5 + 0.3 * even()));
            let seen = if far {
                d
            } else {
                camera.transform_point(point)
            };
            let target = if far {
                Target::Direction(truth().rotation * d)
            } else {
                Target::Point(point)
            };
            Sight {
                bearing: bearing(view().pixel(seen).unwrap() + noise * DVec2::new(even(), even())),
                target,
                sigma: (noise / 1.7).max(0.1) / 151.0,
            }
        })
        .collect()
}

fn check(found: &Placed, degrees: f64, metres: f64) {
    let turn = found
        .world_from_camera
        .rotation
        .angle_between(truth().rotation)
        .to_degrees();
    let off = found
        .world_from_camera
        .translation
        .distance(truth().translation);
    assert!(turn < degrees && off < metres, "{turn}° {off} m {found:?}");
    assert!(
        turn.to_radians() < 5.0 * found.turn_sigma.length() + 1e-6,
        "{turn} {}",
        found.turn_sigma
    );
}

#[test]
fn points_give_the_pose_without_a_start_though_a_quarter_are_wrong() {
    let mut sights = sights(16, 1.0, false);
    let found = place(&sights, Unknowns::Pose, None).unwrap();
    check(&found, 0.5, 0.01);
    for k in [1, 6, 11, 14] {
        sights[k].bearing = DVec3::new((k as f64).sin(), 0.4, 1.0).normalize();
    }
    let found = place(&sights, Unknowns::Pose, None).unwrap();
    check(&found, 0.6, 0.012);
    assert_eq!(
        found.kept.iter().filter(|k| !**k).count(),
        4,
        "{:?}",
        found.kept
    );
}

#[test]
fn directions_give_the_orientation() {
    let found = place(
        &sights(3, 0.5, true),
        Unknowns::Turn(truth().translation),
        None,
    )
    .unwrap();
    check(&found, 0.5, 1e-9);
    let mut wrong = sights(9, 0.5, true);
    wrong[2].bearing = (wrong[2].bearing + DVec3::new(0.3, 0.0, 0.1)).normalize();
    let found = place(&wrong, Unknowns::Turn(truth().translation), None).unwrap();
    check(&found, 0.3, 1e-9);
    assert!(!found.kept[2]);
}

#[test]
fn a_tag_close_to_the_camera_gives_its_pose() {
    let corner = |x: f64, y: f64| {
        let point = DVec3::new(0.25 + x, 0.1 + y, 0.2);
        let pixel = view()
            .pixel(truth().inverse().transform_point(point))
            .unwrap();
        Sight {
            bearing: bearing(pixel),
            target: Target::Point(point),
            sigma: 0.05 / 151.0,
        }
    };
    let seen = [
        corner(0.0, 0.0),
        corner(0.08, 0.0),
        corner(0.08, 0.08),
        corner(0.0, 0.08),
    ];
    let found = place(&seen, Unknowns::Pose, Some(truth())).unwrap();
    check(&found, 0.1, 0.002);
}

#[test]
fn what_leaves_the_pose_open_is_told() {
    let seen = sights(3, 0.2, false);
    assert_eq!(
        place(&seen, Unknowns::Pose, None),
        Err(NoPose::TooFew {
            known: 3,
            needed: 4
        })
    );
    let one = vec![seen[0]; 6];
    assert!(matches!(
        place(&one, Unknowns::Turn(DVec3::ZERO), None),
        Err(NoPose::OneDirection { .. })
    ));
    let mut mixed = sights(10, 0.2, true);
    mixed.rotate_left(1);
    let targets: Vec<Target> = mixed.iter().map(|s| s.target).collect();
    for (s, t) in mixed.iter_mut().zip(targets.iter().cycle().skip(3)) {
        s.target = *t;
    }
    let refused = place(&mixed, Unknowns::Turn(DVec3::ZERO), None);
    assert!(
        matches!(refused, Err(NoPose::Contradiction { .. })),
        "{refused:?}"
    );
    let outside = Sight {
        bearing: DVec3::NAN,
        ..seen[0]
    };
    assert!(place(&[outside; 5], Unknowns::Pose, None).is_err());
}
