use super::super::rays::RandomIndices;
use super::super::view::View;
use super::*;
use glam::{DQuat, DVec2};
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

fn ground_truth() -> RigidTransform {
    let rotation = DQuat::from_euler(glam::EulerRot::ZYX, 0.7, 0.2, -0.15);
    RigidTransform::new(rotation, DVec3::new(0.1, -0.05, 0.06))
}

/// Observations of points about the camera, with noise in pixels.
fn observations(count: usize, noise: f64, far: bool) -> Vec<Observation> {
    let mut random = RandomIndices::new();
    let mut even = move || random.below(1000) as f64 / 500.0 - 1.0;
    let camera = ground_truth().inverse();
    (0..count)
        .map(|_| {
            let (phi, theta) = (std::f64::consts::PI * even(), 0.7 + 0.6 * even());
            let d = DVec3::new(
                theta.sin() * phi.cos(),
                theta.sin() * phi.sin(),
                theta.cos(),
            );
            let point = ground_truth().transform_point(d * (0.5 + 0.3 * even()));
            let seen = if far {
                d
            } else {
                camera.transform_point(point)
            };
            let target = if far {
                Target::Direction(ground_truth().rotation * d)
            } else {
                Target::Point(point)
            };
            Observation {
                bearing: bearing(view().pixel(seen).unwrap() + noise * DVec2::new(even(), even())),
                target,
                sigma: (noise / 1.7).max(0.1) / 151.0,
            }
        })
        .collect()
}

fn check(found: &Resection, degrees: f64, metres: f64) {
    let angle = found
        .world_from_camera
        .rotation
        .angle_between(ground_truth().rotation)
        .to_degrees();
    let error = found
        .world_from_camera
        .translation
        .distance(ground_truth().translation);
    assert!(
        angle < degrees && error < metres,
        "{angle}° {error} m {found:?}"
    );
    assert!(
        angle.to_radians() < 5.0 * found.rotation_sigma.length() + 1e-6,
        "{angle} {}",
        found.rotation_sigma
    );
}

#[test]
fn points_determine_pose_without_initial_pose_despite_outliers() {
    let mut observations = observations(16, 1.0, false);
    let found = resect(&observations, Unknowns::Pose, None).unwrap();
    check(&found, 0.5, 0.01);
    for k in [1, 6, 11, 14] {
        observations[k].bearing = DVec3::new((k as f64).sin(), 0.4, 1.0).normalize();
    }
    let found = resect(&observations, Unknowns::Pose, None).unwrap();
    check(&found, 0.6, 0.012);
    assert_eq!(
        found.kept.iter().filter(|k| !**k).count(),
        4,
        "{:?}",
        found.kept
    );
}

#[test]
fn directions_determine_orientation() {
    let found = resect(
        &observations(3, 0.5, true),
        Unknowns::Orientation(ground_truth().translation),
        None,
    )
    .unwrap();
    check(&found, 0.5, 1e-9);
    let mut wrong = observations(9, 0.5, true);
    wrong[2].bearing = (wrong[2].bearing + DVec3::new(0.3, 0.0, 0.1)).normalize();
    let found = resect(
        &wrong,
        Unknowns::Orientation(ground_truth().translation),
        None,
    )
    .unwrap();
    check(&found, 0.3, 1e-9);
    assert!(!found.kept[2]);
}

#[test]
fn close_tag_determines_pose() {
    let corner = |x: f64, y: f64| {
        let point = DVec3::new(0.25 + x, 0.1 + y, 0.2);
        let pixel = view()
            .pixel(ground_truth().inverse().transform_point(point))
            .unwrap();
        Observation {
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
    let found = resect(&seen, Unknowns::Pose, Some(ground_truth())).unwrap();
    check(&found, 0.1, 0.002);
}

#[test]
fn reports_undetermined_poses() {
    let seen = observations(3, 0.2, false);
    assert_eq!(
        resect(&seen, Unknowns::Pose, None),
        Err(NoPose::TooFew {
            known: 3,
            needed: 4
        })
    );
    let one = vec![seen[0]; 6];
    assert!(matches!(
        resect(&one, Unknowns::Orientation(DVec3::ZERO), None),
        Err(NoPose::OneDirection { .. })
    ));
    let mut mixed = observations(10, 0.2, true);
    mixed.rotate_left(1);
    let targets: Vec<Target> = mixed.iter().map(|s| s.target).collect();
    for (s, t) in mixed.iter_mut().zip(targets.iter().cycle().skip(3)) {
        s.target = *t;
    }
    let refused = resect(&mixed, Unknowns::Orientation(DVec3::ZERO), None);
    assert!(
        matches!(refused, Err(NoPose::Inconsistent { .. })),
        "{refused:?}"
    );
    let outside = Observation {
        bearing: DVec3::NAN,
        ..seen[0]
    };
    assert!(resect(&[outside; 5], Unknowns::Pose, None).is_err());
}
