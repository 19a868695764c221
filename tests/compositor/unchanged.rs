//! Without virtual objects or shadows, a pixel is the camera's, bit for bit.

use crate::comparison::{assert_same_where, untouched};
use crate::stage::{Stage, lighting, noise, part, spiral, sun};
use glam::{DVec3, Vec3};
use penumbra_scene::ShadowMode;
use penumbra_scene::primitives;

const MODES: [ShadowMode; 2] = [ShadowMode::Ratio, ShadowMode::Subtract];

fn noisy(width: u32, height: u32) -> Stage {
    let mut stage = Stage::new(width, height);
    stage.picture = noise(width, height);
    stage.lit(lighting(spiral(8, 2.0), 0.5))
}

#[test]
fn every_code_is_kept_without_virtual_objects() {
    for (width, height) in [(96, 72), (101, 67), (7, 5), (1, 1)] {
        let mut stage = noisy(width, height)
            .with_phantom(part(primitives::cuboid(Vec3::splat(0.1)), DVec3::ZERO));
        let mut compositor = stage.compositor();
        for mode in MODES {
            for strength in [0.0, 1.0] {
                (stage.mode, stage.strength) = (mode, strength);
                let out = stage.compose_with(&mut compositor);
                assert!(out == stage.picture, "{width}×{height} {mode:?} {strength}");
            }
        }
    }
}

#[test]
fn every_code_is_kept_without_pose_or_light_or_when_hidden() {
    let full = noisy(101, 67).with_virtual(part(
        primitives::sphere(0.1, 24, 12),
        DVec3::new(0.0, 0.0, 0.1),
    ));
    let mut compositor = full.compositor();
    for mode in MODES {
        let mut stage = full.clone();
        stage.mode = mode;
        assert!(stage.compose_with(&mut compositor) != stage.picture);
        stage.pose = None;
        assert!(
            stage.compose_with(&mut compositor) == stage.picture,
            "no pose"
        );
        stage.pose = full.pose;
        stage.lighting = None;
        assert!(
            stage.compose_with(&mut compositor) == stage.picture,
            "no light"
        );
        stage.lighting.clone_from(&full.lighting);
        stage.show_virtual = false;
        assert!(
            stage.compose_with(&mut compositor) == stage.picture,
            "hidden"
        );
    }
}

#[test]
fn pixels_without_virtual_change_keep_the_cameras_codes() {
    for samples in [1, 4] {
        for mode in MODES {
            let mut stage = noisy(101, 67)
                .with_virtual(part(primitives::cuboid(Vec3::splat(0.1)), DVec3::ZERO))
                .with_phantom(part(
                    primitives::cuboid(Vec3::splat(0.08)),
                    DVec3::new(-0.15, 0.05, 0.0),
                ))
                .lit(lighting(
                    vec![sun(Vec3::new(-0.5, 0.4, 1.0), Vec3::ONE)],
                    0.0,
                ));
            stage.settings.samples = samples;
            stage.mode = mode;
            let far = untouched(&stage.twin(), 2);
            assert!(far.iter().filter(|f| **f).count() > 3000);
            let name = format!("untouched-{samples}-{mode:?}");
            assert_same_where(&name, &stage.compose(), &stage.picture, &far);
        }
    }
}

#[test]
fn shadows_of_zero_strength_keep_the_table_unchanged() {
    let mut stage =
        noisy(101, 67).with_virtual(part(primitives::cuboid(Vec3::splat(0.1)), DVec3::ZERO));
    stage.strength = 0.0;
    let far = untouched(&stage.twin(), 1);
    assert_same_where("no-strength", &stage.compose(), &stage.picture, &far);
}
