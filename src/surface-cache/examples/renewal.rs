//! What it costs to renew lights: a torus of 58,500 triangles on a plane under 64 lights, as in
//! Supan 2006, table 1.
//!
//! `taskset -c 0 cargo run --release -p penumbra-surface-cache --example renewal -- 20 sums.f32`
//! renews 20 times on one processor and writes all sums, for comparison between versions.

use glam::{DMat4, DVec3, Vec3};
use penumbra_interface::MonotonicTime;
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_scene::{Material, Mesh, Part, Scene, primitives};
use penumbra_surface_cache::{CacheOptions, SurfaceCache, SurfaceLight};
use std::sync::Arc;
use std::time::Instant;

const LIGHTS: usize = 64;

fn main() -> std::io::Result<()> {
    let mut arguments = std::env::args().skip(1);
    let count = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(20);
    let scene = scene();
    let options = CacheOptions {
        pages: 1500,
        map_size: 512,
        lights: LIGHTS,
    };
    let casters = penumbra_scene::casters(&scene);
    let mut cache = SurfaceCache::new(&scene, &casters, &options);
    let lighting = lighting();
    let light = SurfaceLight::new(&lighting, &lighting.lights, None);
    let all: Vec<usize> = (0..LIGHTS).collect();
    let mut changed = 0;
    let mut time = |renewed: &dyn Fn(usize) -> Vec<usize>| {
        let mut times: Vec<f64> = (0..count)
            .map(|i| {
                let renewed = renewed(i);
                let start = Instant::now();
                changed += cache.update(&light, &renewed).len();
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times.sort_by(f64::total_cmp);
        (times[0], times[count / 2])
    };
    let (best, median) = time(&|_| all.clone());
    println!("all {LIGHTS} lights: {best:.2} ms at best, median {median:.2} ms");
    let (best, median) = time(&|i| vec![i % LIGHTS]);
    println!("one light: {best:.2} ms at best, median {median:.2} ms");
    println!("{changed} pages changed");
    arguments
        .next()
        .map_or(Ok(()), |path| std::fs::write(path, sums(&cache)))
}

/// All sums as 32-bit numbers.
fn sums(cache: &SurfaceCache) -> Vec<u8> {
    let pages = 0..cache.page_count() as u32;
    let both = pages.map(|p| cache.page(p)).flat_map(|(a, b)| [a, b]);
    let values = both.flatten().flatten();
    values.flat_map(|v| v.to_f32().to_le_bytes()).collect()
}

fn scene() -> Scene {
    let part = |name: &str, mesh: Mesh, at: DVec3| Part {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::from_translation(at),
        mirror: false,
        albedo: None,
    };
    let torus = primitives::torus(0.09, 0.035, 225, 130);
    let table = primitives::plane(8.0, 8.0);
    Scene {
        virtual_parts: vec![part("torus", torus, DVec3::new(0.0, 0.0, 0.06))],
        phantom_parts: vec![part("table", table, DVec3::ZERO)],
        ground_height: Some(0.0),
        ..Scene::default()
    }
}

/// Lights spread evenly over the upper hemisphere.
fn lighting() -> Lighting {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let light = |i: usize| {
        let z = 1.0 - (i as f32 + 0.5) / LIGHTS as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DomeLight {
            direction: Vec3::new(r * cos, r * sin, z.max(0.05)).normalize(),
            irradiance: Vec3::new(0.8 + 0.4 * cos * r, 1.0, 0.8 - 0.4 * cos * r) * 3.0
                / LIGHTS as f32,
            angular_radius: 0.12,
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        }
    };
    let mut irradiance = Harmonics::default();
    irradiance.coefficients[0] = Vec3::splat(2.0);
    Lighting {
        captured_at: MonotonicTime::default(),
        generation: 1,
        radiance: Arc::new(CubeMap::default()),
        irradiance,
        lights: (0..LIGHTS).map(light).collect(),
        ground_radiance: Vec3::splat(0.3),
        faces: None,
    }
}
