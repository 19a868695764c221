//! Compact sources as lights of their own among the lights of shadowing planes: follows the
//! sources, bakes their images, and moves their light out of the faces of the dome.

use super::super::bindings::{Slot, compute_layout, compute_pipeline, group};
use super::super::compiled::Device;
use super::super::gpu::Gpu;
use super::super::shaders;
use super::compute::buffer_of;
use super::options::MAX_SOURCES;
use super::source_bake::SourceBake;
use super::source_images::{SourceBaker, SourceOutput};
use super::source_slots::SourceSlots;
use super::source_targets::{SOURCE_LIGHTS, SourceTargets};
use glam::Quat;
use penumbra_lighting::geodesic::FaceLight;
use wgpu::BufferUsages as U;

/// Counts of the work for compact sources.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SourceWork {
    /// Number of sources that are lit by their own images.
    pub sources: usize,
    /// Basis images baked for sources since the bake was activated.
    pub images: u64,
}

/// Owns the slots of sources, their baker and their lights.
pub(super) struct SourceStage {
    baker: SourceBaker,
    output: SourceOutput,
    slots: SourceSlots,
    bake: Option<SourceBake>,
    lights: SourceLights,
    planes: u64,
    pub work: SourceWork,
}

impl SourceStage {
    pub fn new(device: &Device, baker: SourceBaker, targets: &SourceTargets<'_>) -> Self {
        Self {
            output: baker.bind(targets),
            lights: SourceLights::new(device, targets.dome_lights as usize),
            slots: SourceSlots::default(),
            bake: None,
            planes: targets.planes as u64,
            work: SourceWork::default(),
            baker,
        }
    }

    /// Sets the rotation of the bake, which follows its model.
    pub fn set_rotation(&mut self, bake_from_world: Quat) {
        self.slots.bake_from_world = bake_from_world;
    }

    /// Begins with the light of the next frame and renders all images that it needs; without light,
    /// images are rendered over frames from the beginning. May run on any thread.
    pub fn begin(&mut self, gpu: &Gpu, light: Option<&FaceLight>) {
        self.slots
            .follow(light.map_or(&[][..], |light| &light.sources));
        while self.bake_step() {
            // Pictures that are composed meanwhile wait for one step at most. An error is found
            // with the next picture.
            let _ = gpu.wait();
        }
        self.slots.fade(true);
    }

    /// Prepares one frame under `light`: follows its sources, bakes some of the images that they
    /// need (`at_once`: all of them), and uploads the irradiance that they take from faces.
    pub fn prepare(&mut self, queue: &wgpu::Queue, light: &FaceLight, at_once: bool) {
        let first = self.slots.follow(&light.sources);
        while self.bake_step() && (first || at_once) {}
        self.slots.fade(first);
        self.work.sources = self
            .slots
            .in_use()
            .filter(|(_, share, _)| *share > 0.0)
            .count();
        self.lights.upload(queue, &self.slots);
    }

    /// Bakes one step of the requested images; returns false if none are requested.
    fn bake_step(&mut self) -> bool {
        if self.bake.is_none() {
            self.bake = self.slots.request().map(SourceBake::new);
        }
        let Some(bake) = &mut self.bake else {
            return false;
        };
        if bake.step(&self.baker, &self.output) {
            self.slots.finish(&bake.request);
            self.work.images += self.planes;
            self.bake = None;
        }
        true
    }

    /// Divides the sums of faces among faces and sources if any of these changed; returns the
    /// lights and whether they changed.
    pub fn record(
        &mut self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        sums: &wgpu::Buffer,
        changed: bool,
    ) -> (&wgpu::Buffer, bool) {
        let changed = self.lights.record(device, encoder, sums, changed);
        (&self.lights.lights, changed)
    }
}

/// The lights of faces and sources.
struct SourceLights {
    layout: wgpu::BindGroupLayout,
    assign: wgpu::ComputePipeline,
    faces: usize,
    /// Header, then the irradiance that each source takes from each face.
    rows: Vec<[f32; 4]>,
    uploaded: Vec<[f32; 4]>,
    taken: wgpu::Buffer,
    lights: wgpu::Buffer,
    /// The bind group, and the sums that it binds.
    group: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    is_due: bool,
}

impl SourceLights {
    fn new(device: &Device, faces: usize) -> Self {
        let slots = [Slot::Storage, Slot::Storage, Slot::StorageWritten];
        let layout = compute_layout(device, "lights", &slots);
        let shader = shaders::one(shaders::lighting());
        let rows = vec![[0.0; 4]; 1 + MAX_SOURCES * faces];
        let buffer =
            |rows: usize, usage| buffer_of(device, "lights", 16 * rows as u64, U::STORAGE | usage);
        Self {
            assign: compute_pipeline(device, &shader, &[&layout], "assign"),
            layout,
            taken: buffer(rows.len(), U::COPY_DST),
            lights: buffer(faces + SOURCE_LIGHTS, U::COPY_SRC),
            uploaded: Vec::with_capacity(rows.len()),
            faces,
            rows,
            group: None,
            is_due: true,
        }
    }

    fn upload(&mut self, queue: &wgpu::Queue, slots: &SourceSlots) {
        self.rows.fill([0.0; 4]);
        let mut header = [self.faces as u32, 0, 0, 0];
        for (s, (in_use, share, taken)) in slots.in_use().enumerate() {
            header[1 + s] = in_use as u32;
            for (face, irradiance) in taken.iter().filter(|(f, _)| (*f as usize) < self.faces) {
                let row = &mut self.rows[1 + s * self.faces + *face as usize];
                *row = (*irradiance * share).extend(0.0).to_array();
            }
        }
        self.rows[0] = header.map(f32::from_bits);
        let rows: &[u8] = bytemuck::cast_slice(&self.rows);
        if rows == bytemuck::cast_slice::<_, u8>(&self.uploaded) {
            return;
        }
        queue.write_buffer(&self.taken, 0, rows);
        self.uploaded.clone_from(&self.rows);
        self.is_due = true;
    }

    fn record(
        &mut self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        sums: &wgpu::Buffer,
        changed: bool,
    ) -> bool {
        if !(std::mem::take(&mut self.is_due) || changed) {
            return false;
        }
        let current = self.group.take().filter(|(bound, _)| bound == sums);
        let (_, group) = self.group.insert(current.unwrap_or_else(|| {
            let all = [sums, &self.taken, &self.lights].map(wgpu::Buffer::as_entire_binding);
            (sums.clone(), group(device, "lights", &self.layout, &all))
        }));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("lights"),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.assign);
        pass.set_bind_group(0, &*group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        true
    }
}

#[cfg(test)]
mod tests;
