//! Draws basis images of compact sources (sun, lamp) from their true directions while pictures go
//! on: a few planes with each of them. What casts and what catches shadows stays on the device
//! as it was baked.

use super::super::bindings::{Slot, compute_layout, compute_pipeline, group, view};
use super::super::caster_hull::fit;
use super::super::gpu::{Gpu, GpuError};
use super::super::shaders;
use super::bake_passes::{BakePasses, Direction, depth_square};
use super::bake_scene::{BakeCasters, BakeScene};
use super::compute::{buffer_of, storage};
use super::receiver::words;
use super::source_targets::SourceTargets;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use penumbra_scene::Scene;
use penumbra_scene::planes::{Bake, Layer};
use wgpu::BufferUsages as U;

/// Texels along a side of a direction's maps, half of the bake's: they are drawn between two
/// pictures, which is twice as quick, and courtyard and desks come out the same to 1 %.
const MAP: u32 = 1024;

/// Planes for which a direction is evaluated with one picture on a software driver: a quarter of
/// a picture's time, as is drawing the direction's maps. A real GPU does all at once.
const PLANES_A_PICTURE: u32 = 4;

/// Twin of WGSL `Images` in `bake_source.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct Images {
    pub planes: [u32; 4],
    pub source: [u32; 4],
}

/// Where images go.
pub(super) struct SourceOutput {
    pub group: wgpu::BindGroup,
    /// Directions of lights.
    pub faces: wgpu::Buffer,
    pub dome_lights: u32,
    pub first_image: u32,
    pub across: u32,
}

/// What casts and what catches shadows, and what images are drawn through.
pub struct SourceBaker {
    pub(super) gpu: Gpu,
    pub(super) passes: BakePasses,
    scene: BakeScene,
    pub(super) store: Store,
    pub(super) planes: u32,
    pub(super) real: u32,
    pub(super) side: u32,
    /// Planes that are evaluated with one picture.
    pub(super) pace: u32,
    uniforms: [wgpu::Buffer; 3],
    pub(super) images: wgpu::Buffer,
    maps: [wgpu::TextureView; 2],
    pub(super) sums: wgpu::Buffer,
    flags: wgpu::Buffer,
    pub(super) group: wgpu::BindGroup,
}

pub(super) struct Store {
    layout: wgpu::BindGroupLayout,
    pub store: wgpu::ComputePipeline,
    pub number: wgpu::ComputePipeline,
    pub forget: wgpu::ComputePipeline,
}

impl Store {
    fn new(device: &wgpu::Device, side: u32) -> Self {
        let written = Slot::StorageWritten;
        let slots = [
            Slot::Uniform,
            Slot::Storage,
            written,
            written,
            written,
            Slot::WrittenCodes,
        ];
        let layout = compute_layout(device, "source images", &slots);
        let module = shaders::bake_module(device, "bake_source", side);
        let pipeline = |entry| compute_pipeline(device, &module, &[&layout], entry);
        Self {
            store: pipeline("store"),
            number: pipeline("number"),
            forget: pipeline("reset"),
            layout,
        }
    }
}

impl SourceBaker {
    /// Uploads what `bake` was made of: `scene` as it stood then. It may take a second: not for
    /// the thread that draws pictures.
    ///
    /// # Errors
    /// The device cannot hold sums for so many planes; it may be another than the one that the
    /// bake was made on.
    pub fn new(gpu: &Gpu, scene: &Scene, bake: &Bake) -> Result<Self, GpuError> {
        let (device, queue) = (&gpu.device, &gpu.queue);
        let side = bake.settings.resolution;
        let planes = bake.planes.len();
        let texels = u64::from(side).pow(2) * planes as u64;
        let most = device.limits().max_storage_buffer_binding_size;
        if 16 * texels > most {
            let reason = format!(
                "{planes} planes of {side}² texels with images of the sun and of lamps: {} MB, at \
                 most {} MB; choose fewer or smaller ones, or `sources = false`, under [planes]",
                texels >> 16,
                most >> 20
            );
            let adapter = gpu.name.clone();
            return Err(GpuError::Unfit { adapter, reason });
        }
        let passes = BakePasses::new(device, side);
        let scene = BakeScene::new(device, queue, scene, &bake.planes, MAP);
        let receivers = bake.receivers.iter();
        let receivers: Vec<_> = receivers.flat_map(|r| words(r, side as usize)).collect();
        let receivers = storage(device, queue, "receivers", &receivers);
        let made = |label, bytes, usage| buffer_of(device, label, bytes, usage | U::COPY_DST);
        let uniform = |label, size| made(label, size as u64, U::UNIFORM);
        let uniforms = [
            uniform("direction", size_of::<Direction>()),
            uniform("map", 48),
            uniform("map", 48),
        ];
        let maps = ["model map", "phantom map"].map(|label| depth_square(device, label, MAP));
        let sums = made("sums", 16 * texels, U::STORAGE);
        let flags = made("flags", 4 * planes as u64, U::STORAGE);
        // `add` leaves it alone.
        let lost = made("lost", 16, U::STORAGE);
        let read = [&uniforms[0], &scene.planes, &receivers];
        let group = passes.bind(device, read, [&maps[0], &maps[1]], [&sums, &lost, &flags]);
        let real = bake.planes.iter().filter(|p| p.layer == Layer::Real);
        Ok(Self {
            store: Store::new(device, side),
            planes: planes as u32,
            real: real.count() as u32,
            side,
            pace: if gpu.software {
                PLANES_A_PICTURE
            } else {
                u32::MAX
            },
            images: uniform("source images", size_of::<Images>()),
            gpu: gpu.clone(),
            passes,
            scene,
            uniforms,
            maps,
            sums,
            flags,
            group,
        })
    }

    /// Writes into the sums over `targets`.
    pub(super) fn bind(&self, targets: &SourceTargets<'_>) -> SourceOutput {
        let resources = [
            self.images.as_entire_binding(),
            self.sums.as_entire_binding(),
            self.flags.as_entire_binding(),
            targets.basis.as_entire_binding(),
            targets.applied.as_entire_binding(),
            view(targets.images),
        ];
        SourceOutput {
            group: group(
                &self.gpu.device,
                "source images",
                &self.store.layout,
                &resources,
            ),
            faces: targets.faces.clone(),
            dome_lights: targets.dome_lights,
            first_image: targets.first_image,
            across: targets.across,
        }
    }

    /// Both maps of a direction.
    pub(super) fn draw_maps(&self, encoder: &mut wgpu::CommandEncoder) {
        let device = &self.gpu.device;
        for (k, casters) in self.casters().into_iter().enumerate() {
            let (map, uniform) = (&self.maps[k], &self.uniforms[k + 1]);
            self.passes
                .record_map(device, encoder, map, uniform, casters.mesh.as_ref());
        }
    }

    const fn casters(&self) -> [&BakeCasters; 2] {
        [&self.scene.model, &self.scene.phantoms]
    }

    /// Tells the shaders a direction, its share, and the first plane that it is evaluated on.
    pub(super) fn tell(&self, (towards, share): (Vec3, f32), first: u32) {
        let queue = &self.gpu.queue;
        let [model, phantoms] = self.casters().map(|c| fit(&c.hull, towards, MAP));
        let is = |c: &BakeCasters| if c.mesh.is_some() { 1.0 } else { 0.0 };
        let [some_model, some_phantoms] = self.casters().map(is);
        let uniform = Direction {
            model: model.rows,
            phantoms: phantoms.rows,
            towards: towards.extend(share).to_array(),
            texels: [model.texel, phantoms.texel, some_model, some_phantoms],
            planes: [first, 0, 0, 0],
        };
        let [direction, of_model, of_phantoms] = &self.uniforms;
        queue.write_buffer(direction, 0, bytemuck::bytes_of(&uniform));
        queue.write_buffer(of_model, 0, bytemuck::cast_slice(&model.rows));
        queue.write_buffer(of_phantoms, 0, bytemuck::cast_slice(&phantoms.rows));
    }
}
