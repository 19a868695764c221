use super::*;
use glam::{DQuat, Vec3};
use penumbra_interface::MonotonicTime;
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace};
use penumbra_scene::motion::{Channel, Easing, Track};
use penumbra_scene::{GroundBrightness, Material, Motion, Mover, casters, primitives};
use std::sync::Arc;
use std::time::Instant;

/// A red box that moves along x at 0.4 m/s.
fn scene() -> Scene {
    let red = Material {
        base_colour: Vec3::X.extend(1.0),
        ..Material::default()
    };
    let part = Part {
        name: "box".into(),
        mesh: Arc::new(primitives::torus(0.08, 0.03, 64, 48)),
        material: Arc::new(red),
        world_from_part: DMat4::from_translation(DVec3::Z * 0.04),
        mirror: false,
        albedo: None,
    };
    let way = vec![DVec3::Z * 0.04, DVec3::new(0.4, 0.0, 0.04)];
    let track = Track {
        position: Channel::new(vec![0.0, 1.0], way, Easing::Linear),
        ..Track::resting(DVec3::ZERO, DQuat::IDENTITY, DVec3::ONE)
    };
    let motion = Motion::default().then_along(Arc::new(track));
    let mut scene = Scene {
        virtual_parts: vec![part],
        ground_height: Some(0.0),
        ..Scene::default()
    };
    scene.motions.parts = vec![Mover { index: 0, motion }];
    scene
}

fn lighting(generation: u64) -> Lighting {
    let light = DomeLight {
        direction: Vec3::new(0.6, 0.0, 0.8),
        irradiance: Vec3::ONE,
        angular_radius: 0.1,
        kind: LightKind::Cell,
        place: LightPlace::FAR,
    };
    Lighting {
        captured_at: MonotonicTime::from_nanos(0),
        generation,
        radiance: Arc::new(CubeMap {
            size: 1,
            levels: vec![vec![[1.0; 3]; 6]],
            ..CubeMap::default()
        }),
        irradiance: Harmonics::default(),
        lights: vec![light],
        // The ground reflects two fifths of it.
        ground_radiance: Vec3::splat(0.1),
        faces: None,
    }
}

#[test]
fn indirect_light_follows_a_moving_part() {
    let none = RealSurfaces {
        phantoms: &[],
        ground: &GroundBrightness::default(),
    };
    let scene = scene();
    let mut updater = IndirectLightUpdater::new(&scene, &casters(&scene));
    let low = |updater: &IndirectLightUpdater| updater.light().unwrap().low.x;
    updater.update(0.0, &lighting(1), none);
    let (first, generation) = (low(&updater), updater.light().unwrap().generation);
    let begun = Instant::now();
    for (i, seconds) in [0.2, 0.4, 0.49].into_iter().enumerate() {
        updater.update(seconds, &lighting(2 + i as u64), none);
        assert_eq!(low(&updater), first, "{seconds} s");
    }
    // The solution started at 0 s is shown from 0.5 to 1 s and was solved for 0.75 s.
    updater.update(0.5, &lighting(5), none);
    eprintln!("found in {:.0} ms", begun.elapsed().as_secs_f64() * 1e3);
    let moved = updater.light().unwrap();
    assert!((moved.low.x - first - 0.3).abs() < 1e-6, "{}", moved.low);
    assert!(moved.generation > generation + 3);
    let mut there = scene.clone();
    there.place_at(0.75);
    let mut placed = IndirectLightUpdater::new(&there, &casters(&there));
    for generation in 1..4 {
        placed.update(0.75, &lighting(generation), none);
    }
    let sum = |light: &IndirectLight| light.change.ground.iter().copied().sum::<Vec3>();
    let (a, b) = (sum(moved), sum(placed.light().unwrap()));
    assert!(a.distance(b) < 0.01 * b.length(), "{a} {b}");
    // Time starts again.
    updater.update(0.0, &lighting(6), none);
    updater.update(0.5, &lighting(7), none);
    assert!((low(&updater) - first - 0.3).abs() < 1e-6);
}

#[test]
fn indirect_light_of_parts_at_rest_is_solved_once() {
    let none = RealSurfaces {
        phantoms: &[],
        ground: &GroundBrightness::default(),
    };
    let scene = scene();
    let mut updater = IndirectLightUpdater::new(&scene, &casters(&scene));
    // The motion ends after one second.
    updater.update(2.0, &lighting(1), none);
    updater.update(2.5, &lighting(2), none);
    assert!(updater.next.is_none());
    updater.update(3.0, &lighting(2), none);
    updater.update(3.5, &lighting(3), none);
    assert!(updater.next.is_none());
}
