//! Rectangular lamps, against integrals over them.

use crate::stage::{Stage, cell, flat, lighting, looking_from, painted, part};
use glam::{DMat4, DVec2, DVec3, Vec3, Vec4};
use penumbra_compositor::reference::area::form_factor;
use penumbra_picture::Picture;
use penumbra_scene::{Material, Part, PlacedLamp, SceneTexture, primitives};
use penumbra_scene::{Screen, VirtualLight, VirtualLightKey, VirtualLightKind};
use std::f32::consts::PI;
use std::sync::Arc;

/// Irradiance on the table without lamps.
const DAYLIGHT: Vec3 = Vec3::new(2.0, 1.8, 1.5);

/// An invisible rectangular lamp.
pub fn area(position: DVec3, target: DVec3, size: DVec2, intensity: Vec3) -> VirtualLight {
    VirtualLight {
        name: "screen".into(),
        kind: VirtualLightKind::Area {
            half_size: 0.5 * size,
            up: DVec3::Y,
            two_sided: false,
        },
        intensity,
        screen: Some(Screen {
            texture: None,
            visible: false,
        }),
        keys: vec![VirtualLightKey {
            seconds: 0.0,
            position,
            target: Some(target),
            gain: 1.0,
        }],
        repeat: None,
    }
}

fn with_lamps(mut stage: Stage, lamps: Vec<VirtualLight>) -> Stage {
    stage.scene.lamps = lamps;
    stage.scene.lamps_at(0.0, &mut stage.lamps);
    stage
}

/// A table under even light from straight above.
fn table(lamps: Vec<VirtualLight>) -> Stage {
    let mut stage = Stage::new(160, 120).lit(lighting(vec![cell(Vec3::Z, DAYLIGHT)], 0.0));
    stage.picture = flat(160, 120, [90, 80, 70]);
    stage.pose = Some(looking_from(DVec3::new(0.05, -0.7, 0.7), DVec3::ZERO));
    with_lamps(stage, lamps)
}

fn tilted(mut part: Part, angle: f64) -> Part {
    part.world_from_part *= DMat4::from_rotation_x(angle);
    part
}

fn pixel_of(stage: &Stage, world: Vec3) -> (u32, u32) {
    let pose = stage.pose.unwrap();
    let seen = pose.inverse().rotation * world.as_dvec3() + pose.inverse().translation;
    let pixel = stage.camera.project(seen).unwrap().round();
    (pixel.x as u32, pixel.y as u32)
}

fn linear_at(stage: &Stage, picture: &Picture, world: Vec3) -> Vec3 {
    let (x, y) = pixel_of(stage, world);
    Vec3::from(stage.response.linear_from_rgb(picture.rgb(x, y)))
}

#[track_caller]
fn assert_linear(stage: &Stage, picture: &Picture, at: Vec3, expected: Vec3, tolerance: u8) {
    let (x, y) = pixel_of(stage, at);
    let found = picture.rgb(x, y);
    let codes = expected
        .to_array()
        .map(|v| stage.response.code_from_linear(v));
    let off = (0..3).map(|c| found[c].abs_diff(codes[c])).max().unwrap();
    assert!(off <= tolerance, "{at}: {found:?}, expected {codes:?}");
}

/// Irradiance of a uniform rectangle, by Lambert's formula.
fn irradiance(lamp: &PlacedLamp, at: Vec3, n: Vec3) -> Vec3 {
    let area = lamp.area.unwrap();
    let corners = area.corners(lamp.position - at).map(|c| c.as_dvec3());
    lamp.intensity / area.size() * (PI * form_factor(&corners, n.as_dvec3()) as f32)
}

fn camera_linear(stage: &Stage) -> Vec3 {
    Vec3::from(stage.response.linear_from_rgb(stage.picture.rgb(0, 0)))
}

fn lit(stage: &Stage, at: Vec3) -> Vec3 {
    let added: Vec3 = stage.lamps.iter().map(|l| irradiance(l, at, Vec3::Z)).sum();
    camera_linear(stage) * (DAYLIGHT + added) / DAYLIGHT
}

#[test]
fn rectangle_lights_the_table_from_near_and_far() {
    let strong = Vec3::new(0.5, 0.3, 0.2);
    for (height, share) in [(0.02, 0.05), (0.1, 0.2), (0.4, 1.0), (1.5, 8.0)] {
        let lamp = area(
            DVec3::new(0.02, 0.01, height),
            DVec3::new(0.02, 0.01, 0.0),
            DVec2::new(0.3, 0.2),
            strong * share,
        );
        let stage = table(vec![lamp.clone()]);
        let picture = stage.compose();
        for at in [[0.0, 0.0], [0.1, 0.05], [-0.1, -0.1], [0.2, 0.15]] {
            let at = Vec3::new(at[0], at[1], 0.0);
            assert_linear(&stage, &picture, at, lit(&stage, at), 2);
        }
    }
}

#[test]
fn upright_rectangle_lights_its_front_side_only() {
    // The rectangle extends through the table: the part below gives no light.
    let lamp = area(
        DVec3::new(0.0, 0.1, 0.05),
        DVec3::new(0.0, -1.0, 0.05),
        DVec2::new(0.2, 0.3),
        Vec3::splat(0.02),
    );
    let mut both = lamp.clone();
    if let VirtualLightKind::Area { two_sided, up, .. } = &mut both.kind {
        (*two_sided, *up) = (true, DVec3::Z);
    }
    let mut one = lamp;
    if let VirtualLightKind::Area { up, .. } = &mut one.kind {
        *up = DVec3::Z;
    }
    let (one, both) = (table(vec![one]), table(vec![both]));
    let pictures = (one.compose(), both.compose());
    for at in [[0.0, 0.0], [0.1, 0.06], [0.0, -0.2], [-0.25, 0.0]] {
        let at = Vec3::new(at[0], at[1], 0.0);
        assert_linear(&one, &pictures.0, at, lit(&one, at), 2);
        assert_linear(&both, &pictures.1, at, lit(&both, at), 2);
    }
    for at in [[0.0, 0.15], [0.2, 0.2]] {
        let at = Vec3::new(at[0], at[1], 0.0);
        assert_linear(&one, &pictures.0, at, camera_linear(&one), 0);
        assert_linear(&both, &pictures.1, at, lit(&both, at), 2);
    }
}

#[test]
fn slanted_virtual_surface_receives_light_from_above_its_horizon() {
    // Some parts of the lamp are so little above a slanted surface that it hides them itself.
    for (angle, tolerance) in [(0.0_f32, 2), (0.5, 4), (1.0, 4)] {
        let lamp = area(
            DVec3::new(0.0, 0.25, 0.1),
            DVec3::new(0.0, 0.0, 0.0),
            DVec2::new(0.4, 0.3),
            Vec3::new(0.1, 0.08, 0.06),
        );
        let white = tilted(
            part(primitives::plane(0.3, 0.3), DVec3::ZERO),
            f64::from(angle),
        );
        let mut stage = Stage::new(160, 120)
            .without_ground()
            .with_virtual(white)
            .lit(lighting(Vec::new(), 0.0));
        stage.pose = Some(looking_from(DVec3::new(0.0, -0.4, 0.5), DVec3::ZERO));
        let stage = with_lamps(stage, vec![lamp]);
        let picture = stage.compose();
        let (sin, cos) = angle.sin_cos();
        for (x, y) in [(0.0, 0.0), (0.1, 0.05), (-0.1, 0.1), (0.05, -0.1)] {
            let at = Vec3::new(x, y * cos, y * sin);
            let n = Vec3::new(0.0, -sin, cos);
            let expected = irradiance(&stage.lamps[0], at, n) / PI;
            assert_linear(&stage, &picture, at, expected, tolerance);
        }
    }
}

/// Left half red, right half blue, upper left corner green.
fn quarters() -> Arc<SceneTexture> {
    let texel = |i: u32| match (i % 32 < 16, i / 32 < 16) {
        (true, true) => [0, 255, 0, 255],
        (true, false) => [255, 0, 0, 255],
        (false, _) => [0, 0, 255, 255],
    };
    Arc::new(SceneTexture {
        width: 32,
        height: 32,
        rgba: (0..32 * 32).flat_map(texel).collect(),
    })
}

/// A rectangle of four colours, facing straight down, its top towards +Y: a viewer looking up at it
/// has -X on the right.
fn coloured(height: f64) -> VirtualLight {
    let mut lamp = area(
        DVec3::new(0.0, 0.0, height),
        DVec3::ZERO,
        DVec2::new(0.3, 0.3),
        Vec3::splat(0.12),
    );
    lamp.screen = Some(Screen {
        texture: Some(quarters()),
        visible: false,
    });
    lamp
}

/// Irradiance from the quarters, each by Lambert's formula; the mean of all has a luminance of 1.
fn by_quarters(lamp: &PlacedLamp, at: Vec3, n: Vec3) -> Vec3 {
    let area = lamp.area.unwrap();
    let luminance = 0.25 * 0.7152 + 0.25 * 0.2126 + 0.5 * 0.0722;
    let mut sum = Vec3::ZERO;
    for (right, up, colour) in [
        (-0.5, 0.5, Vec3::Y),
        (-0.5, -0.5, Vec3::X),
        (0.5, 0.5, Vec3::Z),
        (0.5, -0.5, Vec3::Z),
    ] {
        let mut part = area;
        (part.half_right, part.half_up) = (area.half_right * 0.5, area.half_up * 0.5);
        let centre = lamp.position + area.half_right * right + area.half_up * up - at;
        let corners = part.corners(centre).map(|c| c.as_dvec3());
        sum += colour * form_factor(&corners, n.as_dvec3()) as f32;
    }
    lamp.intensity / area.size() * sum * (PI / luminance)
}

#[test]
fn colours_of_a_screen_light_the_right_places() {
    for (height, tolerance) in [(0.6, 0.01), (0.3, 0.02), (0.15, 0.06), (0.05, 0.12)] {
        let mut stage = Stage::new(160, 120)
            .without_ground()
            .with_virtual(part(primitives::plane(0.8, 0.8), DVec3::ZERO))
            .lit(lighting(Vec::new(), 0.0));
        stage.pose = Some(looking_from(DVec3::new(0.0, -0.7, 0.7), DVec3::ZERO));
        let mut lamp = coloured(height);
        // Keep the result below white.
        lamp.intensity *= (height as f32 / 0.3).clamp(0.2, 1.0).powi(2);
        let stage = with_lamps(stage, vec![lamp]);
        let picture = stage.compose();
        for at in [
            [0.0, 0.0],
            [0.12, 0.08],
            [-0.12, 0.08],
            [0.1, -0.1],
            [0.2, 0.0],
        ] {
            let at = Vec3::new(at[0], at[1], 0.0);
            let expected = by_quarters(&stage.lamps[0], at, Vec3::Z) / PI;
            let off = (linear_at(&stage, &picture, at) - expected)
                .abs()
                .max_element();
            let max_error = expected.max_element();
            assert!(
                off < tolerance * max_error + 0.004,
                "{height} {at}: {off} of {expected}"
            );
        }
    }
}

#[test]
fn visible_rectangle_shows_its_picture() {
    let mut lamp = area(
        DVec3::new(0.0, 0.0, 0.1),
        DVec3::new(0.0, -1.0, 0.1),
        DVec2::new(0.2, 0.15),
        Vec3::splat(0.01),
    );
    if let VirtualLightKind::Area { up, .. } = &mut lamp.kind {
        *up = DVec3::Z;
    }
    lamp.screen = Some(Screen {
        texture: Some(quarters()),
        visible: true,
    });
    let stage = table(vec![lamp.clone()]);
    let picture = stage.compose();
    let shown = |x: f32, z: f32| linear_at(&stage, &picture, Vec3::new(x, 0.0, z));
    // 0.03 m² at a mean luminance of 1: radiance 0.01 / 0.03 / 0.268 of white.
    let white: f32 = 0.01 / 0.03 / 0.268_05;
    for (x, z, colour) in [
        (-0.05, 0.14, Vec3::Y),
        (-0.05, 0.06, Vec3::X),
        (0.05, 0.14, Vec3::Z),
    ] {
        let off = (shown(x, z) - colour * white.min(1.0)).abs().max_element();
        assert!(off < 0.02, "{x} {z}: {}", shown(x, z));
    }
    // From behind it is dark and hides the table; switched off it is absent.
    let mut behind = stage.clone();
    behind.pose = Some(looking_from(
        DVec3::new(0.05, 0.7, 0.5),
        DVec3::new(0.0, 0.0, 0.1),
    ));
    let back = linear_at(&behind, &behind.compose(), Vec3::new(0.0, 0.0, 0.1));
    assert!(back.max_element() < 0.1, "{back}");
    lamp.keys[0].gain = 0.0;
    let off = table(vec![lamp]);
    assert!(off.compose() == off.picture);
}

#[test]
fn glossy_reflection_of_a_rectangle_is_the_integral_of_the_lobe() {
    // Viewed straight on, light and eye on the same side, GGX without Fresnel.
    let eye = DVec3::new(0.0, -0.1, 0.8);
    for roughness in [0.3_f32, 0.5, 0.8] {
        let metal = Material {
            base_colour: Vec4::new(0.9, 0.6, 0.3, 1.0),
            metallic: 1.0,
            roughness,
            ..Material::default()
        };
        let mut stage = Stage::new(160, 120)
            .without_ground()
            .with_virtual(painted(primitives::plane(0.6, 0.6), DVec3::ZERO, metal))
            .lit(lighting(Vec::new(), 0.0));
        stage.pose = Some(looking_from(eye, DVec3::ZERO));
        let lamp = area(
            DVec3::new(0.0, 0.15, 0.5),
            DVec3::ZERO,
            DVec2::new(0.3, 0.2),
            Vec3::splat(0.03),
        );
        let stage = with_lamps(stage, vec![lamp]);
        let picture = stage.compose();
        for at in [[0.0, 0.0], [0.0, 0.1], [0.1, 0.05], [-0.15, -0.1]] {
            let at = Vec3::new(at[0], at[1], 0.0);
            let integral = mirrored(&stage.lamps[0], at, eye.as_vec3(), roughness);
            let expected = Vec3::new(0.9, 0.6, 0.3) * integral;
            let found = linear_at(&stage, &picture, at);
            let off = (found - expected).abs().max_element();
            assert!(
                off < 0.15 * expected.max_element() + 0.01,
                "{roughness} {at}: {found} {expected}"
            );
        }
    }
}

/// ∫ D V n·l dω over the rectangle times its radiance, without Fresnel's factor, on a horizontal
/// surface.
fn mirrored(lamp: &PlacedLamp, at: Vec3, eye: Vec3, roughness: f32) -> f32 {
    const SIDE: i32 = 200;
    let area = lamp.area.unwrap();
    let v = (eye - at).normalize();
    let a2 = roughness.powi(4);
    let mut sum = 0.0;
    for i in 0..SIDE * SIDE {
        let position = |k: i32| (k as f32 + 0.5) * 2.0 / SIDE as f32 - 1.0;
        let off = lamp.position - at
            + area.half_right * position(i % SIDE)
            + area.half_up * position(i / SIDE);
        let (l, r2) = (off.normalize(), off.length_squared());
        let h = (l + v).normalize();
        let d = a2 / (PI * (h.z * h.z * (a2 - 1.0) + 1.0).powi(2));
        let smith = |a: f32, b: f32| a * (b * b * (1.0 - a2) + a2).sqrt();
        let masking = 0.5 / (smith(l.z, v.z) + smith(v.z, l.z));
        sum += d * masking * l.z.max(0.0) * lamp.direction.dot(-l).max(0.0) / r2;
    }
    sum * lamp.intensity.x / (SIDE * SIDE) as f32
}

/// Fraction of a lamp's light on a point of the table that passes a box.
fn unshadowed(lamp: &PlacedLamp, at: Vec3, (low, high): (Vec3, Vec3)) -> f32 {
    const SIDE: i32 = 64;
    let area = lamp.area.unwrap();
    let (mut seen, mut all) = (0.0, 0.0);
    for i in 0..SIDE * SIDE {
        let position = |k: i32| (k as f32 + 0.5) * 2.0 / SIDE as f32 - 1.0;
        let off = lamp.position - at
            + area.half_right * position(i % SIDE)
            + area.half_up * position(i / SIDE);
        let r2 = off.length_squared();
        let weight = off.z.max(0.0) * lamp.direction.dot(-off).max(0.0) / (r2 * r2);
        let (a, b) = ((low - at) / off, (high - at) / off);
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        all += weight;
        if !(enter < leave && leave > 1e-4 && enter < 1.0) {
            seen += weight;
        }
    }
    seen / all
}

/// Mean and maximum error of the shadow of a box, as fractions of the unshadowed light.
fn shadow_error(stage: &Stage, cuboid: (Vec3, Vec3)) -> (f32, f32) {
    let picture = stage.compose();
    let without = camera_linear(stage);
    let (mut sum, mut max_error, mut count) = (0.0, 0.0_f32, 0.0);
    for y in -12..=12 {
        for x in -16..=8 {
            let at = Vec3::new(x as f32 * 0.015, y as f32 * 0.015, 0.0);
            let under = |c: usize| at[c] > cuboid.0[c] - 0.005 && at[c] < cuboid.1[c] + 0.005;
            // Points that the box hides from the camera, which is at -y.
            let hidden = at.x.abs() < 0.08 && at.y > -0.06 && at.y < 0.18;
            if (under(0) && under(1)) || hidden {
                continue;
            }
            // The point at the pixel's centre.
            let (u, v) = pixel_of(stage, at);
            let pose = stage.pose.unwrap();
            let pixel = DVec2::new(f64::from(u), f64::from(v));
            let ray = pose.rotation * stage.camera.unproject(pixel);
            let at = (pose.translation - ray * (pose.translation.z / ray.z)).as_vec3();
            let full = lit(stage, at);
            let integral = unshadowed(&stage.lamps[0], at, cuboid);
            let found = ((linear_at(stage, &picture, at) - without) / (full - without)).y;
            let off = (found - integral).abs();
            sum += off;
            max_error = max_error.max(off);
            count += 1.0;
        }
    }
    (sum / count, max_error)
}

#[test]
fn shadow_softness_follows_the_rectangles_size() {
    let cuboid = (Vec3::new(-0.05, -0.05, 0.0), Vec3::new(0.05, 0.05, 0.1));
    let mut failed = false;
    for (size, position, bright) in [
        (0.06, DVec3::new(0.3, 0.0, 0.4), 2.0),
        (0.3, DVec3::new(0.3, 0.0, 0.4), 2.0),
        (0.3, DVec3::new(0.25, 0.0, 0.15), 0.7),
    ] {
        for soft in [1, 4] {
            let lamp = area(
                position,
                DVec3::ZERO,
                DVec2::splat(size),
                Vec3::splat(bright),
            );
            let part = part(primitives::cuboid(Vec3::splat(0.1)), DVec3::ZERO);
            for phantom in [false, true] {
                let stage = table(Vec::new());
                let mut stage = if phantom {
                    stage.with_phantom(part.clone())
                } else {
                    stage.with_virtual(part.clone())
                };
                stage.settings.soft_samples = soft;
                stage.camera = crate::stage::camera(320, 240);
                stage.picture = flat(320, 240, [90, 80, 70]);
                let stage = with_lamps(stage, vec![lamp.clone()]);
                let (found, worst) = shadow_error(&stage, cuboid);
                println!(
                    "{size} m at {position}, {soft} look-ups, phantom {phantom}: {found:.4}, maximum {worst:.3}"
                );
                if std::env::var_os("PENUMBRA_KEEP").is_some() {
                    let name = format!("area-{size}-{}-{soft}-{phantom}", position.z);
                    crate::comparison::keep(&name, &stage.compose());
                }
                failed |= found >= 0.04 || worst >= 0.2;
            }
        }
    }
    assert!(!failed, "see above");
}
