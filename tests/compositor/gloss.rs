//! Glossy surfaces: against the CPU's look-ups, closed forms, and tilted planes.

use crate::comparison::virtual_inside;
use crate::stage::{Stage, camera, cell, even_sky, flat, lighting, looking_from, painted};
use glam::{DMat4, DQuat, DVec2, DVec3, Vec3};
use penumbra_camera::Response;
use penumbra_lighting::box_chain::{box_chain, box_level};
use penumbra_lighting::compact_source_specular::{excesses, reflected};
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::lobes::{Family, Levels, phong_parameter, tilted, widths};
use penumbra_lighting::place::{LightPlace, Seen};
use penumbra_lighting::prefilter::{Prefilter, gathered, level_count};
use penumbra_lighting::{CubeMap, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::{Material, Part, Phong, PlacedLamp, SceneTexture, primitives};
use std::f32::consts::PI;
use std::sync::Arc;

const SPECULAR: Vec3 = Vec3::new(0.8, 0.5, 0.3);

fn phong(diffuse: Vec3, exponent: f32) -> Material {
    Material {
        base_colour: diffuse.extend(1.0),
        phong: Some(Phong {
            specular: SPECULAR,
            exponent,
        }),
        ..Material::default()
    }
}

fn metal(roughness: f32) -> Material {
    Material {
        base_colour: SPECULAR.extend(1.0),
        metallic: 1.0,
        roughness,
        ..Material::default()
    }
}

/// The CPU's lobe of a material, quantised to 255 steps as in the packed surface.
fn lobe(material: &Material) -> (Family, f32) {
    let (family, p) = match material.phong {
        Some(phong) => (Family::Phong, phong_parameter(phong.exponent)),
        None => (Family::Ggx, material.roughness),
    };
    (family, (p * 255.0).round() / 255.0)
}

/// A sky of soft colours and one window, with `size` texels per side.
fn sky(size: u32) -> Vec<Vec3> {
    let at = |d: Vec3| {
        let window = if d.dot(Vec3::new(0.5, -0.6, 0.6).normalize()) > 0.97 {
            1.5
        } else {
            0.0
        };
        Vec3::new(0.3 + 0.2 * d.x, 0.3 + 0.2 * d.z, 0.3 - 0.2 * d.y) + window
    };
    CubeGrid::new(size).directions.into_iter().map(at).collect()
}

/// Lighting for specular reflection alone.
fn mirrored_only(map: CubeMap) -> Lighting {
    Lighting {
        radiance: Arc::new(map),
        ..lighting(Vec::new(), 0.0)
    }
}

fn sphere(material: Material) -> Stage {
    let part = painted(primitives::sphere(0.1, 192, 96), DVec3::ZERO, material);
    let mut stage = Stage::new(96, 72).without_ground().with_virtual(part);
    stage.settings.samples = 1;
    stage
}

/// Pixels well inside the sphere, each with its normal and direction to the eye.
fn seen(stage: &Stage) -> Vec<((u32, u32), Vec3, Vec3)> {
    let twin = stage.twin();
    let inside = virtual_inside(&twin, 1);
    let pose = stage.pose.unwrap();
    let width = stage.picture.width;
    let all = (0..inside.len()).filter(|i| inside[*i]).map(|i| {
        let (x, y) = (i as u32 % width, i as u32 / width);
        let ray = stage
            .camera
            .unproject(DVec2::new(f64::from(x), f64::from(y)));
        let v = -(pose.rotation * ray).normalize();
        ((x, y), twin.pixels[i].normal.as_vec3(), v.as_vec3())
    });
    all.collect()
}

/// Normals and directions to the eye at four places within a pixel that shows the sphere about the origin.
fn within_pixel(stage: &Stage, (x, y): (u32, u32)) -> Vec<(Vec3, Vec3)> {
    let pose = stage.pose.unwrap();
    let places = (0..4).map(|k| DVec2::new(f64::from(k % 2), f64::from(k / 2)) * 0.5 - 0.25);
    let seen = places.filter_map(|off| {
        let pixel = DVec2::new(f64::from(x), f64::from(y)) + off;
        let ray = (pose.rotation * stage.camera.unproject(pixel)).normalize();
        let along = -pose.translation.dot(ray);
        let depth = 0.01 - (pose.translation + ray * along).length_squared();
        let hit = pose.translation + ray * (along - depth.max(0.0).sqrt());
        (depth > 0.0).then(|| (hit.normalize().as_vec3(), -ray.as_vec3()))
    });
    seen.collect()
}

/// Differences of codes from the mean of `expected` over a pixel, where n·v is above 0.1: the value that one in two
/// hundred exceeds (edges of the window may be a pixel off), and the mean.
fn differences(stage: &Stage, ours: &Picture, expected: impl Fn(Vec3, Vec3) -> Vec3) -> (u8, f64) {
    let mut all = Vec::new();
    for (pixel, ..) in seen(stage).into_iter().filter(|(_, n, v)| n.dot(*v) > 0.1) {
        let within = within_pixel(stage, pixel);
        let sum: Vec3 = within.iter().map(|(n, v)| expected(*n, *v)).sum();
        let mean = sum / within.len() as f32;
        let codes = mean.to_array().map(|l| stage.response.code_from_linear(l));
        let pairs = ours.rgb(pixel.0, pixel.1).into_iter().zip(codes);
        all.extend(pairs.map(|(a, b)| a.abs_diff(b)));
    }
    assert!(all.len() > 2000, "{}", all.len());
    all.sort_unstable();
    let mean = all.iter().map(|d| f64::from(*d)).sum::<f64>() / all.len() as f64;
    (all[all.len() * 199 / 200], mean)
}

/// What a material reflects of a map at a point with a normal `n`, seen from the direction `v`, by the CPU's look-ups.
fn looked_up(map: &CubeMap, material: &Material) -> impl Fn(Vec3, Vec3) -> Vec3 {
    let (family, p) = lobe(material);
    let levels = Levels::new(family, map.size, map.levels.len());
    move |n, v| {
        let r = family.response(n.dot(v), p);
        let d = tilted(n * (2.0 * n.dot(v)) - v, n, r.tilt);
        let light = gathered(map, family, levels.level(r.width), d);
        light * (SPECULAR * r.scale + r.bias)
    }
}

#[test]
fn gpu_lobes_match_the_cpu() {
    let map = Prefilter::new(64).with_phong(true).apply(&sky(64));
    let metals = [0.1, 0.35, 0.7, 1.0].map(metal);
    let phongs = [1.0, 20.0, 1000.0].map(|e| phong(Vec3::ZERO, e));
    for material in metals.into_iter().chain(phongs) {
        let stage = sphere(material.clone()).lit(mirrored_only(map.clone()));
        let expected = looked_up(&map, &material);
        let (worst, mean) = differences(&stage, &stage.compose(), expected);
        let (family, p) = lobe(&material);
        let most = if p < 0.2 { 12 } else { 5 };
        assert!(
            worst <= most && mean < 0.9,
            "{family:?} {p}: {worst} {mean}"
        );
    }
}

#[test]
fn pixels_with_several_samples_show_what_they_reflect() {
    let map = Prefilter::new(64).apply(&sky(64));
    let material = metal(0.1);
    // Its triangles are smaller than pixels, so that many pixels show several.
    let mut stage = sphere(material.clone()).lit(mirrored_only(map.clone()));
    stage.settings.samples = 4;
    let picture = stage.compose();
    stage.settings.samples = 1;
    let (worst, mean) = differences(&stage, &picture, looked_up(&map, &material));
    assert!(worst <= 6 && mean < 0.4, "{worst} {mean}");
}

#[test]
fn small_ball_shows_what_all_of_a_pixel_mirrors() {
    let stripes = |d: &Vec3| {
        Vec3::splat(if (4.0 * (d.x + d.z)).sin() > 0.0 {
            0.9
        } else {
            0.1
        })
    };
    let map: Vec<Vec3> = CubeGrid::new(64).directions.iter().map(stripes).collect();
    let map = Prefilter::new(64).apply(&map);
    let enlarged = |by: u32| {
        let ball = painted(primitives::sphere(0.03, 96, 48), DVec3::ZERO, metal(0.2));
        let mut stage = Stage::new(96 * by, 72 * by)
            .without_ground()
            .with_virtual(ball)
            .lit(mirrored_only(map.clone()));
        let centre = camera(96, 72).centre;
        stage.camera.centre = (centre + 0.5) * f64::from(by) - 0.5;
        stage.settings.samples = 4;
        stage
    };
    let (stage, fine) = (enlarged(1), enlarged(8).compose());
    let picture = stage.compose();
    let all = seen(&stage).into_iter().map(|((x, y), ..)| {
        let within = (0..64).map(|k| linear(&fine, 8 * x + k % 8, 8 * y + k / 8).y);
        let mean = within.sum::<f32>() / 64.0;
        (linear(&picture, x, y).y - mean).powi(2)
    });
    let all: Vec<f32> = all.collect();
    let error = (all.iter().sum::<f32>() / all.len() as f32).sqrt();
    assert!(all.len() > 50 && error < 0.015, "{} {error}", all.len());
}

#[test]
fn surface_that_faces_the_ground_shows_the_ground_alone() {
    // Steep below the horizon, where neither the row of a long lobe nor one look-up is exact.
    let peak = |d: Vec3| (-d.z).max(0.0).powi(12);
    shows_the_ground_alone(&|d| 0.2 + 8.0 * peak(d));
    shows_the_ground_alone(&|d| 8.2 - 8.0 * peak(d));
}

/// Checks what a metal ball mirrors of even ground in an environment.
fn shows_the_ground_alone(environment: &dyn Fn(Vec3) -> f32) {
    let grid = CubeGrid::new(64);
    let texels: Vec<Vec3> = (grid.directions.iter())
        .map(|d| Vec3::splat(environment(*d)))
        .collect();
    let map = Prefilter::new(64).apply(&texels);
    let material = metal(0.22);
    let ball = primitives::sphere(0.1, 192, 96);
    let ball = painted(ball, DVec3::new(0.0, 0.0, 0.14), material.clone());
    let mut stage = Stage::new(96, 72)
        .with_virtual(ball)
        .lit(mirrored_only(map));
    stage.picture = flat(96, 72, [100; 3]);
    let ground = stage.response.linear_from_rgb([100; 3])[0];
    let picture = stage.compose();
    let (family, p) = lobe(&material);
    let mut count = 0;
    for ((x, y), n, v) in seen(&stage) {
        let mirrored = n * (2.0 * n.dot(v)) - v;
        // What lies before the camera is beside its picture.
        if mirrored.z > -0.8 || mirrored.y < -0.4 || n.dot(v) < 0.3 {
            continue;
        }
        let r = family.response(n.dot(v), p);
        let light = ground * (SPECULAR * r.scale + r.bias);
        let off = (linear(&picture, x, y) - light).abs().max_element();
        assert!(off < 0.05 * light.max_element(), "{x} {y}: {off}");
        count += 1;
    }
    assert!(count > 50, "{count}");
}

/// A map of [`sky`] from which the entire window is separated as a compact source at `place`.
fn separated_window(size: u32, place: LightPlace) -> CubeMap {
    let grid = CubeGrid::new(size);
    let full = sky(size);
    let without: Vec<Vec3> = full
        .iter()
        .map(|l| if l.x > 1.1 { *l - 1.5 } else { *l })
        .collect();
    let added = |(l, rest): (&Vec3, &Vec3)| f32::from(l != rest);
    let inside = full.iter().zip(&without).map(added);
    let solid_angle: f32 = inside.zip(&grid.solid_angles).map(|(a, b)| a * b).sum();
    let window = Seen {
        direction: Vec3::new(0.5, -0.6, 0.6).normalize(),
        irradiance: Vec3::splat(1.5 * solid_angle),
        angular_radius: (solid_angle / PI).sqrt(),
    };
    let widths: Vec<f32> = widths(size, level_count(size)).collect();
    let sources = excesses(&grid, &full, &without, &[(window, place)], &widths);
    assert_eq!(sources.len(), 1);
    let prefilter = Prefilter::new(size).with_phong(true);
    prefilter.apply_without(&full, &sources)
}

#[test]
fn sources_left_out_of_levels_are_reflected_by_the_brdf() {
    let map = separated_window(64, LightPlace::FAR);
    assert!(
        map.compact_sources[0].weights[4] == 1.0,
        "{:?}",
        map.compact_sources
    );
    let metals = [0.1, 0.4, 0.6, 0.8, 1.0].map(metal);
    let phongs = [1.0, 20.0, 200.0].map(|e| phong(Vec3::ZERO, e));
    for material in metals.into_iter().chain(phongs) {
        let (family, p) = lobe(&material);
        let levels = Levels::new(family, map.size, map.levels.len());
        let stage = sphere(material).lit(mirrored_only(map.clone()));
        let (worst, mean) = differences(&stage, &stage.compose(), |n, v| {
            let r = family.response(n.dot(v), p);
            let d = tilted(n * (2.0 * n.dot(v)) - v, n, r.tilt);
            let level = levels.level(r.width);
            let light = gathered(&map, family, level, d);
            let [scaled, added] = reflected(&map.compact_sources, (family, p, level), n, v);
            light * (SPECULAR * r.scale + r.bias) + scaled * SPECULAR + added
        });
        let most = if p < 0.2 { 12 } else { 5 };
        assert!(
            worst <= most && mean < 0.9,
            "{family:?} {p}: {worst} {mean}"
        );
    }
}

#[test]
fn near_source_is_mirrored_where_it_is_seen_from_each_point() {
    let place = LightPlace {
        reference: Vec3::ZERO,
        inverse_distance: 2.5,
    };
    let map = separated_window(64, place);
    assert_eq!(map.compact_sources[0].weights, [1.0; 8]);
    for roughness in [0.0, 0.1, 0.3, 0.6] {
        let material = metal(roughness);
        let (family, p) = lobe(&material);
        let levels = Levels::new(family, map.size, map.levels.len());
        let stage = sphere(material).lit(mirrored_only(map.clone()));
        let picture = stage.compose();
        let (worst, mean) = differences(&stage, &picture, |n, v| {
            let r = family.response(n.dot(v), p);
            let d = tilted(n * (2.0 * n.dot(v)) - v, n, r.tilt);
            let level = levels.level(r.width);
            let light = gathered(&map, family, level, d);
            let here = map.compact_sources.iter().map(|s| s.seen_from(n * 0.1));
            let here: Vec<_> = here.collect();
            let [scaled, added] = reflected(&here, (family, p, level), n, v);
            light * (SPECULAR * r.scale + r.bias) + scaled * SPECULAR + added
        });
        assert!(worst <= 5 && mean < 0.9, "{roughness}: {worst} {mean}");
    }
}

#[test]
fn papers_chain_uses_one_level_and_no_cosine() {
    let axis = Vec3::new(0.1, -0.8, 0.6).normalize();
    let map = box_chain(64, &sky(64), axis);
    for exponent in [5.0, 100.0] {
        let material = phong(Vec3::ZERO, exponent);
        let (family, p) = lobe(&material);
        let level = box_level(family, p, map.size, map.levels.len());
        let stage = sphere(material).lit(mirrored_only(map.clone()));
        let (worst, mean) = differences(&stage, &stage.compose(), |n, v| {
            gathered(&map, family, level, n * (2.0 * n.dot(v)) - v) * SPECULAR
        });
        assert!(worst <= 5 && mean < 0.9, "{exponent}: {worst} {mean}");
    }
}

#[test]
fn uniform_sky_is_scaled_by_the_materials_albedo() {
    let diffuse = Vec3::new(0.2, 0.4, 0.1);
    for exponent in [0.0, 1.0, 30.0, 10_000.0] {
        let material = phong(diffuse, exponent);
        let (family, p) = lobe(&material);
        let stage = sphere(material).lit(even_sky(0.7));
        let (worst, mean) = differences(&stage, &stage.compose(), |n, v| {
            0.7 * (diffuse + SPECULAR * family.response(n.dot(v), p).scale)
        });
        assert!(worst <= 3 && mean < 1.3, "{exponent}: {worst} {mean}");
    }
}

/// A tile seen from above.
fn tile(material: Material) -> Stage {
    let part = painted(primitives::plane(0.3, 0.3), DVec3::ZERO, material);
    let mut stage = Stage::new(80, 80).without_ground().with_virtual(part);
    stage.pose = Some(looking_from(DVec3::new(0.0, -1e-4, 0.5), DVec3::ZERO));
    stage
}

fn linear(picture: &Picture, x: u32, y: u32) -> Vec3 {
    let table = Response::srgb();
    Vec3::from(
        picture
            .rgb(x, y)
            .map(|c| table.linear_from_code()[usize::from(c)]),
    )
}

#[test]
fn highlight_of_a_lamp_is_phongs_lobe() {
    let diffuse = Vec3::splat(0.1);
    for (exponent, slant) in [(2.0, 0.5_f32), (20.0, 0.3), (200.0, 0.1)] {
        let lamp = PlacedLamp {
            position: Vec3::new(slant.sin(), 0.0, slant.cos()),
            direction: Vec3::NEG_Z,
            intensity: Vec3::splat(0.06),
            cone: None,
            area: None,
        };
        let mut stage =
            tile(phong(diffuse, exponent)).lit(lighting(vec![cell(Vec3::Z, Vec3::ZERO)], 0.0));
        stage.lamps = vec![lamp];
        let shown = linear(&stage.compose(), 39, 40);
        let (at, v) = on_tile(&stage, 39, 40);
        let off = stage.lamps[0].position - at;
        let l = off.normalize();
        let along = (Vec3::Z * (2.0 * v.z) - v).dot(l);
        let brdf = diffuse / PI + SPECULAR * ((exponent + 2.0) / (2.0 * PI) * along.powf(exponent));
        let expected = brdf * (0.06 * l.z / off.length_squared());
        let off = (shown - expected).abs() / expected.max(Vec3::splat(0.02));
        assert!(off.max_element() < 0.06, "{exponent}: {shown} {expected}");
    }
}

/// The point of the tile that a pixel shows, and the direction to the eye.
fn on_tile(stage: &Stage, x: u32, y: u32) -> (Vec3, Vec3) {
    let pose = stage.pose.unwrap();
    let ray = stage
        .camera
        .unproject(DVec2::new(f64::from(x), f64::from(y)));
    let ray = pose.rotation * ray.normalize();
    let at = pose.translation - ray * (pose.translation.z / ray.z);
    (at.as_vec3(), -ray.as_vec3())
}

fn normal_map(n: Vec3) -> Option<Arc<SceneTexture>> {
    let code = |v: f32| (127.5 * (v + 1.0)).round() as u8;
    Some(Arc::new(SceneTexture {
        width: 1,
        height: 1,
        rgba: vec![code(n.x), code(n.y), code(n.z), 255],
    }))
}

fn orient(part: &mut Part, n: Vec3) {
    let rotation = DQuat::from_rotation_arc(DVec3::Z, n.as_dvec3().normalize());
    part.world_from_part = DMat4::from_quat(rotation);
}

#[test]
fn tilting_normal_map_equals_a_tilted_plane() {
    let map = Prefilter::new(64).with_phong(true).apply(&sky(64));
    for n in [
        Vec3::new(0.4, 0.0, 0.9),
        Vec3::new(-0.2, 0.5, 0.8),
        Vec3::new(-0.3, -0.3, 0.9),
    ] {
        let n = n.normalize();
        for material in [
            metal(0.3),
            phong(Vec3::splat(0.15), 40.0),
            phong(Vec3::ZERO, 2.0),
        ] {
            let light = Lighting {
                radiance: Arc::new(map.clone()),
                ..even_sky(0.5)
            };
            let mapped = tile(Material {
                normal_texture: normal_map(n),
                ..material.clone()
            })
            .lit(light.clone());
            let mut plane = tile(material).lit(light);
            orient(&mut plane.scene.virtual_parts[0], n);
            let (a, b) = (mapped.compose().rgb(39, 40), plane.compose().rgb(39, 40));
            let close = (0..3).all(|c| a[c].abs_diff(b[c]) <= 3);
            assert!(close, "{n}: {a:?} {b:?}");
        }
    }
}

#[test]
fn half_the_normal_scale_halves_the_slope() {
    let light = Lighting {
        radiance: Arc::new(Prefilter::new(64).apply(&sky(64))),
        ..even_sky(0.0)
    };
    let n = Vec3::new(0.6, 0.0, 0.8);
    let mapped = tile(Material {
        normal_texture: normal_map(n),
        normal_scale: 0.5,
        ..metal(0.2)
    })
    .lit(light.clone());
    let mut plane = tile(metal(0.2)).lit(light);
    orient(&mut plane.scene.virtual_parts[0], Vec3::new(0.3, 0.0, 0.8));
    let (a, b) = (mapped.compose().rgb(39, 40), plane.compose().rgb(39, 40));
    assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 3), "{a:?} {b:?}");
}

#[test]
fn mirrored_placement_mirrors_its_normal_map() {
    let light = Lighting {
        radiance: Arc::new(Prefilter::new(64).apply(&sky(64))),
        ..even_sky(0.0)
    };
    let (n, mirrored) = (Vec3::new(0.3, 0.4, 0.85), Vec3::new(-0.3, 0.4, 0.85));
    let mut mapped = tile(Material {
        normal_texture: normal_map(n.normalize()),
        ..metal(0.2)
    })
    .lit(light.clone());
    mapped.scene.virtual_parts[0].world_from_part = DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mut plane = tile(metal(0.2)).lit(light);
    orient(&mut plane.scene.virtual_parts[0], mirrored);
    let (a, b) = (mapped.compose().rgb(39, 40), plane.compose().rgb(39, 40));
    assert!((0..3).all(|c| a[c].abs_diff(b[c]) <= 3), "{a:?} {b:?}");
}

#[test]
fn changing_materials_switches_phongs_lobe() {
    let map = Prefilter::new(64).with_phong(true).apply(&sky(64));
    let mut stage = sphere(metal(0.3)).lit(mirrored_only(map));
    let mut compositor = stage.compositor();
    let first = stage.compose_with(&mut compositor);
    stage.scene.virtual_parts[0].material = Arc::new(phong(Vec3::ZERO, 50.0));
    compositor.set_scene(&stage.scene, &penumbra_scene::casters(&stage.scene));
    assert!(stage.compose_with(&mut compositor) == stage.compose());
    stage.scene.virtual_parts[0].material = Arc::new(metal(0.3));
    compositor.set_scene(&stage.scene, &penumbra_scene::casters(&stage.scene));
    assert!(stage.compose_with(&mut compositor) == first);
}

#[test]
fn phong_without_its_own_map_is_not_black() {
    let map = Prefilter::new(64).apply(&sky(64));
    let stage = sphere(phong(Vec3::ZERO, 20.0)).lit(mirrored_only(map));
    let ours = stage.compose();
    for ((x, y), n, v) in seen(&stage) {
        let darkest = ours.rgb(x, y)[0];
        assert!(darkest > 20 || n.dot(v) < 0.3, "{x} {y}: {darkest}");
    }
}
