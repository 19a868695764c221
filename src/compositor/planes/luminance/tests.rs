use super::*;
use crate::gpu::Gpu;
use glam::Vec3;
use penumbra_lighting::cube::CubeGrid;
use penumbra_lighting::geodesic::{GeodesicDome, sum_faces};

/// Opens the software driver, or the adapter that `PENUMBRA_TEST_ADAPTER` names.
fn gpu() -> Gpu {
    let wanted = std::env::var("PENUMBRA_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned());
    Gpu::open(Some(&wanted)).expect("`make test` installs the software driver")
}

/// A grid of 6 · size² directions with noise and a sun that is a million times brighter.
fn light(frequency: u32, size: u32, seed: u32) -> FaceLight {
    let dome = GeodesicDome::new(frequency).unwrap();
    let grid = CubeGrid::new(size);
    let sun = Vec3::new(0.3, 0.5, 0.8).normalize();
    let shade = |(i, d): (usize, &Vec3)| {
        let noise = (i as u32 ^ seed).wrapping_mul(2_654_435_761) >> 8;
        let noise = noise as f32 / (1 << 24) as f32;
        let sun = if d.dot(sun) > 0.9998 { 1e6 } else { 0.0 };
        [noise + sun, 0.3 * noise + 0.9 * sun, d.z.abs() + 0.7 * sun]
    };
    FaceLight {
        frequency,
        membership: Arc::new(Membership::new(&dome, &grid.directions, &grid.solid_angles)),
        radiance: Arc::new(grid.directions.iter().enumerate().map(shade).collect()),
        sources: Vec::new(),
    }
}

fn read(gpu: &Gpu, pass: &LuminancePass) -> Vec<Vec3> {
    let size = u64::from(pass.faces()) * 16;
    let readable = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage: Usage::COPY_DST | Usage::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu
        .device
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_buffer_to_buffer(pass.buffer(), 0, &readable, 0, size);
    gpu.queue.submit([encoder.finish()]);
    readable.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu.wait().unwrap();
    let bytes = readable.get_mapped_range(..).unwrap();
    let sums: &[[f32; 4]] = bytemuck::cast_slice(&bytes);
    sums.iter().map(|s| Vec3::new(s[0], s[1], s[2])).collect()
}

/// Uploads and sums `light`; returns whether there was anything to sum.
fn sum(gpu: &Gpu, pass: &mut LuminancePass, light: &FaceLight, generation: u64) -> bool {
    pass.upload(&gpu.device, &gpu.queue, light, generation)
        .unwrap();
    let mut timer = Timer::new(&gpu.device, &gpu.queue, gpu.timestamps);
    let mut encoder = gpu
        .device
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let summed = pass.record(&gpu.device, &mut encoder, &mut timer);
    timer.end_frame(&mut encoder);
    gpu.queue.submit([encoder.finish()]);
    gpu.wait().unwrap();
    summed
}

fn assert_same(gpu: &[Vec3], cpu: &[Vec3]) {
    assert_eq!(gpu.len(), cpu.len());
    for (face, (a, b)) in gpu.iter().zip(cpu).enumerate() {
        let difference = ((*a - *b) / *b).abs().max_element();
        assert!(difference < 1e-5, "face {face}: {a}, twin {b}");
    }
}

/// The pass on the device, and the one for the adapter.
fn both(gpu: &Gpu) -> [LuminancePass; 2] {
    [
        LuminancePass::new(&gpu.device),
        LuminancePass::for_adapter(gpu),
    ]
}

#[test]
fn sums_equal_those_of_the_cpu() {
    let gpu = gpu();
    for mut pass in both(&gpu) {
        // Growing and shrinking; faces with fewer pixels than invocations, and with many chunks.
        let domes = [(2, 8), (2, 400), (8, 64), (16, 4)];
        for (generation, (frequency, size)) in (0..).zip(domes) {
            let light = light(frequency, size, 0);
            assert!(sum(&gpu, &mut pass, &light, generation));
            assert_eq!(pass.faces(), 10 * frequency * frequency);
            assert_same(&read(&gpu, &pass), &sum_faces(&light));
        }
    }
}

#[test]
fn repeated_sums_are_bit_identical_and_unchanged_light_is_not_summed() {
    let gpu = gpu();
    let (first, second) = (light(4, 64, 1), light(4, 64, 2));
    let second = FaceLight {
        membership: first.membership.clone(),
        ..second
    };
    for mut pass in both(&gpu) {
        assert!(sum(&gpu, &mut pass, &first, 1));
        let sums = read(&gpu, &pass);
        assert!(!sum(&gpu, &mut pass, &first, 1));
        assert!(sum(&gpu, &mut pass, &second, 2));
        assert_same(&read(&gpu, &pass), &sum_faces(&second));
        assert!(sum(&gpu, &mut pass, &first, 3));
        assert_eq!(read(&gpu, &pass), sums);
    }
}

#[test]
fn refuses_light_that_the_device_cannot_bind() {
    let light = light(2, 32, 0);
    let limits = wgpu::Limits {
        max_storage_buffer_binding_size: 1 << 16,
        ..wgpu::Limits::default()
    };
    let error = check(&limits, &light).unwrap_err();
    assert!(
        error.to_string().contains("6144 pixels, 73728 bytes"),
        "{error}"
    );
    assert_eq!(check(&wgpu::Limits::default(), &light), Ok(()));
}
