//! Virtual lamps, against closed forms.

use crate::stage::{Stage, cell, flat, lighting, looking_from, noise, painted, part};
use glam::{DVec3, Vec3, Vec4};
use penumbra_compositor::CompositorSettings;
use penumbra_picture::Picture;
use penumbra_scene::ShadowMode;
use penumbra_scene::{Material, Part, PlacedLamp, primitives};
use std::f32::consts::PI;

/// Irradiance on the table without lamps.
const DAYLIGHT: Vec3 = Vec3::new(2.0, 1.8, 1.5);

fn point(position: Vec3, intensity: Vec3) -> PlacedLamp {
    PlacedLamp {
        position,
        direction: Vec3::NEG_Z,
        intensity,
        cone: None,
        area: None,
    }
}

/// A table under light from straight above, so that a box casts no shadow beside itself.
fn table(lamps: Vec<PlacedLamp>) -> Stage {
    let mut stage = Stage::new(160, 120).lit(lighting(vec![cell(Vec3::Z, DAYLIGHT)], 0.0));
    stage.picture = flat(160, 120, [90, 80, 70]);
    stage.pose = Some(looking_from(
        DVec3::new(0.05, -0.7, 0.7),
        DVec3::new(0.0, 0.0, 0.0),
    ));
    stage.lamps = lamps;
    stage
}

fn cuboid(size: Vec3, at: DVec3) -> Part {
    part(primitives::cuboid(size), at)
}

/// Codes of the pixel that shows a point of the world.
fn codes_at(stage: &Stage, picture: &Picture, world: Vec3) -> [u8; 3] {
    let pose = stage.pose.unwrap();
    let seen = pose.inverse().rotation * world.as_dvec3() + pose.inverse().translation;
    let pixel = stage.camera.project(seen).unwrap().round();
    assert!(
        pixel.x >= 0.0 && pixel.x < f64::from(stage.camera.width),
        "{pixel}"
    );
    assert!(
        pixel.y >= 0.0 && pixel.y < f64::from(stage.camera.height),
        "{pixel}"
    );
    picture.rgb(pixel.x as u32, pixel.y as u32)
}

/// Irradiance of an unshadowed lamp.
fn irradiance(lamp: &PlacedLamp, at: Vec3, n: Vec3) -> Vec3 {
    let off = lamp.position - at;
    let to = off.normalize();
    lamp.intensity * (lamp.falloff(-to) * to.dot(n).max(0.0) / off.length_squared())
}

#[track_caller]
fn assert_linear(stage: &Stage, picture: &Picture, at: Vec3, expected: Vec3, tolerance: u8) {
    let found = codes_at(stage, picture, at);
    let codes = expected
        .to_array()
        .map(|v| stage.response.code_from_linear(v));
    let off = (0..3).map(|c| found[c].abs_diff(codes[c])).max().unwrap();
    assert!(off <= tolerance, "{at}: {found:?}, expected {codes:?}");
}

fn camera_linear(stage: &Stage) -> Vec3 {
    Vec3::from(stage.response.linear_from_rgb(stage.picture.rgb(0, 0)))
}

/// Expected linear light of an unshadowed point of the table.
fn lit(stage: &Stage, at: Vec3) -> Vec3 {
    let added: Vec3 = stage.lamps.iter().map(|l| irradiance(l, at, Vec3::Z)).sum();
    match stage.mode {
        ShadowMode::Ratio => camera_linear(stage) * (DAYLIGHT + added) / DAYLIGHT,
        ShadowMode::Subtract => camera_linear(stage) + added / PI,
    }
}

#[test]
fn lamp_lights_the_table_by_cosine_and_inverse_square() {
    for height in [0.2, 0.4, 0.8] {
        for mode in [ShadowMode::Ratio, ShadowMode::Subtract] {
            let strong = Vec3::new(3.0, 2.0, 1.0) * (height * height);
            let mut stage = table(vec![point(Vec3::new(0.0, 0.0, height), strong)]);
            stage.mode = mode;
            let picture = stage.compose();
            for at in [
                Vec3::ZERO,
                Vec3::new(0.2, 0.1, 0.0),
                Vec3::new(-0.1, -0.2, 0.0),
            ] {
                assert_linear(&stage, &picture, at, lit(&stage, at), 2);
            }
        }
    }
}

#[test]
fn two_lamps_add_up() {
    let lamps = vec![
        point(Vec3::new(0.2, 0.0, 0.3), Vec3::new(0.2, 0.0, 0.0)),
        point(Vec3::new(-0.2, 0.1, 0.4), Vec3::new(0.0, 0.1, 0.3)),
    ];
    let stage = table(lamps);
    let picture = stage.compose();
    for at in [Vec3::ZERO, Vec3::new(0.2, 0.1, 0.0)] {
        assert_linear(&stage, &picture, at, lit(&stage, at), 2);
    }
}

#[test]
fn spot_fades_between_its_two_angles_and_changes_nothing_outside() {
    let mut lamp = point(Vec3::new(0.0, 0.0, 0.5), Vec3::splat(0.6));
    lamp.cone = Some((0.2, 0.5));
    let stage = table(vec![lamp]);
    let picture = stage.compose();
    for x in [0.0, 0.05, 0.15, 0.2, 0.24] {
        let at = Vec3::new(x, 0.0, 0.0);
        assert_linear(&stage, &picture, at, lit(&stage, at), 2);
    }
    // tan 0.5 × 0.5 m = 0.273 m.
    for at in [Vec3::new(0.3, 0.0, 0.0), Vec3::new(0.0, -0.3, 0.0)] {
        assert_eq!(codes_at(&stage, &picture, at), stage.picture.rgb(0, 0));
    }
}

#[test]
fn box_casts_its_shadow_away_from_the_lamp() {
    let lamp = point(Vec3::new(0.3, 0.0, 0.4), Vec3::splat(0.5));
    let cube = || cuboid(Vec3::splat(0.1), DVec3::ZERO);
    for (stage, tolerance) in [
        (table(vec![lamp]).with_virtual(cube()), 1),
        (table(vec![lamp]).with_phantom(cube()), 1),
    ] {
        let picture = stage.compose();
        // The far upper edge, x = −0.05 m, casts its shadow at 0.3 − 0.35 · 0.4 / 0.3 =
        // −0.1667 m; its ends, y = ±0.05 m, cast theirs at ±0.0667 m.
        for at in [[-0.155, 0.0], [-0.155, 0.055], [-0.09, -0.04]] {
            let at = Vec3::new(at[0], at[1], 0.0);
            assert_linear(&stage, &picture, at, camera_linear(&stage), tolerance);
        }
        for at in [[-0.18, 0.0], [-0.155, 0.08], [0.1, 0.0]] {
            let at = Vec3::new(at[0], at[1], 0.0);
            assert_linear(&stage, &picture, at, lit(&stage, at), 2);
        }
    }
}

#[test]
fn lamp_between_objects_casts_their_shadows_to_all_sides() {
    let lamp = point(Vec3::new(0.0, 0.0, 0.05), Vec3::splat(0.02));
    let post = |x: f64, y: f64| cuboid(Vec3::new(0.06, 0.06, 0.1), DVec3::new(x, y, 0.0));
    let mut stage = table(vec![lamp])
        .with_virtual(post(0.12, 0.0))
        .with_virtual(post(-0.12, 0.0))
        .with_phantom(post(0.0, 0.12));
    stage.pose = Some(looking_from(DVec3::new(0.0, -0.1, 1.2), DVec3::ZERO));
    let picture = stage.compose();
    for at in [[0.25, 0.0], [-0.25, 0.02], [0.0, 0.25], [0.03, 0.2]] {
        let at = Vec3::new(at[0], at[1], 0.0);
        assert_linear(&stage, &picture, at, camera_linear(&stage), 1);
    }
    for at in [
        [0.2, 0.2],
        [-0.15, 0.15],
        [0.0, -0.2],
        [0.05, 0.0],
        [0.0, 0.06],
    ] {
        let at = Vec3::new(at[0], at[1], 0.0);
        assert_linear(&stage, &picture, at, lit(&stage, at), 2);
    }
}

#[test]
fn white_virtual_surface_shows_irradiance_over_pi() {
    let lamp = point(Vec3::new(0.1, 0.05, 0.4), Vec3::new(0.3, 0.2, 0.1));
    let mut stage = Stage::new(160, 120)
        .without_ground()
        .with_virtual(part(primitives::plane(0.5, 0.5), DVec3::ZERO))
        .lit(lighting(Vec::new(), 0.0));
    stage.lamps = vec![lamp];
    stage.pose = Some(looking_from(DVec3::new(0.0, -0.4, 0.5), DVec3::ZERO));
    let picture = stage.compose();
    for at in [
        Vec3::ZERO,
        Vec3::new(0.1, 0.05, 0.0),
        Vec3::new(-0.1, 0.1, 0.0),
    ] {
        let expected = irradiance(&lamp, at, Vec3::Z) / PI;
        assert_linear(&stage, &picture, at, expected, 2);
    }
}

#[test]
fn rough_metal_reflects_a_lamp_at_the_eye_by_its_ggx_distribution() {
    // With light and eye at the same position, GGX with α = 1 is F0 / (4π n·l) at every angle.
    let eye = Vec3::new(0.0, -0.2, 0.5);
    let lamp = point(eye, Vec3::splat(0.8));
    let metal = Material {
        base_colour: Vec4::new(0.9, 0.6, 0.3, 1.0),
        metallic: 1.0,
        ..Material::default()
    };
    let mut stage = Stage::new(160, 120)
        .without_ground()
        .with_virtual(painted(primitives::plane(0.5, 0.5), DVec3::ZERO, metal))
        .lit(lighting(Vec::new(), 0.0));
    stage.lamps = vec![lamp];
    stage.pose = Some(looking_from(eye.as_dvec3(), DVec3::ZERO));
    let picture = stage.compose();
    for at in [Vec3::ZERO, Vec3::new(0.1, 0.05, 0.0)] {
        let facing = lamp.intensity / at.distance_squared(eye);
        let expected = Vec3::new(0.9, 0.6, 0.3) * facing / (4.0 * PI);
        assert_linear(&stage, &picture, at, expected, 2);
    }
}

#[test]
fn dark_distant_and_hidden_lamps_leave_every_code() {
    let full = {
        let mut stage = table(vec![point(Vec3::new(0.0, 0.0, 0.4), Vec3::ONE)]);
        stage.picture = noise(160, 120);
        stage
    };
    let mut compositor = full.compositor();
    assert!(full.compose_with(&mut compositor) != full.picture);
    type Case = (&'static str, fn(&mut Stage));
    let cases: [Case; 6] = [
        ("hidden", |s| s.show_virtual = false),
        ("no pose", |s| s.pose = None),
        ("no light", |s| s.lighting = None),
        ("dark", |s| s.lamps[0].intensity = Vec3::ZERO),
        ("far", |s| s.lamps[0].position.z = 1e4),
        ("gone", |s| s.lamps.clear()),
    ];
    for (what, change) in cases {
        let mut stage = full.clone();
        change(&mut stage);
        assert!(
            stage.compose_with(&mut compositor) == stage.picture,
            "{what}"
        );
    }
}

#[test]
fn shadow_maps_of_moved_lamps_and_casters_are_drawn_again() {
    let at = |x: f32| point(Vec3::new(x, 0.0, 0.4), Vec3::splat(0.4));
    let cube = |x: f64| cuboid(Vec3::splat(0.1), DVec3::new(x, 0.0, 0.0));
    let mut stage = table(vec![at(0.3)]).with_virtual(cube(0.0));
    let mut compositor = stage.compositor();
    let first = stage.compose_with(&mut compositor);
    stage.lamps = vec![at(-0.3), at(0.0)];
    let second = stage.compose_with(&mut compositor);
    assert!(second == stage.compose() && second != first);
    stage.scene.virtual_parts = vec![cube(0.1)];
    compositor.set_scene(&stage.scene, &penumbra_scene::casters(&stage.scene));
    assert!(stage.compose_with(&mut compositor) == stage.compose());
    compositor.set_light_budget(4);
    stage.settings = CompositorSettings {
        light_budget: 4,
        ..stage.settings
    };
    assert!(stage.compose_with(&mut compositor) == stage.compose());
}

#[test]
fn lamps_beyond_the_thirty_second_are_ignored() {
    let lamps: Vec<_> = (0..40)
        .map(|i| {
            point(
                Vec3::new(0.1 * (i % 12) as f32 - 0.4, 0.02 * i as f32, 0.05),
                Vec3::splat(1e-3),
            )
        })
        .collect();
    let mut stage = table(lamps)
        .with_virtual(cuboid(Vec3::splat(0.1), DVec3::new(-1.0, 0.0, 0.0)))
        .with_virtual(cuboid(Vec3::splat(0.1), DVec3::new(1.0, 0.0, 0.0)));
    let all = stage.compose();
    stage.lamps.truncate(32);
    assert!(all == stage.compose());
    stage.lamps.truncate(31);
    assert!(all != stage.compose());
}

#[test]
fn thirty_two_lamps_add_up() {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    let lamp = |i: usize| {
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = 0.3 * (i as f32 / 32.0).sqrt();
        let mut lamp = point(
            Vec3::new(r * cos, r * sin, 0.3),
            Vec3::new(0.01, 0.02, 0.03),
        );
        lamp.cone = (i % 2 == 1).then_some((0.1, 0.3));
        lamp
    };
    let stage = table((0..32).map(lamp).collect());
    let picture = stage.compose();
    for at in [[0.0, 0.0], [0.15, 0.1], [-0.2, -0.1], [0.05, -0.15]] {
        let at = Vec3::new(at[0], at[1], 0.0);
        assert_linear(&stage, &picture, at, lit(&stage, at), 2);
    }
}

#[test]
fn adding_and_removing_lamps_keeps_the_shadows_of_others() {
    let all: Vec<_> = (0..6)
        .map(|i| {
            point(
                Vec3::new(0.1 * i as f32 - 0.3, -0.1, 0.3),
                Vec3::splat(0.05),
            )
        })
        .collect();
    let mut stage = table(all.clone()).with_virtual(cuboid(Vec3::splat(0.1), DVec3::ZERO));
    let mut compositor = stage.compositor();
    for left in [0b11_1111, 0b10_1100, 0b01_0011, 0, 0b11_0001, 0b11_1111_u32] {
        let there = all.iter().enumerate().filter(|(i, _)| left >> i & 1 == 1);
        stage.lamps = there.map(|(_, lamp)| *lamp).collect();
        assert!(
            stage.compose_with(&mut compositor) == stage.compose(),
            "{left:b}"
        );
    }
}
