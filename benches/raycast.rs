//! Measures the ray caster: its preparation, nearest hits and occlusion tests.
//!
//! `cargo bench -p penumbra-scene`
#![allow(missing_docs, clippy::expect_used)]

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use glam::{DMat4, DVec3};
use penumbra_scene::raycast::RayCaster;
use penumbra_scene::{Material, Mesh, Part, Scene, load_ply, primitives};
use std::hint::black_box;
use std::sync::Arc;

/// Number of rays of a measurement.
const RAYS: usize = 10_000;

fn part(name: &str, mesh: Mesh) -> Part {
    Part {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(Material::default()),
        world_from_part: DMat4::IDENTITY,
        mirror: false,
        albedo: None,
    }
}

/// The phantoms of the rig `courtyard` on their ground: a house, a planter and a bollard.
fn courtyard() -> Option<Scene> {
    let folder = penumbra_test_data::shared("truth/courtyard/phantoms")?;
    let phantom = |name: &str| {
        let file = format!("{name}.ply");
        let bytes = std::fs::read(folder.join(&file)).expect("the phantoms can be read");
        part(
            name,
            load_ply(&bytes, &file).expect("the phantoms are PLY files"),
        )
    };
    Some(Scene {
        phantom_parts: ["house", "planter", "bollard"].map(phantom).into(),
        ground_height: Some(0.0),
        ..Scene::default()
    })
}

/// A torus of 100,000 triangles.
fn torus() -> Scene {
    let mesh = primitives::torus(2.0, 0.8, 250, 200);
    Scene {
        phantom_parts: vec![part("torus", mesh)],
        ..Scene::default()
    }
}

/// Rays from points around the origin, 2.5 m to 7.5 m away, to points within 3.5 m of it.
fn rays() -> Vec<(DVec3, DVec3)> {
    let mut state = 1_u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(state >> 8) / f64::from(1 << 24)
    };
    let mut vector = || DVec3::new(next() - 0.5, next() - 0.5, next() - 0.5);
    let ray = |_| {
        let origin = vector().normalize() * (5.0 + 5.0 * vector().x);
        let origin = origin.with_z(origin.z.abs());
        (origin, 4.0 * vector() - origin)
    };
    (0..RAYS).map(ray).collect()
}

fn raycast(criterion: &mut Criterion) {
    let rays = rays();
    let scenes = [
        ("courtyard", courtyard()),
        ("100k triangles", Some(torus())),
    ];
    for (name, scene) in scenes {
        let Some(scene) = scene else { continue };
        let caster = RayCaster::from_phantoms(&scene);
        let mut group = criterion.benchmark_group(name);
        group.bench_function("prepare", |bencher| {
            bencher.iter_batched(
                || (),
                |()| RayCaster::from_phantoms(black_box(&scene)),
                BatchSize::LargeInput,
            );
        });
        group.throughput(Throughput::Elements(RAYS as u64));
        group.bench_function("nearest", |bencher| {
            let hits = |(origin, direction): &(DVec3, DVec3)| {
                caster.nearest(*origin, *direction).is_some()
            };
            bencher.iter(|| rays.iter().filter(|ray| hits(ray)).count());
        });
        group.bench_function("is_blocked", |bencher| {
            let blocked = |(origin, direction): &(DVec3, DVec3)| {
                caster.is_blocked(*origin, *direction, f64::INFINITY)
            };
            bencher.iter(|| rays.iter().filter(|ray| blocked(ray)).count());
        });
    }
}

criterion_group!(benches, raycast);
criterion_main!(benches);
