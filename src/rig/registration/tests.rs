use super::*;
use glam::DQuat;
use penumbra_camera::Response;
use penumbra_fiducials::synthetic;
use penumbra_status::RegistrationSource;

mod rolling;
mod webcam;

/// Number of the marker that carries the sphere.
const SPHERE_MARKER: u32 = 7;
const SIZE: f64 = 0.06;
const UNTRACKED: TrackerEstimate = TrackerEstimate {
    pose: None,
    motion: None,
};
/// Centre of the sphere, in the frame of the marker that carries it or in the map, metres.
const SPHERE_CENTRE: DVec3 = DVec3::new(0.08, 0.0, -0.035);

/// Oblique view of the map from half a metre.
fn camera_from_map() -> RigidTransform {
    RigidTransform::new(
        DQuat::from_euler(glam::EulerRot::XYZ, 0.35, -0.2, 0.1),
        DVec3::new(0.02, -0.03, 0.5),
    )
}

fn registration(
    map: Option<TagMap>,
    fixed_sphere: Option<DVec3>,
    has_marked_sphere: bool,
) -> TagRegistration {
    let marker = SphereMarker {
        family: Family::Tag36h11,
        id: SPHERE_MARKER,
        size: SIZE,
        centre_in_marker: SPHERE_CENTRE,
    };
    TagRegistration {
        detector: Detector::new(&[Family::Tag36h11], &Response::srgb()),
        camera: synthetic::camera(),
        row_seconds: 0.0,
        registrar: map.map(Registrar::new),
        hybrid: None,
        rejected: 0,
        marked_sphere: has_marked_sphere.then_some(MarkedSphere {
            marker,
            last_pose: None,
        }),
        fixed_sphere,
        placed_ball: None,
        refiner: None,
    }
}

fn picture(tags: &[Tag]) -> Picture {
    let camera = synthetic::camera();
    let codes = synthetic::render(&camera, camera_from_map(), tags, 1.0);
    Picture {
        width: camera.width,
        height: camera.height,
        rgba: codes.iter().flat_map(|&c| [c, c, c, 255]).collect(),
    }
}

fn at(k: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(k * 33_000_000)
}

#[test]
fn fixed_sphere_has_uncertainty_of_pose_and_needs_a_pose() {
    let tags = [synthetic::tag(3, SIZE, DVec3::ZERO)];
    let map = TagMap::new(tags.to_vec()).unwrap();
    let mut registration = registration(Some(map), Some(SPHERE_CENTRE), false);
    let result = registration.register(&picture(&tags), UNTRACKED, at(0));
    let sphere = result.sphere.unwrap();
    assert_eq!(sphere.centre_in_world, SPHERE_CENTRE);
    assert!((0.01..2.0).contains(&sphere.sigma), "{}", sphere.sigma);
    let camera = synthetic::camera();
    let pixel = |world_from_camera: RigidTransform| {
        let centre = world_from_camera.inverse().transform_point(SPHERE_CENTRE);
        camera.project(centre).unwrap()
    };
    let error =
        pixel(result.world_from_camera.unwrap()).distance(pixel(camera_from_map().inverse()));
    assert!(
        error < 4.0 * sphere.sigma + 0.3,
        "error {error} px, estimated {}",
        sphere.sigma
    );
    assert_eq!(result.status.source, RegistrationSource::Markers);
    // Hidden markers: no pose and no light from this picture, but the sphere's position stays
    // known.
    let hidden = registration.register(&picture(&[]), UNTRACKED, at(1));
    assert!(hidden.world_from_camera.is_none());
    assert!(hidden.sphere.is_none() && !hidden.is_sphere_lost);
    assert_eq!(hidden.status.source, RegistrationSource::None);
    let back = registration.register(&picture(&tags), UNTRACKED, at(2));
    assert!(back.sphere.is_some());
}

#[test]
fn marked_sphere_follows_its_marker_and_is_lost_with_it() {
    let mut registration = registration(None, None, true);
    let tracked = TrackerEstimate {
        pose: Some(TrackerPose {
            world_from_camera: camera_from_map().inverse(),
            noise: [0.0; 2],
        }),
        motion: None,
    };
    for (k, marker_at) in [DVec3::ZERO, DVec3::new(-0.06, 0.05, 0.0)]
        .into_iter()
        .enumerate()
    {
        let seen = picture(&[synthetic::tag(SPHERE_MARKER, SIZE, marker_at)]);
        let result = registration.register(&seen, tracked, at(k as i64));
        let sphere = result.sphere.unwrap();
        let error = sphere.centre_in_world.distance(marker_at + SPHERE_CENTRE);
        // A degree of the marker's tilt displaces the sphere by 1.5 mm.
        assert!(error < 0.006, "{error} m");
        assert!(!result.is_sphere_lost && result.status.source == RegistrationSource::Tracker);
    }
    let hidden = registration.register(&picture(&[]), tracked, at(2));
    assert!(hidden.is_sphere_lost && hidden.sphere.is_none());
    assert_eq!(
        hidden.world_from_camera,
        tracked.pose.map(|t| t.world_from_camera)
    );
    // Two markers with the sphere's number are ambiguous.
    let twice = [
        synthetic::tag(SPHERE_MARKER, SIZE, DVec3::new(-0.08, 0.0, 0.0)),
        synthetic::tag(SPHERE_MARKER, SIZE, DVec3::new(0.08, 0.0, 0.0)),
    ];
    let ambiguous = registration.register(&picture(&twice), tracked, at(3));
    assert!(ambiguous.is_sphere_lost);
    let back = registration.register(
        &picture(&[synthetic::tag(SPHERE_MARKER, SIZE, DVec3::ZERO)]),
        tracked,
        at(4),
    );
    assert!(!back.is_sphere_lost);
    // Without the camera's pose, the sphere's position in the world is unknown.
    let without_pose = registration.register(
        &picture(&[synthetic::tag(SPHERE_MARKER, SIZE, DVec3::ZERO)]),
        UNTRACKED,
        at(5),
    );
    assert!(without_pose.sphere.is_none() && without_pose.is_sphere_lost);
}
