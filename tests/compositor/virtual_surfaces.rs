//! Appearance of virtual surfaces: shading, shadows, occlusion, reflections.

use crate::comparison::{Rule, assert_like, assert_same_where, virtual_inside};
use crate::stage::{
    Stage, cell, even_sky, flat, lighting, looking_from, matt, painted, part, spiral, sun,
};
use glam::{DMat4, DVec2, DVec3, Vec3, Vec4};
use penumbra_camera::Response;
use penumbra_compositor::reference::ReferencePicture;
use penumbra_lighting::cube::locate;
use penumbra_picture::Picture;
use penumbra_scene::{Material, Part, SceneTexture, primitives};
use std::sync::Arc;

const RULE: Rule = Rule {
    on_virtual: true,
    ..Rule::within(1)
};

fn metal(roughness: f32) -> Material {
    Material {
        metallic: 1.0,
        roughness,
        ..Material::default()
    }
}

fn sphere(material: Material) -> Part {
    painted(primitives::sphere(0.1, 96, 48), DVec3::ZERO, material)
}

/// Pixels well inside the virtual surface.
fn inside(twin: &ReferencePicture) -> Vec<usize> {
    let inside = virtual_inside(twin, 1);
    (0..inside.len()).filter(|i| inside[*i]).collect()
}

fn codes(picture: &Picture, i: usize) -> [u8; 3] {
    [0, 1, 2].map(|c| picture.rgba[4 * i + c])
}

fn assert_even(name: &str, stage: &Stage, low: u8, high: u8) {
    let ours = stage.compose();
    let inside = inside(&stage.twin());
    assert!(inside.len() > 300, "{name}: {}", inside.len());
    for i in inside {
        let rgb = codes(&ours, i);
        let fits = rgb.iter().all(|c| (low..=high).contains(c));
        assert!(fits, "{name}, pixel {i}: {rgb:?} not in {low}..={high}");
    }
}

#[test]
fn white_and_mirrors_show_a_uniform_sky() {
    let radiance = 0.5;
    let code = Response::srgb().code_from_linear(radiance);
    for (name, material) in [("white", matt(Vec3::ONE)), ("mirror", metal(0.0))] {
        let stage = Stage::new(96, 72)
            .without_ground()
            .with_virtual(sphere(material.clone()))
            .lit(even_sky(radiance));
        assert_even(name, &stage, code - 2, code + 1);
    }
    // Rough metal may lose light reflected between its facets, but never gains any.
    for roughness in [0.2, 0.5, 1.0] {
        let stage = Stage::new(96, 72)
            .without_ground()
            .with_virtual(sphere(metal(roughness)))
            .lit(even_sky(radiance));
        assert_even("rough", &stage, code / 2, code + 1);
    }
}

#[test]
fn ground_as_bright_as_the_sky_changes_nothing() {
    let code = 188;
    let radiance = Response::srgb().linear_from_code()[188];
    for (name, material) in [("white", matt(Vec3::ONE)), ("mirror", metal(0.0))] {
        let mut stage = Stage::new(96, 72)
            .with_virtual(painted(
                primitives::sphere(0.08, 96, 48),
                DVec3::new(0.0, 0.0, 0.1),
                material,
            ))
            .lit(even_sky(radiance));
        stage.picture = flat(96, 72, [188; 3]);
        assert_even(name, &stage, code - 3, code + 3);
    }
}

#[test]
fn surfaces_are_lit_and_shadow_themselves_and_each_other() {
    for samples in [1, 4] {
        let mut lights = spiral(6, 1.2);
        lights.push(sun(Vec3::new(-0.5, -0.6, 0.8), Vec3::new(1.0, 0.9, 0.8)));
        let mut stage = Stage::new(128, 96)
            .without_ground()
            .with_virtual(part(
                primitives::cuboid(Vec3::new(0.3, 0.3, 0.02)),
                DVec3::ZERO,
            ))
            .with_virtual(painted(
                primitives::sphere(0.05, 96, 48),
                DVec3::new(0.05, 0.0, 0.09),
                matt(Vec3::new(0.9, 0.5, 0.3)),
            ))
            .with_phantom(part(
                primitives::cuboid(Vec3::splat(0.06)),
                DVec3::new(-0.09, 0.02, 0.02),
            ))
            .lit(lighting(lights, 0.0));
        stage.settings.samples = samples;
        let name = format!("surfaces-{samples}");
        let rule = Rule {
            reach: 2,
            slack: 6,
            calm: 0.1,
            ..RULE
        };
        assert_like(&name, &stage.compose(), &stage.twin(), rule);
    }
}

#[test]
fn light_does_not_bleed_across_creases() {
    // Light from straight above: the top is bright, the sides are black.
    let light = lighting(vec![sun(Vec3::Z, Vec3::splat(2.0))], 0.0);
    let mut stage = Stage::new(96, 72)
        .without_ground()
        .with_virtual(part(primitives::cuboid(Vec3::splat(0.1)), DVec3::ZERO))
        .lit(light);
    stage.settings.samples = 1;
    let (ours, twin) = (stage.compose(), stage.twin());
    for i in inside(&twin) {
        let (rgb, expected) = (codes(&ours, i), codes(&twin.picture, i));
        let close = (0..3).all(|c| rgb[c].abs_diff(expected[c]) <= 3);
        let at = (i % 96, i / 96);
        assert!(close, "{at:?}: {rgb:?} {expected:?}");
    }
}

#[test]
fn sky_irradiance_matches_its_harmonics() {
    let mut light = even_sky(0.0);
    light.irradiance.coefficients = [
        Vec3::new(1.2, 1.0, 0.8),
        Vec3::new(0.3, -0.2, 0.1),
        Vec3::new(0.2, 0.3, -0.1),
        Vec3::new(-0.3, 0.2, 0.2),
        Vec3::new(0.4, -0.3, 0.2),
        Vec3::new(-0.2, 0.4, 0.3),
        Vec3::new(0.1, -0.1, 0.1),
        Vec3::new(0.3, 0.2, -0.4),
        Vec3::new(-0.2, 0.1, 0.3),
    ];
    let mut stage = Stage::new(96, 72)
        .without_ground()
        .with_virtual(sphere(matt(Vec3::ONE)))
        .lit(light);
    stage.settings.samples = 1;
    let rule = Rule { slack: 3, ..RULE };
    assert_like("harmonics", &stage.compose(), &stage.twin(), rule);
}

#[test]
fn real_objects_in_front_hide_virtual_ones() {
    let mut stage = Stage::new(128, 96)
        .with_phantom(part(
            primitives::cuboid(Vec3::new(0.1, 0.04, 0.14)),
            DVec3::new(0.0, -0.12, 0.0),
        ))
        .with_virtual(part(
            primitives::sphere(0.06, 48, 24),
            DVec3::new(0.02, 0.0, 0.06),
        ))
        .lit(lighting(
            vec![sun(Vec3::new(0.0, -0.3, 1.0), Vec3::ONE)],
            0.3,
        ));
    stage.picture = crate::stage::noise(128, 96);
    let (twin, ours) = (stage.twin(), stage.compose());
    // Up to three pixels from the box's outline the two sides are blended.
    let hidden = crate::comparison::untouched(&twin, 4);
    assert_same_where("hidden", &ours, &stage.picture, &hidden);
    // The box covers part of the sphere.
    let mut bare = stage.clone();
    bare.scene.phantom_parts.truncate(1);
    let covered = inside(&bare.twin())
        .into_iter()
        .filter(|i| hidden[*i])
        .count();
    assert!(covered > 100, "{covered}");
}

/// Six faces of six colours: a mirrored sphere shows each in the expected direction.
#[test]
fn mirror_shows_the_environment_in_the_right_orientation() {
    let colours = [
        [0.9, 0.1, 0.1],
        [0.1, 0.9, 0.1],
        [0.1, 0.1, 0.9],
        [0.9, 0.9, 0.1],
        [0.1, 0.9, 0.9],
        [0.9, 0.1, 0.9],
    ];
    let mut light = even_sky(0.0);
    let mut map = light.radiance.as_ref().clone();
    for level in &mut map.levels {
        let face = level.len() / 6;
        for (i, texel) in level.iter_mut().enumerate() {
            *texel = colours[i / face];
        }
    }
    light.radiance = Arc::new(map);
    let stage = Stage::new(128, 96)
        .without_ground()
        .with_virtual(sphere(metal(0.0)))
        .lit(light);
    let (ours, twin) = (stage.compose(), stage.twin());
    let pose = stage.pose.unwrap();
    let mut seen = [0; 6];
    for i in inside(&twin) {
        let pixel = DVec2::new((i % 128) as f64, (i / 128) as f64);
        let ray = pose.rotation * stage.camera.unproject(pixel);
        let Some(normal) = sphere_normal(pose.translation, ray, 0.1) else {
            continue;
        };
        let (face, s, t) = locate(ray.reflect(normal).as_vec3());
        // Away from the blend between faces, and from the rim, where pixels cover large angles.
        let central = (s - 0.5).abs().max((t - 0.5).abs()) < 0.3;
        if !central || normal.dot(-ray) < 0.4 {
            continue;
        }
        seen[face] += 1;
        let expected = colours[face].map(|v| stage.response.code_from_linear(v));
        let rgb = codes(&ours, i);
        let close = (0..3).all(|c| rgb[c].abs_diff(expected[c]) <= 4);
        assert!(close, "{pixel} face {face}: {rgb:?} {expected:?}");
    }
    // All faces except those straight behind the sphere.
    assert!(seen.iter().filter(|n| **n > 20).count() >= 4, "{seen:?}");
}

/// Normal where a ray first hits a sphere about the origin.
fn sphere_normal(eye: DVec3, ray: DVec3, radius: f64) -> Option<DVec3> {
    let b = eye.dot(ray);
    let root = b * b - eye.length_squared() + radius * radius;
    (root > 0.0).then(|| ((eye + ray * (-b - root.sqrt())) / radius).normalize())
}

fn quarters() -> Arc<SceneTexture> {
    let colours: [[u8; 4]; 4] = [
        [255, 0, 0, 255],
        [0, 255, 0, 255],
        [0, 0, 255, 255],
        [255, 255, 255, 0],
    ];
    let rgba = (0..64 * 64)
        .flat_map(|i| colours[(i / 64) / 32 * 2 + (i % 64) / 32])
        .collect();
    Arc::new(SceneTexture {
        width: 64,
        height: 64,
        rgba,
    })
}

/// A tile seen from above, north up.
fn tile(material: Material) -> Stage {
    let mut stage = Stage::new(80, 80)
        .without_ground()
        .with_virtual(painted(primitives::plane(0.3, 0.3), DVec3::ZERO, material))
        .lit(even_sky(1.0));
    stage.pose = Some(looking_from(DVec3::new(0.0, -1e-4, 0.5), DVec3::ZERO));
    stage
}

#[test]
fn textures_follow_gltf_and_alpha_cutouts_show_the_camera() {
    let mut stage = tile(Material {
        base_colour_texture: Some(quarters()),
        alpha_cutoff: 0.5,
        ..matt(Vec3::ONE)
    });
    let ours = stage.compose();
    // (0, 0) of a texture is top left: north-west.
    assert_eq!(ours.rgb(28, 28), [255, 0, 0]);
    assert_eq!(ours.rgb(52, 28), [0, 255, 0]);
    assert_eq!(ours.rgb(28, 52), [0, 0, 255]);
    assert_eq!(ours.rgb(52, 52), [180, 150, 120], "cut away");
    assert_eq!(ours.rgb(2, 2), [180, 150, 120], "beside it");
    // The mirrored tile still faces the camera.
    stage.scene.virtual_parts[0].world_from_part = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    assert_eq!(stage.compose().rgb(52, 28), [255, 0, 0]);
    // From behind nothing is visible, unless both sides are drawn.
    let below = looking_from(DVec3::new(0.0, -1e-4, -0.5), DVec3::ZERO);
    let mut back = tile(matt(Vec3::ONE));
    back.pose = Some(below);
    assert_eq!(back.compose().rgb(28, 28), [180, 150, 120]);
    back.scene.virtual_parts[0].material = Arc::new(Material {
        double_sided: true,
        ..matt(Vec3::ONE)
    });
    // The back has its own normal: light from below reaches it, light from above does not.
    for (direction, low, high) in [(Vec3::NEG_Z, 253, 255), (Vec3::Z, 0, 0)] {
        let light = sun(direction, Vec3::splat(std::f32::consts::PI));
        back.lighting = Some(lighting(vec![light], 0.0));
        let rgb = back.compose().rgb(28, 28);
        assert!(rgb.iter().all(|c| (low..=high).contains(c)), "{rgb:?}");
    }
}

#[test]
fn normal_maps_tilt_in_the_direction_of_their_colours() {
    let map = |r: u8, g: u8, b: u8| {
        Some(Arc::new(SceneTexture {
            width: 1,
            height: 1,
            rgba: vec![r, g, b, 255],
        }))
    };
    let brightness = |texture, direction: Vec3| {
        let material = Material {
            normal_texture: texture,
            ..matt(Vec3::ONE)
        };
        let light = sun(direction, Vec3::splat(2.0));
        let ours = tile(material).lit(lighting(vec![light], 0.0)).compose();
        f64::from(Response::srgb().linear_from_code()[usize::from(ours.rgb(40, 40)[0])])
    };
    let (east, north) = (Vec3::new(1.0, 0.0, 1.0), Vec3::new(0.0, 1.0, 1.0));
    let full = 2.0 / std::f64::consts::PI;
    let flat = full * 0.5_f64.sqrt();
    // 218 = 127.5 (1 + sin 45°): red tilts along growing u (east), green towards the picture's top
    // (north).
    for (texture, from_east, from_north) in [
        (None, flat, flat),
        (map(128, 128, 255), flat, flat),
        (map(218, 128, 218), full, full * 0.5),
        (map(128, 218, 218), full * 0.5, full),
    ] {
        let (e, n) = (
            brightness(texture.clone(), east),
            brightness(texture, north),
        );
        assert!((e - from_east).abs() < 0.02, "{e} {from_east}");
        assert!((n - from_north).abs() < 0.02, "{n} {from_north}");
    }
}

#[test]
fn emissive_surface_shows_its_radiance() {
    let mut stage = tile(Material {
        emissive: Vec3::new(0.2, 0.5, 0.8),
        ..matt(Vec3::ZERO)
    });
    stage.lighting = Some(lighting(vec![cell(Vec3::Z, Vec3::ZERO)], 0.0));
    let expected = [0.2, 0.5, 0.8].map(|v| Response::srgb().code_from_linear(v));
    // The inverse response is a table; half a code of rounding may go either way.
    let shown = stage.compose().rgb(40, 40);
    let off = |(a, b): (u8, u8)| a.abs_diff(b);
    assert!(
        shown.into_iter().zip(expected).map(off).all(|d| d <= 1),
        "{shown:?} {expected:?}"
    );
}

#[test]
fn every_sample_of_an_outline_counts_once() {
    // Spheres of a few pixels, behind and through each other, as bright as the camera's picture: a
    // sample that is lost or counted twice shows.
    let code = 120;
    let light = Response::srgb().linear_from_code()[usize::from(code)];
    let glow = Material {
        emissive: Vec3::splat(light),
        ..matt(Vec3::ZERO)
    };
    let mut stage = Stage::new(128, 96)
        .without_ground()
        .lit(lighting(vec![cell(Vec3::Z, Vec3::ZERO)], 0.0));
    for i in 0..60 {
        let turn = f64::from(i) * 2.4;
        let at = DVec3::new(turn.cos(), turn.sin(), 0.2) * 0.015 * f64::from(i).sqrt();
        let ball = primitives::sphere(0.004 + 0.0001 * i as f32, 12, 8);
        stage = stage.with_virtual(painted(ball, at, glow.clone()));
    }
    stage.picture.rgba.fill(code);
    let composed = stage.compose();
    let off = |c: &[u8]| c[..3].iter().any(|c| c.abs_diff(code) > 1);
    let wrong = composed.rgba.chunks_exact(4).filter(|c| off(c)).count();
    assert_eq!(wrong, 0);
    let covered = virtual_inside(&stage.twin(), 0);
    assert!(covered.iter().filter(|c| **c).count() > 500);
}

#[test]
fn base_colour_multiplies_the_light() {
    let stage = tile(Material {
        base_colour: Vec4::new(0.25, 0.5, 1.0, 1.0),
        ..matt(Vec3::ONE)
    });
    let rgb = stage.compose().rgb(40, 40);
    let expected = [0.25, 0.5, 1.0].map(|v| Response::srgb().code_from_linear(v));
    let close = (0..3).all(|c| rgb[c].abs_diff(expected[c]) <= 1);
    assert!(close, "{rgb:?} {expected:?}");
}

#[test]
fn wires_and_objects_behind_the_camera_are_lit_correctly() {
    // Bars as thin as a pixel, across the borders of tiles, in the shadow of a plate that starts
    // behind the camera.
    let mut stage = Stage::new(128, 96).without_ground().lit(lighting(
        vec![
            sun(Vec3::new(0.3, -0.2, 1.0), Vec3::splat(1.5)),
            sun(Vec3::new(-0.8, 0.1, 0.6), Vec3::splat(1.0)),
        ],
        0.0,
    ));
    for i in 0..9 {
        let bar = primitives::cuboid(Vec3::new(0.5, 0.005, 0.005));
        let at = DVec3::new(0.0, 0.04 * f64::from(i) - 0.16, 0.01);
        stage = stage.with_virtual(part(bar, at));
    }
    let mut stage = stage
        .with_virtual(part(
            primitives::cuboid(Vec3::new(0.06, 2.0, 0.004)),
            DVec3::new(0.12, -0.2, 0.12),
        ))
        .with_phantom(part(
            primitives::cuboid(Vec3::new(0.02, 0.5, 0.1)),
            DVec3::new(-0.12, 0.0, -0.02),
        ));
    stage.settings.samples = 1;
    let rule = Rule {
        reach: 2,
        slack: 4,
        calm: 0.1,
        ..RULE
    };
    assert_like("wires", &stage.compose(), &stage.twin(), rule);
}

#[test]
fn wall_above_a_dark_strip_gets_the_light_of_the_ground_beyond_it() {
    const STRIP: f64 = 0.1;
    let radiance = 0.6_f32;
    let (width, height) = (192, 144);
    // The front of the wall is at y = 0.
    let wall = part(
        primitives::cuboid(Vec3::new(0.8, 0.02, 0.2)),
        DVec3::new(0.0, 0.01, 0.0),
    );
    let mut light = even_sky(0.0);
    light.ground_radiance = Vec3::splat(radiance);
    let mut stage = Stage::new(width, height).with_virtual(wall).lit(light);
    let pose = looking_from(DVec3::new(0.0, -0.7, 0.5), DVec3::new(0.0, -0.15, 0.0));
    stage.pose = Some(pose);
    let bright = Response::srgb().code_from_linear(radiance);
    stage.picture = flat(width, height, [bright; 3]);
    for (i, pixel) in stage.picture.rgba.chunks_exact_mut(4).enumerate() {
        let at = DVec2::new((i as u32 % width).into(), (i as u32 / width).into());
        let ray = pose.rotation * stage.camera.unproject(at);
        let ground = pose.translation - ray * (pose.translation.z / ray.z);
        if ray.z >= 0.0 || ground.y > -STRIP {
            pixel[..3].fill(0);
        }
    }
    let ours = stage.compose();
    for h in [0.01, 0.02, 0.05, 0.1, 0.19] {
        let point = pose.inverse().transform_point(DVec3::new(0.0, 0.0, h));
        let pixel = stage.camera.project(point).unwrap().round().as_uvec2();
        let code = ours.rgb(pixel.x, pixel.y)[1];
        let arriving = Response::srgb().linear_from_code()[code as usize] / radiance;
        // Form factor of a half-plane that begins ahead of the wall.
        let expected = (0.5 * h / STRIP.hypot(h)) as f32;
        let error = (arriving - expected).abs() / expected;
        assert!(error < 0.25, "{h} m: {arriving} for {expected}");
    }
}

/// Places along an axis of a pixel at which its true coverage is looked at.
const FINE: i32 = 16;

#[test]
fn outlines_are_smoother_than_their_samples() {
    let half = 0.1;
    let bright = Material {
        base_colour: Vec4::new(0.0, 0.0, 0.0, 1.0),
        emissive: Vec3::ONE,
        specular: 0.0,
        ..Material::default()
    };
    for angle in [0.0_f64, 0.07, 0.3, 0.8] {
        let mut square = painted(primitives::plane(0.2, 0.2), DVec3::ZERO, bright.clone());
        square.world_from_part = DMat4::from_rotation_z(angle);
        let mut stage = Stage::new(128, 96).without_ground().with_virtual(square);
        stage.lighting = Some(lighting(Vec::new(), 0.0));
        stage.picture = flat(128, 96, [0; 3]);
        let picture = stage.compose();
        let pose = stage.pose.unwrap();
        let is_covered = |pixel: DVec2| {
            let ray = pose.rotation * stage.camera.unproject(pixel);
            let p = pose.translation - ray * (pose.translation.z / ray.z);
            let own = DMat4::from_rotation_z(-angle).transform_point3(p);
            own.x.abs() < half && own.y.abs() < half
        };
        let (mut squares, mut count) = (0.0, 0.0);
        for (x, y) in (0..96).flat_map(|y| (0..128).map(move |x| (x, y))) {
            let fine =
                (0..FINE * FINE).map(|k| DVec2::new(f64::from(k % FINE), f64::from(k / FINE)));
            let within = fine.map(|at| (at + 0.5) / f64::from(FINE) - 0.5);
            let at = DVec2::new(f64::from(x), f64::from(y));
            let covered = within.filter(|offset| is_covered(at + *offset)).count();
            let expected = covered as f64 / f64::from(FINE * FINE);
            let found = stage.response.linear_from_rgb(picture.rgb(x, y))[0];
            if found > 0.1 && found < 0.9 {
                squares += (f64::from(found) - expected).powi(2);
                count += 1.0;
            }
        }
        // Four samples alone: 0.084 to 0.107. Lines along rows, columns and diagonals gain least: all
        // samples beside them are at a few distances.
        let error = (squares / count).sqrt();
        assert!(
            count > 100.0 && error < 0.075,
            "{angle}: {error}, {count} pixels"
        );
    }
}
