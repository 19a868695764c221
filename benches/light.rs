//! What it costs to turn an environment picture into light, and of that to filter what glossy
//! surfaces mirror: `cargo bench -p penumbra --bench light`.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use glam::Vec3;
use penumbra::environment::box_chain::box_chain;
use penumbra::environment::cube::CubeGrid;
use penumbra::environment::prefilter::Prefilter;
use std::hint::black_box;

/// The default of `[environment] cube_size`, and the size of the paper's probe.
const SIZES: [u32; 2] = [128, 64];

fn sky(size: u32) -> Vec<Vec3> {
    let texel = |d: Vec3| d.abs() + Vec3::splat(if d.z > 0.99 { 50.0 } else { 0.2 });
    CubeGrid::new(size)
        .directions
        .into_iter()
        .map(texel)
        .collect()
}

fn filtering(c: &mut Criterion) {
    for size in SIZES {
        let texels = sky(size);
        let ggx = Prefilter::new(size);
        let both = Prefilter::new(size).with_phong(true);
        let mut group = c.benchmark_group(format!("reflections of {size}"));
        group.bench_function("ggx", |b| b.iter(|| ggx.apply(black_box(&texels))));
        group.bench_function("ggx and phong", |b| {
            b.iter(|| both.apply(black_box(&texels)))
        });
        group.bench_function("box", |b| {
            b.iter(|| box_chain(size, black_box(&texels), Vec3::Y))
        });
        group.sample_size(10);
        group.bench_function("tables", |b| b.iter(|| Prefilter::new(black_box(size))));
        group.finish();
    }
}

criterion_group!(benches, filtering);
criterion_main!(benches);
