#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
use super::*;
use glam::DQuat;
use penumbra_camera::Response;
use penumbra_fiducials::synthetic;
use penumbra_status::RegistrationSource;

mod rolling;

const CARRIER: u32 = 7;
const SIZE: f64 = 0.06;
const UNTRACKED: ByTracker = ByTracker {
    pose: None,
    motion: None,
};
/// Of the ball in the frame of the marker that carries it.
const BESIDE: DVec3 = DVec3::new(0.08, 0.0, -0.035);

/// Half a metre before the map, from aside.
fn camera_from_map() -> RigidTransform {
    RigidTransform::new(
        DQuat::from_euler(glam::EulerRot::XYZ, 0.35, -0.2, 0.1),
        DVec3::new(0.02, -0.03, 0.5),
    )
}

fn station(map: Option<TagMap>, ball: Option<DVec3>, carried: bool) -> TagRegistration {
    let marker = SphereMarker {
        family: Family::Tag36h11,
        id: CARRIER,
        size: SIZE,
        centre_in_marker: BESIDE,
    };
    TagRegistration {
        detector: Detector::new(&[Family::Tag36h11], &Response::srgb()),
        camera: synthetic::camera(),
        row_seconds: 0.0,
        registrar: map.map(Registrar::new),
        fusion: None,
        rejected: 0,
        probe: carried.then_some(Probe { marker, last: None }),
        ball,
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
fn a_ball_beside_a_marker_is_told_with_the_poses_uncertainty_and_not_without_it() {
    let tags = [synthetic::tag(3, SIZE, DVec3::ZERO)];
    let map = TagMap::new(tags.to_vec()).unwrap();
    let mut station = station(Some(map), Some(BESIDE), false);
    let told = station.register(&picture(&tags), UNTRACKED, at(0));
    let ball = told.ball.unwrap();
    assert_eq!(ball.centre_in_world, BESIDE);
    assert!((0.01..2.0).contains(&ball.sigma), "{}", ball.sigma);
    let camera = synthetic::camera();
    let place = |world_from_camera: RigidTransform| {
        let centre = world_from_camera.inverse().transform_point(BESIDE);
        camera.project(centre).unwrap()
    };
    let off = place(told.world_from_camera.unwrap()).distance(place(camera_from_map().inverse()));
    assert!(
        off < 4.0 * ball.sigma + 0.3,
        "{off} px, said {}",
        ball.sigma
    );
    assert_eq!(told.status.source, RegistrationSource::Markers);
    // Hidden: no pose, so no light is taken from this picture, and the ball is not lost for good.
    let hidden = station.register(&picture(&[]), UNTRACKED, at(1));
    assert!(hidden.world_from_camera.is_none() && hidden.ball.is_none() && !hidden.ball_lost);
    assert_eq!(hidden.status.source, RegistrationSource::None);
    let back = station.register(&picture(&tags), UNTRACKED, at(2));
    assert!(back.ball.is_some());
}

#[test]
fn a_carried_ball_goes_where_its_marker_goes_and_is_lost_with_it() {
    let mut station = station(None, None, true);
    let tracked = ByTracker {
        pose: Some(TrackerPose {
            world_from_camera: camera_from_map().inverse(),
            noise: [0.0; 2],
        }),
        motion: None,
    };
    for (k, place) in [DVec3::ZERO, DVec3::new(-0.06, 0.05, 0.0)]
        .into_iter()
        .enumerate()
    {
        let seen = picture(&[synthetic::tag(CARRIER, SIZE, place)]);
        let told = station.register(&seen, tracked, at(k as i64));
        let off = told.ball.unwrap().centre_in_world.distance(place + BESIDE);
        // A degree of the marker's tilt is 1.5 mm at the ball.
        assert!(off < 0.006, "{off} m");
        assert!(!told.ball_lost && told.status.source == RegistrationSource::Tracker);
    }
    let hidden = station.register(&picture(&[]), tracked, at(2));
    assert!(hidden.ball_lost && hidden.ball.is_none());
    assert_eq!(
        hidden.world_from_camera,
        tracked.pose.map(|t| t.world_from_camera)
    );
    // Of two with its number neither is believed.
    let twice = [
        synthetic::tag(CARRIER, SIZE, DVec3::new(-0.08, 0.0, 0.0)),
        synthetic::tag(CARRIER, SIZE, DVec3::new(0.08, 0.0, 0.0)),
    ];
    assert!(station.register(&picture(&twice), tracked, at(3)).ball_lost);
    let back = station.register(
        &picture(&[synthetic::tag(CARRIER, SIZE, DVec3::ZERO)]),
        tracked,
        at(4),
    );
    assert!(!back.ball_lost);
    // Without the camera's pose the marker tells nothing of the world.
    let adrift = station.register(
        &picture(&[synthetic::tag(CARRIER, SIZE, DVec3::ZERO)]),
        UNTRACKED,
        at(5),
    );
    assert!(adrift.ball.is_none() && adrift.ball_lost);
}
