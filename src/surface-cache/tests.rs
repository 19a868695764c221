//! Tests of the cache against analytic light.

use crate::casters::{Casters, Maps};
use crate::layout::{BORDERED, PAGE, TABLE_WIDTH, TEXELS};
use crate::receivers::Extent;
use crate::renewal::{LightPages, PagesView, discs};
use crate::visibility::{LitMap, Reach};
use crate::{CacheOptions, Layer, SurfaceCache, SurfaceLight};
use glam::{DMat4, DVec3, IVec2, Vec2, Vec3};
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_scene::{Material, Mesh, Part, Scene, primitives};
use std::sync::Arc;

fn part(name: &str, mesh: Mesh, at: DVec3) -> Part {
    Part {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(at),
        mirror: false,
        albedo: None,
    }
}

/// A horizontal square of 0.2 m, 0.1 m above a table.
fn square_over_table() -> Scene {
    Scene {
        virtual_parts: vec![part(
            "square",
            primitives::plane(0.2, 0.2),
            DVec3::new(0.0, 0.0, 0.1),
        )],
        phantom_parts: vec![part("table", primitives::plane(4.0, 4.0), DVec3::ZERO)],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

fn light(direction: Vec3, angular_radius: f32) -> DomeLight {
    DomeLight {
        direction: direction.normalize(),
        irradiance: Vec3::new(1.0, 2.0, 3.0),
        angular_radius,
        kind: LightKind::Compact,
        place: LightPlace::FAR,
    }
}

fn lighting(lights: &[DomeLight], generation: u64) -> Lighting {
    let mut irradiance = Harmonics::default();
    irradiance.coefficients[0] = Vec3::splat(0.5);
    Lighting {
        captured_at: penumbra_interface::MonotonicTime::default(),
        generation,
        radiance: Arc::new(CubeMap::default()),
        irradiance,
        lights: lights.to_vec(),
        ground_radiance: Vec3::ZERO,
        faces: None,
    }
}

fn cache(scene: &Scene) -> SurfaceCache {
    let options = CacheOptions {
        pages: 1500,
        map_size: 512,
        lights: 8,
    };
    SurfaceCache::new(scene, &scene.virtual_parts, &options)
}

fn update(cache: &mut SurfaceCache, lights: &[DomeLight], generation: u64, renewed: &[usize]) {
    let lighting = lighting(lights, generation);
    let light = SurfaceLight::new(&lighting, lights, None);
    cache.update(&light, renewed);
}

/// Each inner texel of real surfaces: position, area, light lost, light that arrives.
fn real_texels(cache: &SurfaceCache) -> Vec<(Vec3, f32, Vec3, Vec3)> {
    let mut found = Vec::new();
    for (p, page) in cache.layout.pages.iter().enumerate() {
        if !matches!(cache.parts[page.receiver].layer, Layer::Phantom(_)) {
            continue;
        }
        let (lost, arriving) = cache.page(p as u32);
        let area = cache.layout.length(p).powi(2);
        for k in 0..TEXELS {
            let inner = |x: usize| (1..=PAGE).contains(&x);
            if cache.texels[p].is_used[k] && inner(k % BORDERED) && inner(k / BORDERED) {
                let rgb = |t: [half::f16; 4]| Vec3::from_array([0, 1, 2].map(|c| t[c].to_f32()));
                let at = cache.texels[p].positions[k];
                found.push((at, area, rgb(lost[k]), rgb(arriving[k])));
            }
        }
    }
    found
}

#[test]
fn a_square_casts_a_shadow_of_its_size_and_energy() {
    let scene = square_over_table();
    let mut cache = cache(&scene);
    for (generation, direction, radius) in [
        (1, Vec3::Z, 0.005),
        (2, Vec3::new(0.4, 0.2, 1.0), 0.005),
        (3, Vec3::new(-0.3, 0.5, 1.0), 0.15),
    ] {
        let lights = [light(direction, radius)];
        update(&mut cache, &lights, generation, &[0]);
        let texels = real_texels(&cache);
        let (to_light, colour) = (lights[0].direction, lights[0].irradiance);
        // A shadow of a horizontal surface on another has its area, whatever the direction.
        let lost: Vec3 = texels.iter().map(|(_, area, lost, _)| *lost * *area).sum();
        let expected = colour * to_light.z * 0.04;
        let error = (lost / expected - 1.0).abs().max_element();
        assert!(error < 0.02, "{direction} {radius}: {lost} {expected}");
        let foot = (to_light * (-0.1 / to_light.z)).truncate();
        for (p, _, lost, arriving) in texels {
            let all = colour * to_light.z;
            assert!((arriving - all).abs().max_element() < 4e-3, "{arriving}");
            let outside = (p.truncate() - foot).abs() - 0.1;
            let distance = outside.max_element();
            // Widest at the lowest elevation; texels and maps blur a little more.
            let penumbra = 0.1 * radius.tan() / to_light.z.powi(2) + 0.006;
            if distance > penumbra {
                assert!(lost.max_element() < 1e-3, "{p} {distance}: {lost}");
            } else if distance < -penumbra {
                assert!((lost - all).abs().max_element() < 4e-3, "{p}: {lost} {all}");
            }
        }
    }
}

#[test]
fn light_by_light_leads_to_the_same_as_all_at_once() {
    let scene = square_over_table();
    let from = [
        light(Vec3::new(0.3, 0.0, 1.0), 0.02),
        light(Vec3::new(-0.5, 0.4, 1.0), 0.1),
        light(Vec3::new(0.0, -0.7, 1.0), 0.1),
    ];
    let to = from.map(|l| light(l.direction + Vec3::new(0.1, 0.05, 0.0), l.angular_radius));
    let (mut one_by_one, mut at_once) = (cache(&scene), cache(&scene));
    update(&mut one_by_one, &from, 1, &[0, 1, 2]);
    for i in 0..3 {
        update(&mut one_by_one, &to, 2, &[i]);
    }
    update(&mut at_once, &to, 2, &[0, 1, 2]);
    for p in 0..at_once.page_count() as u32 {
        assert!(one_by_one.page(p) == at_once.page(p), "page {p}");
    }
}

#[test]
fn only_what_changes_is_summed_again() {
    let scene = square_over_table();
    let mut cache = cache(&scene);
    let lights = [light(Vec3::Z, 0.01), light(Vec3::new(1.0, 0.0, 1.0), 0.01)];
    let all = cache.page_count();
    let count = |cache: &mut SurfaceCache, generation, renewed: &[usize]| {
        let lighting = lighting(&lights, generation);
        let light = SurfaceLight::new(&lighting, &lights, None);
        cache.update(&light, renewed).len()
    };
    assert_eq!(count(&mut cache, 1, &[0, 1]), all);
    assert_eq!(count(&mut cache, 1, &[]), 0);
    let some = count(&mut cache, 1, &[0]);
    assert!(some > 0 && some < all / 2, "{some} of {all}");
    assert_eq!(count(&mut cache, 2, &[]), all);
}

#[test]
fn a_virtual_surface_keeps_the_light_that_its_casters_leave() {
    // A small square 1 cm below a large one is in its shadow; the large one is not.
    let mut scene = square_over_table();
    let below = part(
        "below",
        primitives::plane(0.05, 0.05),
        DVec3::new(0.0, 0.0, 0.09),
    );
    scene.virtual_parts.push(below);
    let mut cache = cache(&scene);
    let lights = [light(Vec3::new(0.1, 0.1, 1.0), 0.02)];
    update(&mut cache, &lights, 1, &[0]);
    let sky = lighting(&lights, 1).irradiance.irradiance(Vec3::Z);
    let sun = lights[0].irradiance * lights[0].direction.z;
    for (p, page) in cache.layout.pages.iter().enumerate() {
        let expected = match cache.parts[page.receiver].layer {
            Layer::Virtual(0) => sky + sun,
            Layer::Virtual(_) => sky,
            Layer::Phantom(_) => continue,
        };
        let (kept, _) = cache.page(p as u32);
        for (k, texel) in kept.iter().enumerate() {
            if cache.texels[p].is_used[k] {
                let [r, g, b, weight] = texel.map(half::f16::to_f32);
                let light = Vec3::new(r, g, b) / weight;
                let error = (light - expected).abs().max_element();
                assert!(error < 1e-2, "{:?}: {light} {expected}", page.receiver);
            }
        }
    }
}

#[test]
fn every_vertex_finds_its_texel_in_the_table() {
    let torus = primitives::torus(0.09, 0.035, 60, 40);
    let mut scene = square_over_table();
    scene.virtual_parts = vec![part("torus", torus, DVec3::new(0.0, 0.0, 0.06))];
    let cache = cache(&scene);
    let table = cache.table();
    let split = cache.split_mesh(Layer::Virtual(0)).expect("a part");
    let positions = &cache.parts[0].receiver.positions;
    for (vertex, place) in split.vertices.iter().zip(&split.cache) {
        let at = Vec2::from_array(place.at);
        let cell = at.floor();
        assert!(at.cmpge(Vec2::ZERO).all());
        let [x, y] = [0, 1].map(|k| u32::from(place.origin[k]) + cell[k] as u32);
        let entry = table[(y * TABLE_WIDTH + x) as usize];
        assert!(entry != 0, "{place:?} has no page");
        let page = (entry & 0xffff) as usize - 1;
        let offset = Vec2::new((entry >> 20 & 15) as f32, (entry >> 24 & 15) as f32);
        let on_page = (offset + at - cell) * PAGE as f32 / (1 << (entry >> 16 & 15)) as f32;
        let texel = on_page.floor().as_ivec2() + IVec2::ONE;
        let k = texel.y as usize * BORDERED + texel.x as usize;
        assert!(cache.texels[page].is_used[k]);
        let distance = cache.texels[page].positions[k].distance(positions[*vertex as usize]);
        // On a surface that is inclined to its chart by up to 55°, texels are longer; the texel of an
        // acute corner takes the point half a texel inside both edges.
        let length = cache.layout.length(page);
        assert!(distance < 3.0 * length, "{distance} {length}");
    }
}

#[test]
fn pages_keep_to_their_budget() {
    let sphere = primitives::torus(0.5, 0.2, 300, 200);
    let mut scene = square_over_table();
    scene.virtual_parts.push(part("large", sphere, DVec3::Z));
    // 200 pages would be coarse: twice as many are taken.
    for (pages, most) in [(200, 400), (1500, 1500)] {
        let options = CacheOptions {
            pages,
            map_size: 64,
            lights: 1,
        };
        let cache = SurfaceCache::new(&scene, &scene.virtual_parts, &options);
        let count = cache.page_count();
        assert!(count <= most && count > most / 2, "{count} of {most}");
    }
}

#[test]
fn small_faces_share_pages() {
    let mut scene = square_over_table();
    let brick = |x: u32, y: u32| {
        let at = DVec3::new(0.02 * f64::from(x), 0.02 * f64::from(y), 0.05);
        part(
            "brick",
            primitives::cuboid(Vec3::new(0.012, 0.007, 0.003)),
            at,
        )
    };
    scene.virtual_parts = (0..900).map(|k| brick(k % 30, k / 30)).collect();
    let options = CacheOptions {
        pages: 1500,
        map_size: 64,
        lights: 1,
    };
    let cache = SurfaceCache::new(&scene, &scene.virtual_parts, &options);
    assert!(cache.page_count() > 900, "{}", cache.page_count());
    assert!(cache.page_count() <= 3000, "{}", cache.page_count());
}

#[test]
fn a_rough_surface_keeps_no_light_and_takes_none_from_others() {
    let mut ball = primitives::sphere(0.3, 200, 200);
    for (k, vertex) in ball.vertices.iter_mut().enumerate() {
        let noise = (k as f32 * 12.9898).sin() * 43_758.547;
        vertex.position *= 1.0 + 0.03 * noise.fract();
        let turn = Vec3::new(noise, 3.1 * noise, 7.7 * noise).map(|x| x.fract());
        vertex.normal = (vertex.normal + 2.0 * turn).normalize();
    }
    let mut scene = square_over_table();
    scene.virtual_parts.push(part("rough", ball, DVec3::Z));
    let options = CacheOptions {
        pages: 100,
        map_size: 64,
        lights: 1,
    };
    let cache = SurfaceCache::new(&scene, &scene.virtual_parts, &options);
    let rough = Layer::Virtual(scene.virtual_parts.len() - 1);
    assert_eq!(cache.left_out().collect::<Vec<_>>(), [rough]);
    let layers = cache.receiver_pages();
    assert!(layers.iter().any(|p| matches!(p.layer, Layer::Phantom(_))));
    assert!(layers.iter().all(|p| p.layer != rough));
}

#[test]
fn a_scene_without_casters_has_no_pages() {
    let mut scene = square_over_table();
    scene.virtual_parts.clear();
    let mut cache = cache(&scene);
    assert_eq!(cache.page_count(), 0);
    update(&mut cache, &[light(Vec3::Z, 0.1)], 1, &[0]);
    assert_eq!(cache.shadowed().count(), 0);
}

#[test]
fn a_shadow_in_a_groove_keeps_its_width() {
    // A strip is shaded by one 2 mm above it, whose rim throws its shadow 2 mm far.
    const HEIGHT: f32 = 0.002;
    let strip = |x: f64, z: f32, depth: f32| {
        let at = DVec3::new(x, 0.0, f64::from(z));
        part("strip", primitives::plane(0.1, depth), at)
    };
    let scene = Scene {
        virtual_parts: vec![strip(0.0, 0.0, 0.1), strip(-0.05, HEIGHT, 0.12)],
        ..Scene::default()
    };
    let mut cache = cache(&scene);
    let lights = [light(Vec3::new(-1.0, 0.0, 1.0), 0.005)];
    update(&mut cache, &lights, 1, &[0]);
    let sky = lighting(&lights, 1).irradiance.irradiance(Vec3::Z).x;
    let sun = lights[0].irradiance.x * lights[0].direction.z;
    let (mut shaded, mut all) = (0.0, 0.0);
    for (p, page) in cache.layout.pages.iter().enumerate() {
        if !matches!(cache.parts[page.receiver].layer, Layer::Virtual(0)) {
            continue;
        }
        let (kept, _) = cache.page(p as u32);
        for (k, texel) in kept.iter().enumerate() {
            let inner = |x: usize| (1..=PAGE).contains(&x);
            let is_inner = inner(k % BORDERED) && inner(k / BORDERED);
            if cache.texels[p].is_used[k] && is_inner {
                let area = cache.layout.length(p).powi(2);
                let [r, _, _, weight] = texel.map(half::f16::to_f32);
                shaded += area * (1.0 - (r / weight - sky) / sun);
                all += area;
            }
        }
    }
    let width = shaded / all * 0.1 - 0.05;
    let texel = 0.15 / 512.0;
    assert!((width - HEIGHT).abs() < texel, "{width}");
}

/// A torus, lying `height` above a table, with the distance of any point from it.
const TORUS: (f32, f32, f32) = (0.09, 0.03, 0.05);

fn torus_over_table() -> Scene {
    let (major, minor, height) = TORUS;
    let torus = primitives::torus(major, minor, 225, 130);
    let at = DVec3::new(0.0, 0.0, f64::from(height));
    Scene {
        virtual_parts: vec![part("torus", torus, at)],
        phantom_parts: vec![part("table", primitives::plane(4.0, 4.0), DVec3::ZERO)],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Whether a ray meets the torus.
fn is_hit(from: Vec3, direction: Vec3) -> bool {
    let (major, minor, height) = TORUS;
    let mut along = 0.0;
    while along < 1.0 {
        let p = from + direction * along - Vec3::Z * height;
        let distance = Vec2::new(p.truncate().length() - major, p.z).length() - minor;
        if distance < 1e-5 {
            return true;
        }
        along += distance.max(1e-4);
    }
    false
}

/// The share of a light that a point of the table sees past the torus, by many rays.
fn share_by_rays(at: Vec3, light: &DomeLight) -> f32 {
    const RAYS: usize = 256;
    let (a, b) = light.direction.any_orthonormal_pair();
    let is_open = |k: &usize| {
        let radius = light.angular_radius.tan() * ((*k as f32 + 0.5) / RAYS as f32).sqrt();
        let off = Vec2::from_angle(2.399_963_2 * *k as f32) * radius;
        !is_hit(at, (light.towards(at) + a * off.x + b * off.y).normalize())
    };
    (0..RAYS).filter(is_open).count() as f32 / RAYS as f32
}

#[test]
fn shadows_are_those_of_many_rays() {
    let scene = torus_over_table();
    let options = CacheOptions {
        pages: 1500,
        map_size: 512,
        lights: 8,
    };
    let casters = penumbra_scene::casters(&scene);
    let mut cache = SurfaceCache::new(&scene, &casters, &options);
    for (generation, direction, angular_radius, kind, inverse_distance) in [
        (1, Vec3::new(0.2, 0.1, 1.0), 0.12, LightKind::Cell, 0.0),
        (2, Vec3::new(1.0, 0.4, 0.7), 0.12, LightKind::Cell, 0.0),
        (3, Vec3::new(0.2, -0.4, 1.0), 0.02, LightKind::Compact, 0.0),
        (4, Vec3::new(0.2, -0.4, 1.0), 0.05, LightKind::Compact, 2.5),
    ] {
        let light = DomeLight {
            angular_radius,
            kind,
            place: LightPlace {
                reference: Vec3::new(0.05, 0.02, 0.1),
                inverse_distance,
            },
            ..light(direction, 0.1)
        };
        update(&mut cache, &[light], generation, &[0]);
        let all = |p: Vec3| light.irradiance.x * light.facing(p, Vec3::Z);
        let near = real_texels(&cache).into_iter().step_by(23);
        let near = near.filter(|(p, ..)| p.truncate().length() < 0.3);
        let mut errors: Vec<f32> = near
            .map(|(p, _, lost, _)| (1.0 - lost.x / all(p) - share_by_rays(p, &light)).abs())
            .collect();
        errors.sort_by(f32::total_cmp);
        let mean = errors.iter().sum::<f32>() / errors.len() as f32;
        let most = errors[errors.len() * 99 / 100];
        println!(
            "{kind:?} {direction}: {} texels, {mean} {most}",
            errors.len()
        );
        assert!(mean < 0.012 && most < 0.17, "{direction}: {mean} {most}");
    }
}

#[test]
fn registers_of_any_width_give_the_same() {
    let scene = torus_over_table();
    let cache = cache(&scene);
    let casters = Casters::new(&scene, &penumbra_scene::casters(&scene), 512);
    let discs = discs();
    let extents: Vec<Extent> = cache.texels.iter().map(|t| Extent::of(t)).collect();
    let view = PagesView {
        parts: &cache.parts,
        layout: &cache.layout,
        texels: &cache.texels,
        extents: &extents,
        casters: &casters,
        discs: &discs,
        total: 1.0,
    };
    let light = DomeLight {
        kind: LightKind::Cell,
        ..light(Vec3::new(0.5, 0.2, 1.0), 0.12)
    };
    let mut maps = Maps::new(512);
    let mut kept = [0, 1].map(|_| LightPages::new(cache.page_count()));
    let [widest, single] = &mut kept;
    view.renew(widest, &light, &mut maps, false);
    let (map, map_view) = casters.draw(&light, maps.of(false))[0].expect("casters");
    let lit = LitMap {
        map,
        view: map_view,
        spread: light.angular_radius.tan(),
        disc: &discs[0],
    };
    let pages = (
        0,
        &mut single.seen[0][..],
        &mut single.reach[0][..],
        &mut single.is_touched[..],
    );
    view.find(pulp::Scalar::new(), Some(&lit), 0, pages);
    assert!(widest.reach[0] == single.reach[0]);
    for (p, reach) in widest.reach[0].iter().enumerate() {
        let of = |kept: &LightPages| kept.seen[0][p * TEXELS..(p + 1) * TEXELS].to_vec();
        assert!(
            *reach == Reach::Open || of(widest) == of(single),
            "page {p}"
        );
    }
}
