//! Compact sources as lights of their own among those of planes: which they are, their images, and
//! what they take from the faces of the dome.

use super::super::bindings::{Slot, compute_layout, compute_pipeline, group};
use super::super::shaders;
use super::compute::buffer_of;
use super::options::SOURCES;
use super::source_drawing::Drawing;
use super::source_images::{SourceBaker, SourceOutput};
use super::source_slots::SourceSlots;
use super::source_targets::{SOURCE_LIGHTS, SourceTargets};
use glam::Quat;
use penumbra_lighting::geodesic::FaceLight;
use wgpu::BufferUsages as U;

/// What has been done for sources so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SourceWork {
    /// Sources that are lit by their own images.
    pub sources: usize,
    /// Basis images drawn since the bake was put in force.
    pub images: u64,
}

/// Everything that is kept for sources.
pub(super) struct SourceStage {
    baker: SourceBaker,
    output: SourceOutput,
    slots: SourceSlots,
    drawing: Option<Drawing>,
    lights: SourceLights,
    planes: u64,
    pub work: SourceWork,
}

impl SourceStage {
    pub fn new(device: &wgpu::Device, baker: SourceBaker, targets: &SourceTargets<'_>) -> Self {
        Self {
            output: baker.bind(targets),
            lights: SourceLights::new(device, targets.dome_lights as usize),
            slots: SourceSlots::default(),
            drawing: None,
            planes: targets.planes as u64,
            work: SourceWork::default(),
            baker,
        }
    }

    /// The bake was turned with its model.
    pub fn turn(&mut self, bake_from_world: Quat) {
        self.slots.bake_from_world = bake_from_world;
    }

    /// One picture in a light: follows its sources, draws some of the images
    /// that they want, and tells the device what they take from faces.
    pub fn prepare(&mut self, queue: &wgpu::Queue, light: &FaceLight) {
        let first = self.slots.follow(&light.sources);
        while self.draw() && first {}
        self.slots.fade(first);
        self.work.sources = self
            .slots
            .shown()
            .filter(|(_, share, _)| *share > 0.0)
            .count();
        self.lights.upload(queue, &self.slots);
    }

    /// A step of what is wanted; false where nothing is.
    fn draw(&mut self) -> bool {
        if self.drawing.is_none() {
            self.drawing = self.slots.wanted().map(Drawing::new);
        }
        let Some(drawing) = &mut self.drawing else {
            return false;
        };
        if drawing.step(&self.baker, &self.output) {
            self.slots.made(&drawing.wanted);
            self.work.images += self.planes;
            self.drawing = None;
        }
        true
    }

    /// Divides the faces' sums among faces and sources, where they are other than before; says
    /// whether they were.
    pub fn record(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        sums: &wgpu::Buffer,
        changed: bool,
    ) -> (&wgpu::Buffer, bool) {
        let changed = self.lights.record(device, encoder, sums, changed);
        (&self.lights.lights, changed)
    }
}

/// Faces and sources as lights.
struct SourceLights {
    layout: wgpu::BindGroupLayout,
    give: wgpu::ComputePipeline,
    faces: usize,
    /// Head, then what each source takes from each face.
    rows: Vec<[f32; 4]>,
    uploaded: Vec<[f32; 4]>,
    taken: wgpu::Buffer,
    lights: wgpu::Buffer,
    /// And the sums that it was made for.
    group: Option<(wgpu::Buffer, wgpu::BindGroup)>,
    due: bool,
}

impl SourceLights {
    fn new(device: &wgpu::Device, faces: usize) -> Self {
        let slots = [Slot::Storage, Slot::Storage, Slot::StorageWritten];
        let layout = compute_layout(device, "lights", &slots);
        let module = shaders::one(device, shaders::lighting());
        let rows = vec![[0.0; 4]; 1 + SOURCES * faces];
        let buffer =
            |rows: usize, usage| buffer_of(device, "lights", 16 * rows as u64, U::STORAGE | usage);
        Self {
            give: compute_pipeline(device, &module, &[&layout], "assign"),
            layout,
            taken: buffer(rows.len(), U::COPY_DST),
            lights: buffer(faces + SOURCE_LIGHTS, U::COPY_SRC),
            uploaded: Vec::with_capacity(rows.len()),
            faces,
            rows,
            group: None,
            due: true,
        }
    }

    fn upload(&mut self, queue: &wgpu::Queue, slots: &SourceSlots) {
        self.rows.fill([0.0; 4]);
        let mut head = [self.faces as u32, 0, 0, 0];
        for (s, (in_use, share, taken)) in slots.shown().enumerate() {
            head[1 + s] = in_use as u32;
            for (face, irradiance) in taken.iter().filter(|(f, _)| (*f as usize) < self.faces) {
                let row = &mut self.rows[1 + s * self.faces + *face as usize];
                *row = (*irradiance * share).extend(0.0).to_array();
            }
        }
        self.rows[0] = head.map(f32::from_bits);
        let rows: &[u8] = bytemuck::cast_slice(&self.rows);
        if rows == bytemuck::cast_slice::<_, u8>(&self.uploaded) {
            return;
        }
        queue.write_buffer(&self.taken, 0, rows);
        self.uploaded.clone_from(&self.rows);
        self.due = true;
    }

    fn record(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        sums: &wgpu::Buffer,
        changed: bool,
    ) -> bool {
        if !(std::mem::take(&mut self.due) || changed) {
            return false;
        }
        let known = self.group.take().filter(|(bound, _)| bound == sums);
        let (_, group) = self.group.insert(known.unwrap_or_else(|| {
            let all = [sums, &self.taken, &self.lights].map(wgpu::Buffer::as_entire_binding);
            (sums.clone(), group(device, "lights", &self.layout, &all))
        }));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("lights"),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.give);
        pass.set_bind_group(0, &*group, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        true
    }
}

#[cfg(test)]
mod tests;
