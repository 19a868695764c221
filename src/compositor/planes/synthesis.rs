//! Determines in each frame which basis images must be summed, and sums them (Kakuta 2004, 2007).
//! The device decides; the host can read afterwards what was done.

use super::super::bindings::{self, Slot, compute_layout, compute_pipeline, sampler, view};
use super::super::compiled::Device;
use super::super::gpu::{Gpu, GpuError};
use super::super::shaders::{self, Summing};
use super::super::timing::Timer;
use super::atlas::{Atlas, atlas};
use super::compute::{buffer_of, storage};
use super::options::Thresholds;
use super::readback::with_bytes;
use super::receiver::words;
use super::source_targets::{SOURCE_LIGHTS, SourceTargets};
use super::visible_planes::{VisiblePlane, VisiblePlanes};
use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_lighting::geodesic::GeodesicDome;
use penumbra_scene::planes::{Bake, Basis, Image, Layer, Receiver, ShadowingPlane};
use wgpu::BufferUsages as U;

/// Twin of WGSL `Settings` in `lib/sum_planes.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
struct Settings {
    planes: u32,
    lights: u32,
    side: u32,
    real: u32,
    skip_below: f32,
    recompute_above: f32,
    min_change: f32,
    stride: u32,
}

/// Twin of WGSL `SumPlane`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct SumPlane {
    normal: [f32; 4],
    kind: [u32; 4],
}

/// Twin of WGSL `Job`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct Job {
    groups: [u32; 3],
    recompute: u32,
    stored: u32,
    black: u32,
    skipped: u32,
    unused: u32,
    asum: [f32; 4],
}

/// The work of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlaneWork {
    /// Planes that face the viewer and lie in the picture.
    pub visible: usize,
    /// Of those, planes whose sums were recomputed or updated.
    pub recomputed: usize,
    /// Basis images that were summed.
    pub images: usize,
    /// Basis images of the visible planes: those that a complete sum would read.
    pub images_in_sight: usize,
    /// Maximum over the planes of the number of skipped lights.
    pub lights_skipped: usize,
    /// Compact sources whose shadows are cast from their true directions.
    pub sources: usize,
    /// Basis images of compact sources rendered since the bake was set.
    pub source_images: u64,
}

/// The pipelines and layouts, which do not depend on a bake.
pub struct SynthesisPasses {
    plan: wgpu::ComputePipeline,
    sum_by_normal: wgpu::ComputePipeline,
    plan_layout: wgpu::BindGroupLayout,
    sum_layout: wgpu::BindGroupLayout,
    plane_layout: wgpu::BindGroupLayout,
    /// Layout of [`Synthesis::group`].
    pub shown_layout: wgpu::BindGroupLayout,
    smooth: wgpu::Sampler,
}

impl SynthesisPasses {
    /// Compiles the pipelines.
    #[must_use]
    pub fn new(device: &Device) -> Self {
        let (read, write) = (Slot::Storage, Slot::StorageWritten);
        let layers = Slot::WrittenLayers;
        let slots = [
            read, read, read, read, read, write, write, write, read, layers,
        ];
        let plan_layout = compute_layout(device, "plan", &slots);
        let slots = [
            read,
            read,
            Slot::Texture,
            read,
            write,
            layers,
            layers,
            Slot::Layers,
            Slot::Sampler,
        ];
        let sum_layout = compute_layout(device, "sum", &slots);
        let slots = [Slot::UniformOf, Slot::UniformOf];
        let plane_layout = compute_layout(device, "plane", &slots);
        let slots = [Slot::Storage, Slot::Layers, Slot::Layers, Slot::Sampler];
        let shader = shaders::one(shaders::planning());
        Self {
            plan: compute_pipeline(device, &shader, &[&plan_layout], "plan"),
            sum_by_normal: compute_pipeline(device, &shader, &[&plan_layout], "asum_by_normal"),
            shown_layout: bindings::layout(device, "shown planes", &slots),
            plan_layout,
            sum_layout,
            plane_layout,
            smooth: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("planes"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// Creates the pipelines that sum on planes of the real layer and of the virtual layer.
    fn sums(&self, device: &Device, layers: [Summing; 2]) -> [wgpu::ComputePipeline; 2] {
        layers.map(|layer| {
            let shader = shaders::one(shaders::summing(layer));
            let groups = [&self.sum_layout, &self.plane_layout];
            compute_pipeline(device, &shader, &groups, "sum")
        })
    }
}

/// A bake on the device, and its sums.
pub struct Synthesis {
    settings: Settings,
    dome_lights: u32,
    atlas: Atlas,
    visible_planes: VisiblePlanes,
    buffers: Buffers,
    /// The group, and the buffer of luminances that it binds.
    plan_group: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    sums: [wgpu::ComputePipeline; 2],
    sum_group: wgpu::BindGroup,
    plane_group: wgpu::BindGroup,
    shown_group: wgpu::BindGroup,
    by_normal: wgpu::TextureView,
    /// What pixels look up.
    #[cfg(test)]
    pub(super) shares: [wgpu::TextureView; 2],
    visible: Vec<u32>,
    uploaded: Option<Settings>,
}

struct Buffers {
    settings: wgpu::Buffer,
    faces: wgpu::Buffer,
    planes: wgpu::Buffer,
    visible: wgpu::Buffer,
    applied: wgpu::Buffer,
    work: wgpu::Buffer,
    basis: wgpu::Buffer,
    jobs: wgpu::Buffer,
    readable: wgpu::Buffer,
    shown: wgpu::Buffer,
}

impl Buffers {
    /// Creates the buffers of a bake with `added` more lights for compact sources.
    fn new(
        device: &Device,
        queue: &wgpu::Queue,
        bake: &Bake,
        (settings, added): (Settings, usize),
        sum_planes: &[SumPlane],
    ) -> Self {
        let (planes, lights) = (bake.planes.len(), settings.lights as usize);
        let dome = GeodesicDome::new(bake.settings.frequency);
        let faces: Vec<[f32; 4]> = dome
            .iter()
            .flat_map(|d| &d.faces)
            .map(|f| f.centre.extend(0.0).to_array())
            .chain(std::iter::repeat_n([0.0; 4], added))
            .collect();
        let numbers = image_numbers(bake, added);
        let kept =
            |label, bytes: usize, usage| buffer_of(device, label, bytes as u64, U::STORAGE | usage);
        let stride = settings.stride as usize;
        let jobs = planes * size_of::<Job>();
        Self {
            settings: kept("plane settings", size_of::<Settings>(), U::COPY_DST),
            faces: storage(device, queue, "faces", &faces),
            planes: storage(device, queue, "planes", sum_planes),
            visible: kept("visible", planes * 4, U::COPY_DST),
            applied: kept("applied", planes * lights * 16, U::empty()),
            work: kept("work", planes * stride * ENTRY, U::UNIFORM),
            basis: storage(device, queue, "basis", &numbers),
            jobs: kept("jobs", jobs, U::COPY_SRC | U::INDIRECT),
            readable: buffer_of(device, "jobs", jobs as u64, U::COPY_DST | U::MAP_READ),
            shown: kept("shown", VisiblePlanes::bytes(planes), U::COPY_DST),
        }
    }
}

/// Returns the settings of a bake with `added` more lights for compact sources.
fn settings(bake: &Bake, added: usize) -> Settings {
    let lights = bake.lights() + added;
    let real = bake.planes.iter().filter(|p| p.layer == Layer::Real);
    Settings {
        planes: bake.planes.len() as u32,
        lights: lights as u32,
        side: bake.settings.resolution,
        real: real.count() as u32,
        // Offsets of uniforms are multiples of 256 bytes.
        stride: lights.next_multiple_of(256 / ENTRY) as u32,
        ..Settings::default()
    }
}

/// Creates the group of one plane: its lights in `work`, and its number.
fn plane_group(
    device: &Device,
    queue: &wgpu::Queue,
    passes: &SynthesisPasses,
    work: &wgpu::Buffer,
    settings: Settings,
) -> wgpu::BindGroup {
    let numbers: Vec<[u32; 64]> = (0..settings.planes).map(|k| [k; 64]).collect();
    let numbers = uniforms(device, queue, &numbers);
    let part = |buffer, size: usize| wgpu::BufferBinding {
        buffer,
        offset: 0,
        size: std::num::NonZeroU64::new(size as u64),
    };
    let resources = [
        wgpu::BindingResource::Buffer(part(work, settings.lights as usize * ENTRY)),
        wgpu::BindingResource::Buffer(part(&numbers, 16)),
    ];
    bindings::group(device, "plane", &passes.plane_layout, &resources)
}

impl Synthesis {
    /// Uploads `bake`. With `sources`, reserves space for the images of compact sources.
    ///
    /// # Errors
    /// The device cannot hold that many images.
    pub fn new(
        gpu: &Gpu,
        passes: &SynthesisPasses,
        bake: &Bake,
        sources: bool,
    ) -> Result<Self, GpuError> {
        let (device, queue) = (&gpu.device, &gpu.queue);
        let side = bake.settings.resolution;
        let added = if sources { SOURCE_LIGHTS } else { 0 };
        let (planes, vectors) = sum_planes(bake);
        let settings = settings(bake, added);
        let buffers = Buffers::new(device, queue, bake, (settings, added), &planes);
        let layers = [settings.planes, settings.real];
        let shares = layers.map(|layers| half_floats(device, side, layers));
        let by_normal = half_floats(device, shaders::BY_NORMAL, 1);
        let atlas = atlas(gpu, bake, added > 0)?;
        let receivers = bake.receivers.iter();
        let receivers: Vec<_> = receivers.flat_map(|r| words(r, side as usize)).collect();
        let receivers = storage(device, queue, "receivers", &receivers);
        let sums = buffer_of(device, "sums", vectors as u64 * 16, U::STORAGE);
        let resources = [
            buffers.planes.as_entire_binding(),
            buffers.jobs.as_entire_binding(),
            view(&atlas.view),
            receivers.as_entire_binding(),
            sums.as_entire_binding(),
            view(&shares[0]),
            view(&shares[1]),
            view(&by_normal),
            sampler(&passes.smooth),
        ];
        let sum_group = bindings::group(device, "sum", &passes.sum_layout, &resources);
        let summing = [true, false].map(|real| Summing {
            real,
            lights: settings.lights,
            across: atlas.across,
            side,
        });
        let resources = [
            buffers.shown.as_entire_binding(),
            view(&shares[0]),
            view(&shares[1]),
            sampler(&passes.smooth),
        ];
        let shown_group = bindings::group(device, "shown", &passes.shown_layout, &resources);
        Ok(Self {
            visible: vec![0; bake.planes.len()],
            dome_lights: bake.lights() as u32,
            atlas,
            settings,
            visible_planes: VisiblePlanes::new(bake),
            plan_group: None,
            sums: passes.sums(device, summing),
            sum_group,
            plane_group: plane_group(device, queue, passes, &buffers.work, settings),
            buffers,
            shown_group,
            by_normal,
            #[cfg(test)]
            shares,
            uploaded: None,
        })
    }

    /// The buffers and textures into which the images of compact sources are written.
    pub(super) const fn source_targets(&self) -> SourceTargets<'_> {
        SourceTargets {
            planes: self.settings.planes as usize,
            dome_lights: self.dome_lights,
            faces: &self.buffers.faces,
            basis: &self.buffers.basis,
            applied: &self.buffers.applied,
            images: &self.atlas.view,
            across: self.atlas.across,
            first_image: self.atlas.baked,
        }
    }

    /// The bind group of the passes that display planes.
    #[must_use]
    pub const fn group(&self) -> &wgpu::BindGroup {
        &self.shown_group
    }

    /// Bounding box of the planes of the real layer, world: minimum and maximum.
    #[must_use]
    pub const fn bounds(&self) -> (DVec3, DVec3) {
        self.visible_planes.bounds
    }

    /// Moves the bake's `planes` with the objects that carry them.
    pub fn place(&mut self, planes: &[ShadowingPlane], world_from_bake: RigidTransform) {
        self.visible_planes.place(planes, world_from_bake);
    }

    /// Determines the planes that are visible in the view `clip_from_world` from `eye`, and uploads
    /// them.
    pub fn prepare(
        &mut self,
        queue: &wgpu::Queue,
        (clip_from_world, eye): (DMat4, DVec3),
        thresholds: Thresholds,
    ) {
        let seen = self.visible_planes.find_visible(clip_from_world, eye);
        for (flag, seen) in self.visible.iter_mut().zip(seen) {
            *flag = u32::from(*seen);
        }
        queue.write_buffer(
            &self.buffers.visible,
            0,
            bytemuck::cast_slice(&self.visible),
        );
        let (count, each) = self.visible_planes.uploads();
        queue.write_buffer(&self.buffers.shown, 0, bytemuck::cast_slice(count));
        if !each.is_empty() {
            queue.write_buffer(
                &self.buffers.shown,
                16,
                bytemuck::cast_slice::<VisiblePlane, u8>(each),
            );
        }
        let limits = thresholds.limits(self.dome_lights as usize);
        let settings = Settings {
            skip_below: limits.skip_below,
            recompute_above: limits.recompute_above,
            min_change: limits.min_change,
            ..self.settings
        };
        if self.uploaded != Some(settings) {
            queue.write_buffer(&self.buffers.settings, 0, bytemuck::bytes_of(&settings));
            self.uploaded = Some(settings);
        }
    }

    /// Records planning and summing. `luminance` has one vector per light (face of the dome or
    /// compact source), and whether any has changed since the last picture.
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        passes: &SynthesisPasses,
        (luminance, changed): (&wgpu::Buffer, bool),
    ) {
        let b = &self.buffers;
        let known = self
            .plan_group
            .take()
            .filter(|(bound, _)| bound == luminance);
        let (_, plan_group) = self.plan_group.insert(known.unwrap_or_else(|| {
            let all = [
                &b.settings,
                &b.faces,
                luminance,
                &b.planes,
                &b.visible,
                &b.applied,
                &b.work,
                &b.jobs,
                &b.basis,
            ];
            let mut resources: Vec<_> = all.iter().map(|b| b.as_entire_binding()).collect();
            resources.push(view(&self.by_normal));
            let group = bindings::group(device, "plan", &passes.plan_layout, &resources);
            (luminance.clone(), group)
        }));
        let Settings {
            planes,
            real,
            stride,
            ..
        } = self.settings;
        for summing in [false, true] {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("basis_images"),
                timestamp_writes: timer.compute_span("basis_images", !summing, summing),
            });
            if !summing {
                pass.set_pipeline(&passes.plan);
                pass.set_bind_group(0, &*plan_group, &[]);
                pass.dispatch_workgroups(planes.div_ceil(64), 1, 1);
                if changed {
                    pass.set_pipeline(&passes.sum_by_normal);
                    pass.dispatch_workgroups(shaders::BY_NORMAL.pow(2).div_ceil(64), 1, 1);
                }
                continue;
            }
            pass.set_bind_group(0, &self.sum_group, &[]);
            for k in (0..planes).filter(|k| self.visible[*k as usize] != 0) {
                let offsets = [k * stride * ENTRY as u32, k * 256];
                pass.set_pipeline(&self.sums[usize::from(k >= real)]);
                pass.set_bind_group(1, &self.plane_group, &offsets);
                pass.dispatch_workgroups_indirect(&b.jobs, u64::from(k) * size_of::<Job>() as u64);
            }
        }
        encoder.copy_buffer_to_buffer(&b.jobs, 0, &b.readable, 0, b.jobs.size());
    }

    /// Returns the work of the last frame; waits for its completion.
    ///
    /// # Errors
    /// The device failed.
    pub fn work(&self, gpu: &Gpu) -> Result<PlaneWork, GpuError> {
        with_bytes(gpu, &self.buffers.readable, |bytes| self.work_of(bytes))
    }

    fn work_of(&self, jobs: &[u8]) -> PlaneWork {
        let jobs = jobs.chunks_exact(size_of::<Job>());
        let mut work = PlaneWork::default();
        for (job, seen) in jobs.zip(&self.visible) {
            let job: Job = bytemuck::pod_read_unaligned(job);
            work.visible += *seen as usize;
            work.recomputed += usize::from(job.groups[0] > 0);
            work.images += (job.stored + job.black) as usize;
            work.images_in_sight += (*seen * self.dome_lights) as usize;
            work.lights_skipped = work.lights_skipped.max(job.skipped as usize);
        }
        work
    }
}

/// Returns the planes and the number of vectors of their sums: for four texels six on the real
/// layer, three on the virtual one.
fn sum_planes(bake: &Bake) -> (Vec<SumPlane>, usize) {
    let words = bake.settings.resolution.pow(2) / 4;
    let mut begin = 0;
    let encode = |plane: &ShadowingPlane| {
        let at = begin;
        begin += words * if plane.layer == Layer::Real { 6 } else { 3 };
        SumPlane {
            normal: plane.normal().as_vec3().extend(0.0).to_array(),
            kind: [u32::from(plane.receiver == Receiver::Plane), at, 0, 0],
        }
    };
    let planes = bake.planes.iter().map(encode).collect();
    (planes, begin as usize)
}

/// Size of WGSL `Entry`, bytes.
const ENTRY: usize = 32;

/// Returns the numbers of all images: per plane those of the dome's lights, and `added` more, which
/// do not exist yet.
fn image_numbers(bake: &Bake, added: usize) -> Vec<[u32; 2]> {
    let both = |b: &Basis| [number(b.past_all), number(b.past_phantoms)];
    let none = [number(Image::Black); 2];
    let rows = bake.images.chunks(bake.lights().max(1));
    rows.flat_map(|row| row.iter().map(both).chain(std::iter::repeat_n(none, added)))
        .collect()
}

fn uniforms(device: &Device, queue: &wgpu::Queue, each: &[[u32; 64]]) -> wgpu::Buffer {
    let bytes: &[u8] = bytemuck::cast_slice(each);
    let usage = U::UNIFORM | U::COPY_DST;
    let buffer = buffer_of(device, "numbers", bytes.len() as u64, usage);
    queue.write_buffer(&buffer, 0, bytes);
    buffer
}

/// Returns the number by which the shader identifies an image.
const fn number(image: Image) -> u32 {
    match image {
        Image::Black => u32::MAX,
        Image::White => u32::MAX - 1,
        Image::Stored(i) => i,
    }
}

/// Creates an array of square textures that compute shaders write.
fn half_floats(device: &Device, side: u32, layers: u32) -> wgpu::TextureView {
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("shares"),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: layers.max(1),
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::STORAGE_BINDING
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2Array),
        ..Default::default()
    })
}
