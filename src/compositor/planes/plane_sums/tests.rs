//! The sums of the processor against those of the device, on random images.

use super::super::super::gpu::Gpu;
use super::super::super::shaders::BY_NORMAL;
use super::super::super::timing::Timer;
use super::super::compute::{buffer_of, storage};
use super::super::options::Thresholds;
use super::super::readback::read_buffer;
use super::super::synthesis::{Synthesis, SynthesisPasses};
use super::*;
use glam::{DMat4, DVec2, DVec3, DVec4};
use half::f16;
use penumbra_lighting::geodesic::GeodesicDome;
use penumbra_scene::planes::{Bake, BakeSettings};
use wgpu::BufferUsages as U;

const SIDE: usize = 64;
const ONE: usize = SIDE * SIDE;
const EXACT: Thresholds = Thresholds {
    skip_below: 0.0,
    recompute_above: 0.0,
};

/// Random numbers from 0 to 1.
fn noise(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// Two planes of the real layer and one of the virtual layer, all in sight of [`eye`].
fn random_bake() -> Bake {
    let mut random = noise(7);
    let plane = |layer, receiver| ShadowingPlane {
        centre: DVec3::ZERO,
        right: DVec3::X,
        up: DVec3::Y,
        half_size: DVec2::ONE,
        depth: 0.1,
        layer,
        receiver,
        parts: Vec::new(),
    };
    let planes = vec![
        plane(Layer::Real, Receiver::Plane),
        plane(Layer::Real, Receiver::Surface),
        plane(Layer::Virtual, Receiver::Surface),
    ];
    let mut stored = 0;
    let mut image = || match (12.0 * random()) as u32 {
        0 => Image::Black,
        1 => Image::White,
        _ => {
            stored += 1;
            Image::Stored(stored - 1)
        }
    };
    let basis = |k: usize| Basis {
        past_all: image(),
        past_phantoms: if k < 80 { image() } else { Image::White },
    };
    let images = (0..120).map(basis).collect();
    let texels = (0..stored as usize * ONE).map(|_| (100.0 * random()) as u8);
    let texels = texels.collect();
    let mut code = || (50_000.0 * (random() - 0.5)) as i16;
    let receiver = |seen: usize| ReceiverImage {
        normals: (0..seen).map(|_| [code(), code()]).collect(),
        depths: vec![0; seen],
    };
    Bake {
        key: [0; 32],
        settings: BakeSettings {
            resolution: SIDE as u32,
            ..BakeSettings::default()
        },
        receivers: [0, ONE, ONE].map(receiver).to_vec(),
        planes,
        images,
        texels,
    }
}

/// Clip space from the world above the planes, and the eye.
fn viewer() -> (DMat4, DVec3) {
    let clip_from_world = DMat4::from_cols(DVec4::X, DVec4::Y, DVec4::ZERO, 5.0 * DVec4::W);
    (clip_from_world, 5.0 * DVec3::Z)
}

/// The sums on the device.
struct OnDevice {
    gpu: Gpu,
    passes: SynthesisPasses,
    synthesis: Synthesis,
}

impl OnDevice {
    fn new(bake: &Bake) -> Self {
        let wanted = std::env::var("PENUMBRA_TEST_ADAPTER");
        let wanted = wanted.unwrap_or_else(|_| "llvmpipe".to_owned());
        let gpu = Gpu::open(Some(&wanted)).expect("`make test` installs the software driver");
        let passes = SynthesisPasses::new(&gpu.device);
        let synthesis = Synthesis::new(&gpu, &passes, bake, false).unwrap();
        Self {
            gpu,
            passes,
            synthesis,
        }
    }

    /// Shares past all casters and past phantoms, plane by plane, and the number of images summed.
    fn shares(&mut self, luminance: &[Vec3]) -> ([Vec<Vec4>; 2], usize) {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        self.synthesis.prepare(queue, viewer(), EXACT);
        let rows: Vec<[f32; 4]> = luminance.iter().map(|s| s.extend(0.0).to_array()).collect();
        let rows = storage(device, queue, "luminance", &rows);
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut timer = Timer::new(device, queue, false);
        self.synthesis.record(
            device,
            &mut encoder,
            &mut timer,
            &self.passes,
            (&rows, true),
        );
        let read = self.synthesis.shares.each_ref().map(|view| {
            let size = view.texture().size();
            let bytes = 8 * ONE as u64 * u64::from(size.depth_or_array_layers);
            let readable = buffer_of(device, "shares", bytes, U::COPY_DST | U::MAP_READ);
            let to = wgpu::TexelCopyBufferInfo {
                buffer: &readable,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(8 * SIDE as u32),
                    rows_per_image: Some(SIDE as u32),
                },
            };
            encoder.copy_texture_to_buffer(view.texture().as_image_copy(), to, size);
            readable
        });
        queue.submit([encoder.finish()]);
        let shares = read.map(|readable| {
            let bytes = read_buffer(&self.gpu, &readable).unwrap();
            let texels = bytemuck::pod_collect_to_vec::<u8, [f16; 4]>(&bytes);
            let texels = texels.iter().map(|t| Vec4::from(t.map(f16::to_f32)));
            texels.collect::<Vec<_>>()
        });
        (shares, self.synthesis.work(&self.gpu).unwrap().images)
    }
}

#[test]
fn sums_and_differences_equal_those_of_the_device() {
    let bake = random_bake();
    let mut device = OnDevice::new(&bake);
    let dome = GeodesicDome::new(bake.settings.frequency).unwrap();
    let faces: Vec<Vec3> = dome.faces.iter().map(|f| f.centre).collect();
    let mut asum = NormalTable::new(BY_NORMAL);
    let mut planes: Vec<PlaneSums> = (0..3)
        .map(|k| {
            let basis = &bake.images[40 * k..][..40];
            PlaneSums::new(
                &bake.planes[k],
                &bake.receivers[k],
                (basis, &faces),
                (SIDE, &asum),
            )
        })
        .collect();
    let mut shares = [2, 2, 1].map(|kinds| vec![Vec4::ZERO; kinds * ONE]);
    planes
        .iter_mut()
        .for_each(|p| (0..ONE).for_each(|t| p.need(t)));
    let mut random = noise(3);
    let mut luminance: Vec<Vec3> = (0..40)
        .map(|_| Vec3::new(random(), random(), random()))
        .collect();
    for step in 0..4 {
        asum.sum(faces.iter().copied().zip(luminance.iter().copied()));
        let lights = FaceLights {
            faces: &faces,
            luminance: &luminance,
            asum: &asum,
        };
        for (plane, shares) in planes.iter_mut().zip(&mut shares) {
            plane.update(lights, EXACT.limits(40), &bake.texels, shares);
        }
        let (expected, images) = device.shares(&luminance);
        assert_eq!(images, planes.iter().map(|p| p.job.images).sum::<usize>());
        assert!(images > if step == 0 { 80 } else { 0 });
        for (k, shares) in shares.iter().enumerate() {
            for (i, ours) in shares.iter().enumerate() {
                let kinds = planes[k].kinds;
                let theirs = expected[i % kinds][k * ONE + i / kinds];
                let off = (*ours - theirs).truncate().abs().max_element();
                // Half floats; a GPU interpolates with weights of eight bits.
                let most = if device.gpu.software { 1e-3 } else { 2e-3 };
                assert!(off < most, "{step} {k} {i}: {ours} {theirs}");
            }
        }
        luminance[3 * step] *= 1.5;
        luminance[30 - step] *= 0.5;
    }
}

#[test]
fn planes_that_serve_nothing_are_not_summed() {
    let bake = random_bake();
    let dome = GeodesicDome::new(bake.settings.frequency).unwrap();
    let faces: Vec<Vec3> = dome.faces.iter().map(|f| f.centre).collect();
    let asum = NormalTable::new(BY_NORMAL);
    let (plane, receiver) = (&bake.planes[2], &bake.receivers[2]);
    let basis = (&bake.images[80..], faces.as_slice());
    let mut plane = PlaneSums::new(plane, receiver, basis, (SIDE, &asum));
    let luminance = vec![Vec3::ONE; 40];
    let lights = FaceLights {
        faces: &faces,
        luminance: &luminance,
        asum: &asum,
    };
    let mut shares = vec![Vec4::ZERO; ONE];
    let mut update = |plane: &mut PlaneSums| {
        plane.update(lights, EXACT.limits(40), &bake.texels, &mut shares);
        (
            plane.job.is_due,
            shares.iter().filter(|s| **s != Vec4::ZERO).count(),
        )
    };
    assert_eq!(update(&mut plane), (false, 0));
    plane.need(BLOCK + 1);
    let (is_due, written) = update(&mut plane);
    assert!(is_due && written <= BLOCK && written > 0);
    assert_eq!(update(&mut plane), (false, written));
}
