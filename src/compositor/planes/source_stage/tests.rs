use super::super::compute::storage;
use super::super::readback::read_buffer;
use super::*;
use crate::gpu::Gpu;
use glam::Vec3;
use penumbra_lighting::geodesic::FaceSource;

const FACES: usize = 40;

fn gpu() -> Gpu {
    let adapter = std::env::var("PENUMBRA_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned());
    Gpu::open(Some(&adapter)).expect("`make test` installs the software driver")
}

fn source(id: u32, taken: &[(u32, Vec3)]) -> FaceSource {
    FaceSource {
        id,
        direction: Vec3::new(0.3, 0.1 * id as f32, 0.9).normalize(),
        irradiance_in_faces: taken.to_vec(),
        ..FaceSource::default()
    }
}

/// Returns slots that follow `sources` and whose images are finished.
fn following(sources: &[FaceSource]) -> SourceSlots {
    let mut slots = SourceSlots::default();
    slots.follow(sources);
    while let Some(request) = slots.request() {
        slots.finish(&request);
    }
    slots.fade(true);
    slots
}

/// Returns the lights of faces and sources for the `sums` of faces.
fn lights(gpu: &Gpu, sums: &[[f32; 4]], slots: &SourceSlots) -> Vec<Vec3> {
    let (device, queue) = (&gpu.device, &gpu.queue);
    let sums = storage(device, queue, "sums", sums);
    let mut lights = SourceLights::new(device, FACES);
    lights.upload(queue, slots);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    lights.record(device, &mut encoder, &sums, true);
    let size = lights.lights.size();
    let readable = buffer_of(device, "lights", size, U::COPY_DST | U::MAP_READ);
    encoder.copy_buffer_to_buffer(&lights.lights, 0, &readable, 0, size);
    queue.submit([encoder.finish()]);
    let bytes = read_buffer(gpu, &readable).unwrap();
    let rows = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&bytes);
    rows.iter().map(|r| Vec3::from_slice(r)).collect()
}

fn sky() -> Vec<[f32; 4]> {
    let sum = |i: usize| [0.1 + 0.01 * i as f32, 0.2, 0.3, 0.0];
    let mut sums: Vec<_> = (0..FACES).map(sum).collect();
    sums[7] = [9.0, 8.0, 6.0, 0.0];
    sums[8] = [4.0, 4.0, 3.0, 0.0];
    sums
}

fn total(rows: &[[f32; 4]]) -> Vec3 {
    rows.iter().map(|r| Vec3::from_slice(r)).sum()
}

#[test]
fn sources_get_exactly_the_light_that_their_faces_lose() {
    let (gpu, sums) = (gpu(), sky());
    let sun = source(1, &[(7, Vec3::new(8.9, 7.8, 5.7)), (8, Vec3::splat(2.0))]);
    let lamp = source(2, &[(8, Vec3::splat(0.5)), (12, Vec3::splat(0.05))]);
    let given = lights(&gpu, &sums, &following(&[sun.clone(), lamp.clone()]));
    assert_eq!(given.len(), FACES + SOURCE_LIGHTS);
    let all: Vec3 = given.iter().sum();
    assert!((all - total(&sums)).abs().max_element() < 1e-4, "{all}");
    for (at, own) in [(FACES, &sun), (FACES + 2, &lamp)] {
        let light = given[at] + given[at + 1];
        assert!(
            (light - own.irradiance()).abs().max_element() < 1e-5,
            "{light}"
        );
        // One of the two sets has all of the light.
        assert!(given[at].min(given[at + 1]) == Vec3::ZERO);
    }
    assert!((given[7] - Vec3::new(0.1, 0.2, 0.3)).abs().max_element() < 1e-5);
    assert_eq!(given[20], Vec3::from_slice(&sums[20]));
}

#[test]
fn no_face_loses_more_light_than_it_has() {
    let (gpu, sums) = (gpu(), sky());
    // Both sources were brighter in an earlier frame, and one takes light of a face that does not
    // exist.
    let first = source(1, &[(7, Vec3::splat(20.0)), (900, Vec3::ONE)]);
    let second = source(2, &[(7, Vec3::splat(20.0)), (9, Vec3::splat(0.1))]);
    let given = lights(&gpu, &sums, &following(&[first, second]));
    assert!(given.iter().all(|s| s.min_element() >= 0.0));
    assert_eq!(given[7], Vec3::ZERO);
    let all: Vec3 = given.iter().sum();
    assert!((all - total(&sums)).abs().max_element() < 1e-4, "{all}");
}

#[test]
fn without_sources_faces_are_unchanged_bit_for_bit() {
    let (gpu, sums) = (gpu(), sky());
    let given = lights(&gpu, &sums, &following(&[]));
    for (given, had) in given.iter().zip(&sums) {
        assert_eq!(given.to_array(), had[..3]);
    }
    assert!(given[FACES..].iter().all(|s| *s == Vec3::ZERO));
}
