//! Bakes basis images (Kakuta 2004, section 3.2; 2007, section 2.3): for each plane and each light of
//! the dome, the share of the light that reaches each texel past all casters.

use super::super::caster_hull::{Fit, fit};
use super::super::gpu::{Gpu, GpuError};
use super::super::mesh_buffers::MeshBuffers;
use super::bake_passes::{BakePasses, Direction, MAP, ReceiverView, depth_square, square};
use super::bake_scene::{BakeCasters, BakeScene, receiver_mesh};
use super::compute::{buffer_of, storage};
use super::readback::read_buffer;
use super::receiver::{receiver_image, words};
use super::source_images::SOFTWARE_PLANES_PER_FRAME;
use glam::{DVec3, Vec3};
use penumbra_lighting::geodesic::{Face, GeodesicDome};
use penumbra_scene::Scene;
use penumbra_scene::planes::{
    Bake, BakeSettings, Basis, Image, Layer, Receiver, ReceiverImage, ShadowingPlane,
};
use std::ops::ControlFlow;
use wgpu::BufferUsages as U;

/// Bits of a plane's flags; twins of the constants in `lib/image_flags.wgsl`.
const ALL_PASS: u32 = 1;
const PHANTOMS_PASS: u32 = 2;
const ALL_HIDE: u32 = 4;
const PHANTOMS_HIDE: u32 = 8;
const FACED: u32 = 16;

/// Receives the number of finished lights and of all lights, and returns whether to continue.
pub type Progress<'a> = dyn FnMut(usize, usize) -> ControlFlow<()> + 'a;

/// Bakes all images of `planes`. The key of the bake is zero.
///
/// # Errors
/// The device failed or cannot hold that many planes, the settings are out of range, or `progress`
/// stopped the bake.
pub fn bake(
    gpu: &Gpu,
    scene: &Scene,
    mut planes: Vec<ShadowingPlane>,
    settings: BakeSettings,
    progress: &mut Progress<'_>,
) -> Result<Bake, GpuError> {
    planes.sort_by_key(|p| p.layer == Layer::Virtual);
    let faces = faces(gpu, settings, planes.len())?;
    let mut baker = Baker::new(gpu, scene, &planes, settings);
    let receivers = baker.receivers(scene, &planes)?;
    let mut work = baker.work(&receivers);
    let mut by_light = Vec::with_capacity(faces.len());
    let mut texels = Vec::new();
    for (i, face) in faces.iter().enumerate() {
        report(progress, i, faces.len())?;
        by_light.push(work.light(&baker, face, &mut texels)?);
    }
    report(progress, faces.len(), faces.len())?;
    let images = (0..planes.len())
        .flat_map(|k| by_light.iter().map(move |light| light[k]))
        .collect();
    Ok(Bake {
        key: [0; 32],
        settings,
        planes,
        receivers,
        images,
        texels,
    })
}

/// Reports progress; an error if it stops the bake.
pub(super) fn report(progress: &mut Progress<'_>, done: usize, all: usize) -> Result<(), GpuError> {
    match progress(done, all) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(GpuError::Stopped),
    }
}

/// Returns the faces of the dome, after a check of the settings.
pub(super) fn faces(
    gpu: &Gpu,
    settings: BakeSettings,
    planes: usize,
) -> Result<Vec<Face>, GpuError> {
    let unfit = |reason: String| GpuError::Unfit {
        adapter: gpu.name.clone(),
        reason,
    };
    let BakeSettings {
        resolution,
        frequency,
        samples,
    } = settings;
    let side = samples.isqrt();
    if !(16..=1024).contains(&resolution) || resolution % 4 != 0 {
        let reason = format!("basis images of {resolution}² texels (16 to 1024, a multiple of 4)");
        return Err(unfit(reason));
    }
    if side * side != samples || !(1..=64).contains(&samples) {
        let reason = format!("{samples} directions per face (1, 4, 9, 16, 25, 36, 49 or 64)");
        return Err(unfit(reason));
    }
    let dome = GeodesicDome::new(frequency)
        .ok_or_else(|| unfit(format!("a geodesic dome of frequency {frequency}")))?;
    let sums = u64::from(resolution).pow(2) * 16 * planes as u64;
    let max_size = gpu.device.limits().max_storage_buffer_binding_size;
    if sums > max_size {
        let reason = format!(
            "{planes} planes of {resolution}² texels: {} MB, at most {} MB; choose fewer or smaller \
             ones under [planes]",
            sums >> 20,
            max_size >> 20
        );
        return Err(unfit(reason));
    }
    Ok(dome.faces)
}

/// The parts of a bake that all lights share.
pub(super) struct Baker<'a> {
    gpu: &'a Gpu,
    settings: BakeSettings,
    passes: BakePasses,
    scene: BakeScene,
    planes: u32,
    layers: Vec<Layer>,
}

impl<'a> Baker<'a> {
    pub fn new(
        gpu: &'a Gpu,
        scene: &Scene,
        planes: &[ShadowingPlane],
        settings: BakeSettings,
    ) -> Self {
        Self {
            passes: BakePasses::new(&gpu.device, settings.resolution),
            scene: BakeScene::new(&gpu.device, &gpu.queue, scene, planes, MAP),
            planes: planes.len() as u32,
            layers: planes.iter().map(|p| p.layer).collect(),
            settings,
            gpu,
        }
    }

    /// Submits a small part of the work and waits for it: a picture that is composed meanwhile waits
    /// for one part at most.
    fn submit(&self, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> Result<(), GpuError> {
        let descriptor = wgpu::CommandEncoderDescriptor {
            label: Some("bake"),
        };
        let mut encoder = self.gpu.device.create_command_encoder(&descriptor);
        record(&mut encoder);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait()
    }

    /// Renders each plane's receiver image.
    pub fn receivers(
        &mut self,
        scene: &Scene,
        planes: &[ShadowingPlane],
    ) -> Result<Vec<ReceiverImage>, GpuError> {
        let device = &self.gpu.device;
        let meshes = |parts: &[penumbra_scene::Part]| -> Vec<Option<MeshBuffers>> {
            parts.iter().map(|p| receiver_mesh(device, p)).collect()
        };
        let (virtual_meshes, phantom_meshes) =
            (meshes(&scene.virtual_parts), meshes(&scene.phantom_parts));
        let render = |plane: &ShadowingPlane| {
            if plane.receiver == Receiver::Plane {
                return Ok(ReceiverImage::default());
            }
            let all = match plane.layer {
                Layer::Virtual => &virtual_meshes,
                Layer::Real => &phantom_meshes,
            };
            let chosen = plane
                .parts
                .iter()
                .filter_map(|i| all.get(*i as usize)?.as_ref());
            self.receiver(plane, &chosen.collect::<Vec<_>>())
        };
        planes.iter().map(render).collect()
    }

    fn receiver(
        &self,
        plane: &ShadowingPlane,
        meshes: &[&MeshBuffers],
    ) -> Result<ReceiverImage, GpuError> {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let side = self.settings.resolution;
        let colour = square(device, "receiver", side, wgpu::TextureFormat::Rgba32Float);
        let colour_view = colour.create_view(&wgpu::TextureViewDescriptor::default());
        let depth = depth_square(device, "receiver depth", side);
        let uniform = buffer_of(device, "receiver", 64, U::UNIFORM | U::COPY_DST);
        queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&view_of(plane)));
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let targets = (&colour_view, &depth);
        self.passes
            .record_receiver(device, &mut encoder, targets, &uniform, meshes);
        // Rows in a buffer begin at multiples of 256 bytes.
        let row = (side * 16).next_multiple_of(256);
        let size = u64::from(row) * u64::from(side);
        let buffer = buffer_of(device, "receiver", size, U::COPY_DST | U::MAP_READ);
        encoder.copy_texture_to_buffer(
            colour.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            colour.size(),
        );
        queue.submit([encoder.finish()]);
        let bytes = read_buffer(self.gpu, &buffer)?;
        let rows = bytes.chunks_exact(row as usize);
        let texels: Vec<[f32; 4]> = rows
            .take(side as usize)
            .flat_map(|r| bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(&r[..16 * side as usize]))
            .collect();
        Ok(receiver_image(&texels, side as usize))
    }

    /// Creates the buffers in which a light's images are computed.
    pub fn work(&self, receivers: &[ReceiverImage]) -> Work {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let side = self.settings.resolution as usize;
        let texels = (side * side * self.planes as usize) as u64;
        let receivers: Vec<_> = receivers.iter().flat_map(|r| words(r, side)).collect();
        let uniform = |label| buffer_of(device, label, 144, U::UNIFORM | U::COPY_DST);
        let (direction, model, phantoms) = (uniform("direction"), uniform("map"), uniform("map"));
        let maps = ["model map", "phantom map"].map(|label| depth_square(device, label, MAP));
        let receivers = storage(device, queue, "receivers", &receivers);
        let copied = U::STORAGE | U::COPY_DST | U::COPY_SRC;
        let sums = buffer_of(device, "sums", 16 * texels, copied);
        let lost = buffer_of(device, "lost", 2 * texels, copied);
        let flags = buffer_of(device, "flags", 4 * u64::from(self.planes), copied);
        let read = U::COPY_DST | U::MAP_READ;
        let group = self.passes.bind(
            device,
            [&direction, &self.scene.planes, &receivers],
            [&maps[0], &maps[1]],
            [&sums, &lost, &flags],
        );
        Work {
            readable: buffer_of(device, "images", lost.size() + flags.size(), read),
            uniforms: [direction, model, phantoms],
            maps,
            sums,
            lost,
            flags,
            group,
        }
    }
}

fn view_of(plane: &ShadowingPlane) -> ReceiverView {
    let row = |axis: DVec3, length: f64| {
        let axis = axis / length;
        axis.extend(-axis.dot(plane.centre)).as_vec4().to_array()
    };
    ReceiverView {
        x: row(plane.right, plane.half_size.x),
        y: row(plane.up, plane.half_size.y),
        depth: row(-plane.normal(), plane.depth.max(1e-6)),
        normal: plane.normal().as_vec3().extend(0.0).to_array(),
    }
}

/// The buffers in which a light's images are computed.
pub(super) struct Work {
    uniforms: [wgpu::Buffer; 3],
    maps: [wgpu::TextureView; 2],
    sums: wgpu::Buffer,
    lost: wgpu::Buffer,
    flags: wgpu::Buffer,
    readable: wgpu::Buffer,
    group: wgpu::BindGroup,
}

impl Work {
    /// Bakes the images of one light on all planes. Images that are neither black nor white are
    /// appended to `texels`.
    pub fn light(
        &mut self,
        baker: &Baker<'_>,
        face: &Face,
        texels: &mut Vec<u8>,
    ) -> Result<Vec<Basis>, GpuError> {
        baker.submit(|encoder| {
            encoder.clear_buffer(&self.sums, 0, None);
            encoder.clear_buffer(&self.flags, 0, None);
        })?;
        for (towards, weight) in directions(face, baker.settings.samples) {
            let direction = self.maps(baker, towards, weight)?;
            self.add(baker, direction)?;
        }
        baker.submit(|encoder| {
            let (resolution, planes) = (baker.settings.resolution, baker.planes);
            let passes = &baker.passes;
            passes.record(encoder, &self.group, true, resolution, planes);
            self.copy(encoder);
        })?;
        let bytes = read_buffer(baker.gpu, &self.readable)?;
        Ok(self.images(&bytes, baker, texels))
    }

    /// Renders both shadow maps of one direction; returns its uniform.
    fn maps(&self, baker: &Baker<'_>, towards: Vec3, weight: f32) -> Result<Direction, GpuError> {
        let (device, queue) = (&baker.gpu.device, &baker.gpu.queue);
        let casters = [&baker.scene.model, &baker.scene.phantoms];
        let fits = casters.map(|c: &BakeCasters| fit(&c.hull, towards, MAP));
        let [model, phantoms]: [Fit; 2] = fits;
        let exists = |c: &BakeCasters| if c.mesh.is_some() { 1.0 } else { 0.0 };
        let uniform = Direction {
            model: model.rows,
            phantoms: phantoms.rows,
            towards: towards.extend(weight).to_array(),
            texels: [
                model.texel,
                phantoms.texel,
                exists(casters[0]),
                exists(casters[1]),
            ],
            planes: [0; 4],
        };
        for (k, casters) in casters.into_iter().enumerate() {
            let own = &self.uniforms[k + 1];
            queue.write_buffer(own, 0, bytemuck::cast_slice(&fits[k].rows));
            let (map, mesh) = (&self.maps[k], casters.mesh.as_ref());
            baker.submit(|encoder| baker.passes.record_map(device, encoder, map, own, mesh))?;
        }
        Ok(uniform)
    }

    /// Adds one direction to the sums of all planes.
    fn add(&self, baker: &Baker<'_>, mut direction: Direction) -> Result<(), GpuError> {
        let resolution = baker.settings.resolution;
        let part = if baker.gpu.software {
            SOFTWARE_PLANES_PER_FRAME
        } else {
            baker.planes.max(1)
        };
        for first in (0..baker.planes).step_by(part as usize) {
            direction.planes[0] = first;
            let (queue, count) = (&baker.gpu.queue, part.min(baker.planes - first));
            queue.write_buffer(&self.uniforms[0], 0, bytemuck::bytes_of(&direction));
            let passes = &baker.passes;
            baker.submit(|e| passes.record(e, &self.group, false, resolution, count))?;
        }
        Ok(())
    }

    fn copy(&self, encoder: &mut wgpu::CommandEncoder) {
        let (images, flags) = (self.lost.size(), self.flags.size());
        encoder.copy_buffer_to_buffer(&self.lost, 0, &self.readable, 0, images);
        encoder.copy_buffer_to_buffer(&self.flags, 0, &self.readable, images, flags);
    }

    fn images(&self, bytes: &[u8], baker: &Baker<'_>, texels: &mut Vec<u8>) -> Vec<Basis> {
        let one = baker.settings.resolution.pow(2) as usize;
        let planes = baker.planes as usize;
        let flags = &bytes[self.lost.size() as usize..];
        let half = self.lost.size() as usize / 2;
        let mut keep = |at: usize| {
            let number = texels.len() / one;
            texels.extend_from_slice(&bytes[at..at + one]);
            Image::Stored(number as u32)
        };
        let mut image = |flag: u32, arrives: u32, hides: u32, at: usize| {
            if flag & arrives == 0 {
                Image::Black
            } else if flag & hides == 0 {
                Image::White
            } else {
                keep(at)
            }
        };
        let basis = |k: usize| {
            let flag = bytemuck::pod_read_unaligned(&flags[4 * k..4 * k + 4]);
            let past_all = image(flag, ALL_PASS, ALL_HIDE, k * one);
            let faced = flag & FACED != 0;
            let past_phantoms = if faced && baker.layers[k] == Layer::Virtual {
                Image::White
            } else {
                // Black in both images means that no texel faces the light, not that all of it is
                // blocked.
                let kept = flag
                    | if faced && past_all == Image::Black {
                        PHANTOMS_PASS
                    } else {
                        0
                    };
                image(kept, PHANTOMS_PASS, PHANTOMS_HIDE, half + k * one)
            };
            Basis {
                past_all,
                past_phantoms,
            }
        };
        (0..planes).map(basis).collect()
    }
}

/// Returns directions that are evenly distributed over a face, and their shares: its centre, or the
/// centres of the small triangles into which it is divided.
fn directions(face: &Face, samples: u32) -> Vec<(Vec3, f32)> {
    let side = samples.isqrt().max(1);
    if side == 1 {
        return vec![(face.centre, 1.0)];
    }
    let [a, b, c] = face.corners;
    let at = |i: f32, j: f32| {
        let (u, v) = (i / side as f32, j / side as f32);
        (a * (1.0 - u - v) + b * u + c * v).normalize()
    };
    let share = 1.0 / samples as f32;
    let mut all = Vec::with_capacity(samples as usize);
    for i in 0..side {
        for j in 0..side - i {
            let (x, y) = (i as f32, j as f32);
            let third = 1.0 / 3.0;
            all.push((at(x + third, y + third), share));
            if i + j + 1 < side {
                all.push((at(x + 2.0 * third, y + 2.0 * third), share));
            }
        }
    }
    all
}
