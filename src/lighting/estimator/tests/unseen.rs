//! Lamps that the environment camera does not see.

use super::*;
use crate::lamp_distance::{Hiding, UnseenLamp};

const ROOM: f32 = 0.2;

/// A rig whose environment camera stands 0.3 m above the ground.
fn rig() -> Rig {
    let mut view = fisheye(0.0);
    if let EnvironmentView::Fisheye {
        world_from_camera, ..
    } = &mut view
    {
        world_from_camera.translation = DVec3::new(0.0, 0.0, 0.3);
    }
    let mut rig = Rig::new(&view, EnvironmentSettings::default());
    rig.estimator.set_reference(DVec3::new(0.3, 0.0, 0.0));
    rig
}

/// A lamp in a direction, 0.8 m away.
fn lamp(direction: Vec3) -> UnseenLamp {
    UnseenLamp {
        direction: direction.normalize(),
        distance: LampDistance {
            inverse: 1.25,
            sigma: 0.1,
        },
        angular_radius: 0.05,
        irradiance: Vec3::new(2.0, 1.5, 1.0),
    }
}

fn light(rig: &mut Rig, lamps: &[UnseenLamp]) -> Arc<Lighting> {
    rig.estimator.set_unseen(lamps.iter().copied());
    rig.observe(&|_| Vec3::splat(ROOM), Vec3::splat(0.1))
}

#[test]
fn unseen_lamp_lights_from_its_place() {
    // The second is lower than the camera.
    for direction in [Vec3::new(0.5, -0.4, 0.6), Vec3::new(0.8, 0.3, -0.1)] {
        let (mut rig, lamp) = (rig(), lamp(direction));
        let without = light(&mut rig, &[]);
        let with = light(&mut rig, &[lamp]);
        let source = rig.estimator.sources()[0];
        assert!(source.is_unseen);
        assert_eq!(source.distance, lamp.distance);
        let observer = rig.estimator.observer().unwrap();
        let place = observer + lamp.direction.as_dvec3() * 0.8;
        assert!(
            source.position.unwrap().distance(place) < 1e-3,
            "{source:?}"
        );
        let compact = with.lights.iter();
        let compact = compact.filter(|l| l.kind == LightKind::Compact && l.irradiance.x > 0.0);
        for part in compact.clone() {
            let apart = part.position().unwrap().as_dvec3().distance(place);
            assert!(apart < 0.06, "{apart} {part:?}");
        }
        let reference = DVec3::new(0.3, 0.0, 0.0);
        let nearer = (0.8 / place.distance(reference)).powi(2) as f32;
        let sum: Vec3 = compact.map(|l| l.irradiance).sum();
        let expected = lamp.irradiance * nearer;
        assert!(
            sum.distance(expected) < 0.05 * expected.length(),
            "{sum} {expected}"
        );
        // It adds nothing to what comes from everywhere.
        let [a, b] = [&with, &without].map(|light| light.irradiance.irradiance(Vec3::Z));
        assert!(a.distance(b) < 0.02 * b.length(), "{a} {b}");
    }
}

#[test]
fn unseen_lamp_is_mirrored() {
    let (mut rig, lamp) = (rig(), lamp(Vec3::new(0.5, -0.4, 0.6)));
    let flux = |light: &Lighting| {
        let sources = light.radiance.compact_sources.iter();
        sources.map(|s| s.flux.dot(LUMINANCE)).sum::<f32>()
    };
    let [without, with] = [&[][..], &[lamp]].map(|lamps| flux(&light(&mut rig, lamps)));
    let place = rig.estimator.sources()[0].position.unwrap();
    let nearer = (0.8 / place.distance(DVec3::new(0.3, 0.0, 0.0))).powi(2) as f32;
    let expected = lamp.irradiance.dot(LUMINANCE) * nearer;
    assert!(
        (with - without - expected).abs() < 0.1 * expected,
        "{with} {without} {expected}"
    );
}

#[test]
fn unseen_lamp_is_not_taken_for_one_that_is_seen() {
    let direction = Vec3::new(0.5, -0.4, 0.6).normalize();
    let mut rig = rig();
    light(&mut rig, &[lamp(direction)]);
    let before = rig.estimator.sources()[0].id;
    // It comes into view, and counts as another one.
    rig.estimator.set_unseen([]);
    let room = |d: Vec3| Vec3::splat(ROOM + disc(d, direction, 0.1, 40.0));
    rig.observe(&room, Vec3::splat(0.1));
    let after = rig.estimator.sources()[0];
    assert!(!after.is_unseen && after.id != before, "{after:?}");
    assert_eq!(after.distance, LampDistance::FAR);
}

#[test]
fn dark_things_and_what_is_not_seen_may_hide_a_lamp() {
    let mut rig = rig();
    let dark = Vec3::new(-0.5, 0.5, 0.6).normalize();
    let room = |d: Vec3| Vec3::splat(ROOM * (1.0 + d.z) - disc(d, dark, 0.3, 0.15));
    rig.observe(&room, Vec3::splat(0.1));
    let hiding = rig.estimator.hiding();
    assert_eq!(hiding(dark), Hiding::DarkThing);
    assert_eq!(
        hiding(Vec3::new(1.0, 0.0, -0.5).normalize()),
        Hiding::NotSeen
    );
    assert_eq!(hiding(Vec3::Z), Hiding::Nothing);
}
