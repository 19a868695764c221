//! Bakes basis images of compact sources (sun, lamp) from their true directions while frames are
//! composed, a few planes per frame. Casters and receivers stay on the device as they were at the
//! time of the bake.

use super::super::bindings::{Slot, compute_layout, compute_pipeline, group, view};
use super::super::caster_hull::fit;
use super::super::compiled::Device;
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

/// Texels along a side of a direction's maps: half of the bake's, because they are drawn between
/// two frames and must be fast.
const MAP_SIZE: u32 = 1024;

/// Planes per frame for which a direction is evaluated on a software driver: this takes a quarter
/// of a frame's time, as does drawing the direction's maps. A real GPU evaluates all planes at
/// once.
pub(super) const SOFTWARE_PLANES_PER_FRAME: u32 = 4;

/// Twin of WGSL `Images` in `bake_source.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct Images {
    pub planes: [u32; 4],
    pub source: [u32; 4],
}

/// The resources into which images are written.
pub(super) struct SourceOutput {
    pub group: wgpu::BindGroup,
    /// Directions of lights.
    pub faces: wgpu::Buffer,
    pub dome_lights: u32,
    pub first_image: u32,
    pub across: u32,
}

/// The casters, the receivers and the passes that bake the images of compact sources.
pub struct SourceBaker {
    pub(super) gpu: Gpu,
    pub(super) passes: BakePasses,
    scene: BakeScene,
    pub(super) store: Store,
    pub(super) planes: u32,
    pub(super) real: u32,
    pub(super) side: u32,
    /// Planes that are evaluated per frame.
    pub(super) planes_per_frame: u32,
    uniforms: [wgpu::Buffer; 3],
    pub(super) images: wgpu::Buffer,
    maps: [wgpu::TextureView; 2],
    pub(super) sums: wgpu::Buffer,
    flags: wgpu::Buffer,
    pub(super) group: wgpu::BindGroup,
}

/// The pipelines that store finished sums as basis images.
pub(super) struct Store {
    layout: wgpu::BindGroupLayout,
    pub store: wgpu::ComputePipeline,
    pub number: wgpu::ComputePipeline,
    pub reset: wgpu::ComputePipeline,
}

impl Store {
    fn new(device: &Device, side: u32) -> Self {
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
        let shader = shaders::bake_shader("bake_source", side);
        let pipeline = |entry| compute_pipeline(device, &shader, &[&layout], entry);
        Self {
            store: pipeline("store"),
            number: pipeline("number"),
            reset: pipeline("reset"),
            layout,
        }
    }
}

impl SourceBaker {
    /// Uploads `scene`, as it was when `bake` was made. This may take a second and must not run on
    /// the render thread.
    ///
    /// # Errors
    /// The device, which need not be the one that made the bake, cannot hold the sums of all
    /// planes.
    pub fn new(gpu: &Gpu, scene: &Scene, bake: &Bake) -> Result<Self, GpuError> {
        let (device, queue) = (&gpu.device, &gpu.queue);
        let side = bake.settings.resolution;
        let planes = bake.planes.len();
        let texels = u64::from(side).pow(2) * planes as u64;
        let max_bytes = device.limits().max_storage_buffer_binding_size;
        if 16 * texels > max_bytes {
            let reason = format!(
                "the sums of compact sources on {planes} planes of {side}² texels take {} MB, the \
                 device allows {} MB; choose fewer or smaller planes, or `sources = false`, \
                 in [planes]",
                texels >> 16,
                max_bytes >> 20
            );
            let adapter = gpu.name.clone();
            return Err(GpuError::Unfit { adapter, reason });
        }
        let passes = BakePasses::new(device, side);
        let scene = BakeScene::new(device, queue, scene, &bake.planes, MAP_SIZE);
        let receivers = bake.receivers.iter();
        let receivers: Vec<_> = receivers.flat_map(|r| words(r, side as usize)).collect();
        let receivers = storage(device, queue, "receivers", &receivers);
        let buffer = |label, bytes, usage| buffer_of(device, label, bytes, usage | U::COPY_DST);
        let uniform = |label, size| buffer(label, size as u64, U::UNIFORM);
        let uniforms = [
            uniform("direction", size_of::<Direction>()),
            uniform("map", 48),
            uniform("map", 48),
        ];
        let maps = ["model map", "phantom map"].map(|label| depth_square(device, label, MAP_SIZE));
        let sums = buffer("sums", 16 * texels, U::STORAGE);
        let flags = buffer("flags", 4 * planes as u64, U::STORAGE);
        // `add` does not write it.
        let lost = buffer("lost", 16, U::STORAGE);
        let read = [&uniforms[0], &scene.planes, &receivers];
        let group = passes.bind(device, read, [&maps[0], &maps[1]], [&sums, &lost, &flags]);
        let real = bake.planes.iter().filter(|p| p.layer == Layer::Real);
        Ok(Self {
            store: Store::new(device, side),
            planes: planes as u32,
            real: real.count() as u32,
            side,
            planes_per_frame: if gpu.software {
                SOFTWARE_PLANES_PER_FRAME
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

    /// Binds the resources `targets`, into which images are written.
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

    /// Draws both maps of a direction.
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

    /// Uploads a direction, its share of the light, and the first plane that is evaluated.
    pub(super) fn upload(&self, (towards, share): (Vec3, f32), first: u32) {
        let queue = &self.gpu.queue;
        let [model, phantoms] = self.casters().map(|c| fit(&c.hull, towards, MAP_SIZE));
        let flag = |c: &BakeCasters| if c.mesh.is_some() { 1.0 } else { 0.0 };
        let [has_model, has_phantoms] = self.casters().map(flag);
        let uniform = Direction {
            model: model.rows,
            phantoms: phantoms.rows,
            towards: towards.extend(share).to_array(),
            texels: [model.texel, phantoms.texel, has_model, has_phantoms],
            planes: [first, 0, 0, 0],
        };
        let [direction, model_map, phantom_map] = &self.uniforms;
        queue.write_buffer(direction, 0, bytemuck::bytes_of(&uniform));
        queue.write_buffer(model_map, 0, bytemuck::cast_slice(&model.rows));
        queue.write_buffer(phantom_map, 0, bytemuck::cast_slice(&phantoms.rows));
    }
}
