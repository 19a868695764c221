//! Light that virtual objects reflect onto the real scene.

use crate::stage::{Stage, cell, lighting, painted, part, sun};
use glam::{DVec3, Vec3};
use penumbra_scene::ShadowMode;
use penumbra_scene::indirect_light::{GROUND_SIDE, Irradiance, OnReal, VOLUME_SIZE};
use penumbra_scene::{
    GroundBrightness, IndirectLight, IndirectLightSolver, Material, RealSurfaces, casters,
    primitives,
};
use std::f32::consts::PI;

/// The same irradiance everywhere in a region of half a metre.
fn even(change: Vec3, real: Vec3) -> IndirectLight {
    let ground = |value: Vec3| vec![value; (GROUND_SIDE * GROUND_SIDE) as usize];
    let fill = |value: Vec3| OnReal {
        ground: ground(value),
        ..OnReal::default()
    };
    let probes = VOLUME_SIZE.iter().product::<u32>() as usize;
    IndirectLight {
        generation: 1,
        low: Vec3::new(-0.25, -0.25, 0.0),
        high: Vec3::new(0.25, 0.25, 0.3),
        change: fill(change),
        real: fill(real),
        real_now: Irradiance {
            ground: ground(real),
            volume: std::array::from_fn(|_| vec![real; probes]),
        },
        ..IndirectLight::default()
    }
}

/// A small object in the air, a sun that casts its shadow far aside, light from above.
fn stage() -> Stage {
    let mut stage = Stage::new(128, 96)
        .with_virtual(part(
            primitives::cuboid(Vec3::splat(0.02)),
            DVec3::new(0.0, 0.1, 0.2),
        ))
        .lit(lighting(
            vec![
                sun(Vec3::new(-1.0, 1.0, 0.3), Vec3::splat(0.5)),
                cell(Vec3::new(0.0, -0.1, 1.0), Vec3::splat(1.0)),
            ],
            0.0,
        ));
    stage.pose = Some(crate::stage::looking_from(
        DVec3::new(0.0, -1e-4, 1.2),
        DVec3::ZERO,
    ));
    stage
}

/// Code of a red of 180 in linear light times `factor` plus `more`.
fn red(stage: &Stage, factor: f32, more: f32) -> u8 {
    let linear = stage.response.linear_from_code()[180] * factor + more;
    stage.response.code_from_linear(linear)
}

#[test]
fn indirect_light_brightens_its_region_alone() {
    let mut stage = stage();
    stage.near = Some(even(Vec3::splat(0.3), Vec3::ZERO));
    let arriving: f32 = stage
        .lighting
        .as_ref()
        .unwrap()
        .lights
        .iter()
        .map(|l| l.irradiance.x * l.direction.z)
        .sum();
    for mode in [ShadowMode::Ratio, ShadowMode::Subtract] {
        stage.mode = mode;
        let ours = stage.compose();
        let expected = match mode {
            ShadowMode::Ratio => red(&stage, 1.0 + 0.3 / arriving, 0.0),
            ShadowMode::Subtract => red(&stage, 1.0, 0.3 / PI),
        };
        // 128 pixels per metre at a distance of 1.2 m: the region is 53 pixels wide.
        let (cx, cy) = (63, 48);
        let mut inside = 0;
        for (x, y) in (0..96).flat_map(|y| (0..128).map(move |x| (x, y))) {
            let far = (x as i32 - cx).abs().max((y as i32 - cy).abs());
            let object = (x as i32 - cx).abs() < 8 && (y as i32 - cy + 13).abs() < 10;
            let code = ours.rgb(x, y)[0];
            if far < 24 && !object {
                inside += 1;
                let close = code.abs_diff(expected) <= 1;
                assert!(close, "{mode:?} ({x}, {y}): {code} {expected}");
            } else if far > 30 {
                assert_eq!(ours.rgb(x, y), [180, 150, 120], "({x}, {y})");
            }
        }
        assert!(inside > 1500, "{inside}");
    }
}

#[test]
fn no_indirect_light_without_virtual_objects_or_strength() {
    let mut stage = stage();
    stage.near = Some(even(Vec3::splat(0.3), Vec3::splat(0.1)));
    stage.show_virtual = false;
    assert!(stage.compose() == stage.picture);
    stage.show_virtual = true;
    stage.pose = None;
    assert!(stage.compose() == stage.picture);
    stage.pose = self::stage().pose;
    stage.strength = 0.0;
    assert_eq!(stage.compose().rgb(70, 60), [180, 150, 120]);
}

/// The picture of a wall beside a glowing object gains what the points on the wall receive.
#[test]
fn wall_is_lit_as_the_points_on_it_are() {
    let towards = Vec3::new(0.0, -1.0, 0.5).normalize();
    let wall = primitives::cuboid(Vec3::new(0.4, 0.1, 0.25));
    let glowing = Material {
        base_colour: Vec3::ZERO.extend(1.0),
        emissive: Vec3::splat(3.0),
        ..Material::default()
    };
    let column = primitives::cuboid(Vec3::new(0.1, 0.1, 0.2));
    let light = lighting(vec![cell(towards, Vec3::ONE)], 0.0);
    let mut stage = Stage::new(128, 96)
        .with_virtual(painted(column, DVec3::new(0.16, -0.1, 0.0), glowing))
        .with_phantom(part(wall, DVec3::new(0.0, 0.05, 0.0)))
        .lit(light.clone());
    stage.pose = Some(crate::stage::looking_from(
        DVec3::new(0.0, -0.8, 0.12),
        DVec3::new(0.0, 0.0, 0.12),
    ));
    let real = RealSurfaces {
        phantoms: &[[Vec3::ZERO; 6]],
        ground: &GroundBrightness::default(),
    };
    let mut near = IndirectLightSolver::new(&stage.scene, &casters(&stage.scene)).unwrap();
    near.update(&light, real, &[]);
    let near = near.light().clone();
    let gained = near
        .change
        .surfaces
        .on(Vec3::new(0.0, 0.0, 0.12), Vec3::NEG_Y);
    assert!(gained.x > 0.1 && gained.w > 0.9, "{gained}");
    stage.near = Some(near);
    let expected = red(&stage, 1.0 + gained.x * gained.w / -towards.y, 0.0);
    let code = stage.compose().rgb(64, 48)[0];
    assert!(code.abs_diff(expected) <= 2, "{code} {expected}");
}
