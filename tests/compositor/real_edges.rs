//! Edges of the real scene whose proxies are slightly displaced.

use crate::stage::{Stage, cell, lighting, looking_from, part, sun};
use glam::{DVec3, Vec3};
use penumbra_scene::primitives;

const SUN: f32 = 2.0;
const SKY: f32 = 1.0;

/// A wall whose real shadow ends along a line inside a virtual slab's shadow, seen from above; in
/// the picture that line is displaced by `offset` pixels from the shadow of the wall's proxy.
fn stage(offset: i32) -> Stage {
    let mut stage = Stage::new(128, 96)
        .with_phantom(part(
            primitives::cuboid(Vec3::new(0.1, 0.8, 0.1)),
            DVec3::new(-0.25, 0.0, 0.0),
        ))
        .with_virtual(part(
            primitives::cuboid(Vec3::new(0.3, 0.8, 0.005)),
            DVec3::new(-0.4, 0.0, 0.3),
        ))
        .lit(lighting(
            vec![
                sun(Vec3::new(-1.0, 0.0, 1.0), Vec3::splat(SUN)),
                cell(Vec3::Z, Vec3::splat(SKY)),
            ],
            0.0,
        ));
    stage.pose = Some(looking_from(DVec3::new(0.0, -1e-4, 1.2), DVec3::ZERO));
    let lit = stage.response.linear_from_code()[180];
    let shadowed = stage.response.code_from_linear(lit * in_shadow());
    // The wall's shadow ends at x = -0.1 m.
    let edge = pixel(&stage, -0.1) + offset;
    for y in 0..96 {
        for x in 0..edge.max(0) {
            let i = 4 * (y * 128 + x as usize);
            stage.picture.rgba[i..i + 3].fill(shadowed);
        }
        for x in edge.max(0)..128 {
            let i = 4 * (y * 128 + x as usize);
            stage.picture.rgba[i..i + 3].fill(180);
        }
    }
    stage
}

fn in_shadow() -> f32 {
    SKY / (SKY + SUN * std::f32::consts::FRAC_1_SQRT_2)
}

/// Column of a ground point.
fn pixel(stage: &Stage, x: f64) -> i32 {
    (stage.camera.centre.x + stage.camera.focal.x * x / 1.2).round() as i32
}

#[test]
fn displaced_real_shadow_inside_a_virtual_one_leaves_no_line() {
    for offset in [-2, 0, 2] {
        let stage = stage(offset);
        let expected = stage.picture.rgb(pixel(&stage, -0.15) as u32, 48)[0];
        let ours = stage.compose();
        for x in pixel(&stage, -0.16)..pixel(&stage, -0.03) {
            for y in 20..76 {
                let code = ours.rgb(x as u32, y)[0];
                let off = code.abs_diff(expected);
                assert!(
                    off <= 3,
                    "{offset}: ({x}, {y}): {code} instead of {expected}"
                );
            }
        }
    }
}
