use super::*;
use crate::light::known_lamp::tests::lamp;
use penumbra_config::RoomLight;

pub(in crate::light) fn source(id: u32, azimuth: f32) -> CompactSource {
    CompactSource {
        id,
        viewpoint: Vec3::ZERO,
        direction: Vec3::new(azimuth.cos(), azimuth.sin(), 0.0),
        irradiance: Vec3::ONE,
        angular_radius: 0.05,
        distance: LampDistance::FAR,
        position: None,
        clipped: 0.0,
        lights: 1,
        is_unseen: false,
    }
}

#[test]
fn source_takes_over_the_factor_that_is_in_its_light() {
    let rays = Arc::new(RayCaster::from_parts(&[]));
    let rig = penumbra_rig_model::RigDocument::uncalibrated(64, 48).calibration;
    let mut places = LampPlaces::new(&rig, rays, &EnvironmentConfig::default());
    places.applied = vec![(Vec3::X, Vec3::splat(8.0)), (Vec3::Y, Vec3::splat(3.0))];
    let clipped = |azimuth| CompactSource {
        clipped: 0.9,
        ..source(1, azimuth)
    };
    assert_eq!(places.applied_to(&clipped(0.1)), Vec3::splat(8.0));
    assert_eq!(places.applied_to(&clipped(1.5)), Vec3::splat(3.0));
    assert_eq!(places.applied_to(&clipped(0.8)), Vec3::ONE);
    // None of its pixels was raised.
    assert_eq!(places.applied_to(&source(1, 0.1)), Vec3::ONE);
}

#[test]
fn stated_lamp_that_is_clipped_settles_like_a_new_one() {
    let rays = Arc::new(RayCaster::from_parts(&[]));
    let rig = penumbra_rig_model::RigDocument::uncalibrated(64, 48).calibration;
    let mut places = LampPlaces::new(&rig, rays, &EnvironmentConfig::default());
    places.stated = StatedLights::new(&[RoomLight::Lamp {
        position: [1.0, 0.0, 0.0],
    }]);
    assert!(places.place_stated(&[source(1, 0.0)], DVec3::ZERO));
    assert_eq!(places.settling, 0);
    places.rests = INTERVAL;
    let clipped = CompactSource {
        clipped: 0.9,
        ..source(2, 0.0)
    };
    assert!(places.place_stated(&[clipped], DVec3::ZERO));
    assert_eq!((places.settling, places.rests), (SETTLING, 0));
}

#[test]
fn lamp_stays_where_it_is_while_the_ball_is_carried() {
    let rays = Arc::new(RayCaster::from_parts(&[]));
    let rig = penumbra_rig_model::RigDocument::uncalibrated(64, 48).calibration;
    let mut places = LampPlaces::new(&rig, rays, &EnvironmentConfig::default());
    let near = LampDistance {
        inverse: 2.0,
        sigma: 0.1,
    };
    places.known = vec![Known {
        distance: near,
        ..lamp()
    }];
    let sources = [source(1, 0.0)];
    places.move_observer(&sources, DVec3::ZERO);
    assert_eq!(places.known[0].distance, near);
    places.move_observer(&sources, DVec3::X * 0.3);
    let now = places.known[0].distance;
    assert!((now.inverse - 5.0).abs() < 1e-4, "{now:?}");
    assert!((now.sigma - 0.625).abs() < 1e-4, "{now:?}");
}

#[test]
fn source_that_is_gone_may_have_moved() {
    let gone = source(1, 0.0);
    let before = [gone, source(2, 1.0)];
    let dim = CompactSource {
        irradiance: Vec3::splat(0.5),
        ..source(3, 2.0)
    };
    assert!(has_moved(&gone, &before, &[source(2, 1.0), source(3, 2.0)]));
    assert!(!has_moved(&gone, &before, &[source(2, 1.0), dim]));
    assert!(!has_moved(&gone, &before, &[source(2, 1.0)]));
}
