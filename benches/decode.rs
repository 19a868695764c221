//! What it costs to make a picture of a camera's bytes, at 1920×1080.
//!
//! `cargo bench --bench decode`
#![allow(missing_docs, clippy::expect_used)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use penumbra_interface::{BayerPattern, Frame, MonotonicTime, PixelFormat};
use penumbra_picture::{Picture, YuvEncoding, decode_into};
use std::hint::black_box;

const WIDTH: usize = 1920;
const HEIGHT: usize = 1080;

/// Shades with a little noise: JPEG's cost depends on how much there is to code.
fn rgb() -> Vec<u8> {
    let mut noise = 12_345_u32;
    let pixels = (0..WIDTH * HEIGHT).flat_map(|i| {
        let (x, y) = ((i % WIDTH) as f32, (i / WIDTH) as f32);
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let shade = 120.0 + 60.0 * (x * 0.01).sin() + 40.0 * (y * 0.021 + x * 0.003).cos();
        let shade = shade + (noise >> 29) as f32;
        [shade as u8, (shade * 0.8) as u8, (shade * 0.6 + 20.0) as u8]
    });
    pixels.collect()
}

/// As a webcam compresses: chroma halved along the rows.
fn jpeg(rgb: &[u8], quality: i32) -> Vec<u8> {
    let image = turbojpeg::Image {
        pixels: rgb,
        width: WIDTH,
        pitch: 3 * WIDTH,
        height: HEIGHT,
        format: turbojpeg::PixelFormat::RGB,
    };
    let coded = turbojpeg::compress(image, quality, turbojpeg::Subsamp::Sub2x1);
    coded.expect("a picture can be compressed").to_vec()
}

fn frame(format: PixelFormat, data: Vec<u8>) -> Frame {
    Frame {
        data: data.into(),
        format,
        width: WIDTH as u32,
        height: HEIGHT as u32,
        stride: 0,
        sequence: 0,
        captured_at: MonotonicTime::default(),
        arrived_at: MonotonicTime::default(),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

fn decode(criterion: &mut Criterion) {
    let rgb = rgb();
    let raw = |bytes: usize| rgb[..bytes].to_vec();
    let pixels = WIDTH * HEIGHT;
    let mut group = criterion.benchmark_group("decode 1080p");
    group
        .throughput(Throughput::Elements(pixels as u64))
        .sample_size(20);
    let mut picture = Picture::default();
    for (name, frame) in [
        ("mjpeg q80", frame(PixelFormat::Jpeg, jpeg(&rgb, 80))),
        ("mjpeg q95", frame(PixelFormat::Jpeg, jpeg(&rgb, 95))),
        ("yuyv", frame(PixelFormat::Yuyv, raw(2 * pixels))),
        ("nv12", frame(PixelFormat::Nv12, raw(pixels * 3 / 2))),
        ("rgb8", frame(PixelFormat::Rgb8, raw(3 * pixels))),
        ("grey8", frame(PixelFormat::Grey8, raw(pixels))),
        (
            "bayer8",
            frame(PixelFormat::Bayer8(BayerPattern::Rggb), raw(pixels)),
        ),
    ] {
        group.bench_function(name, |bencher| {
            let yuv = YuvEncoding::default();
            bencher.iter(|| decode_into(black_box(&frame), &yuv, &mut picture).is_ok());
        });
    }
    group.finish();
}

criterion_group!(benches, decode);
criterion_main!(benches);
