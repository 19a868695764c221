//! What it costs to turn an environment picture into light, and of that to filter what glossy
//! surfaces mirror: `cargo bench -p penumbra --bench light`.

#![expect(clippy::unwrap_used)]
#![allow(missing_docs)]

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DQuat, DVec2, DVec3, Vec3};
use penumbra_camera::Response;
use penumbra_camera::{EnvironmentView, FisheyeLens};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::box_chain::box_chain;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::prefilter::Prefilter;
use penumbra_lighting::{
    Bracket, EnvironmentEstimator, EnvironmentInput, EnvironmentSettings, Filtering,
};
use penumbra_picture::Picture;
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

/// A fisheye's picture of 640×480: dim, with a bright lamp.
fn photograph() -> Picture {
    let code = |i: u32| {
        let (x, y) = (i % 640, i / 640);
        let lamp = x.abs_diff(400) < 9 && y.abs_diff(180) < 9;
        let v = if lamp {
            255
        } else {
            (40 + (x + 2 * y) % 90) as u8
        };
        [v, v, v / 2 + 30, 255]
    };
    Picture {
        width: 640,
        height: 480,
        rgba: (0..640 * 480).flat_map(code).collect(),
    }
}

/// The whole way: sources, cube, irradiance, dome lights and reflections.
fn light(c: &mut Criterion) {
    let view = EnvironmentView::Fisheye {
        lens: FisheyeLens {
            width: 640,
            height: 480,
            focal: 151.0,
            centre: DVec2::new(320.0, 240.0),
            distortion: [0.0; 4],
            max_theta: std::f64::consts::FRAC_PI_2,
        },
        world_from_camera: RigidTransform::new(DQuat::IDENTITY, DVec3::ZERO),
    };
    let picture = photograph();
    let mut group = c.benchmark_group("light of 640x480");
    group.sample_size(20);
    for (name, size, filtering, phong) in [
        ("64, ggx", 64, Filtering::Prefiltered, false),
        ("64, ggx and phong", 64, Filtering::Prefiltered, true),
        ("128, ggx", 128, Filtering::Prefiltered, false),
        ("128, ggx and phong", 128, Filtering::Prefiltered, true),
        ("128, box", 128, Filtering::Box, true),
    ] {
        let settings = EnvironmentSettings {
            cube_size: size,
            filtering,
            phong,
            ..EnvironmentSettings::default()
        };
        let mut estimator =
            EnvironmentEstimator::new(&view, &Response::srgb(), settings, None).unwrap();
        let brackets = [Bracket {
            picture: &picture,
            ev: 0.0,
        }];
        let input = EnvironmentInput::new(&brackets, MonotonicTime::default());
        group.bench_function(name, |b| b.iter(|| estimator.update(black_box(&input))));
    }
    group.finish();
}

criterion_group!(benches, filtering, light);
criterion_main!(benches);
