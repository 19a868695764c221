//! The luminance parameters S_i of a geodesic dome's faces, summed from the environment's
//! pixels (Kakuta et al. 2007, section 3.1).
//!
//! A software driver runs the shader on the processor that has the pixels in its caches
//! already, and loads every number by itself: 11 ms for 786,000 pixels on two cores, against
//! 1.3 to 2.5 ms for the CPU twin on one. There the twin does it.

use crate::bindings::{Slot, compute_layout, compute_pipeline, group};
use crate::gpu::Gpu;
use crate::shaders::{Variant, module};
use crate::timing::Timer;
use glam::Vec3;
use penumbra_lighting::geodesic::{FaceLight, Membership, sum_faces_into};
use std::mem::size_of;
use std::sync::Arc;
use wgpu::BufferUsages as Usage;

/// Pixels that one workgroup adds up: 64 for each of its invocations.
const CHUNK: u32 = 4096;

/// The light cannot be summed on this device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LuminanceError {
    /// A buffer would be larger than the device can bind.
    #[error(
        "the environment's picture gives the lights of the shadowing planes {pixels} pixels, {bytes} \
         bytes, but the graphics device reads {most} bytes at most; record smaller environment \
         pictures, or choose another device with --adapter"
    )]
    TooManyPixels {
        /// Pixels and texels of the upper hemisphere.
        pixels: usize,
        /// What their radiance takes.
        bytes: u64,
        /// Greatest storage buffer.
        most: u64,
    },
}

/// Adds up each face's light. One for as long as the device lasts.
pub struct LuminancePass {
    /// None where the processor does it.
    shaders: Option<Shaders>,
    /// In the order of their bindings.
    buffers: [wgpu::Buffer; 7],
    bound: Option<wgpu::BindGroup>,
    /// What the tables hold. Held, so that no other can come to lie at its place.
    membership: Option<Arc<Membership>>,
    generation: Option<u64>,
    tables: Tables,
    /// Something is there that was not summed, or not told.
    due: bool,
    /// Memory of the processor's sums, as they are and as the device reads them.
    sums: Vec<Vec3>,
    rows: Vec<[f32; 4]>,
}

struct Shaders {
    layout: wgpu::BindGroupLayout,
    sum_chunk: wgpu::ComputePipeline,
    sum_face: wgpu::ComputePipeline,
}

impl Shaders {
    fn new(device: &wgpu::Device) -> Self {
        let (read, write) = (Slot::Storage, Slot::StorageWritten);
        let slots = [read, read, read, read, read, write, write];
        let layout = compute_layout(device, "luminance", &slots);
        let module = module(device, "luminance", Variant::PLAIN);
        let pipeline = |entry| compute_pipeline(device, &module, &[&layout], entry);
        Self {
            sum_chunk: pipeline("sum_chunk"),
            sum_face: pipeline("sum_face"),
            layout,
        }
    }
}

/// Chunks of faces, and faces as ranges of chunks.
#[derive(Default)]
struct Tables {
    chunks: Vec<[u32; 2]>,
    faces: Vec<[u32; 2]>,
}

impl Tables {
    fn fill(&mut self, membership: &Membership) {
        self.chunks.clear();
        self.faces.clear();
        for range in membership.begins.windows(2) {
            let first = self.chunks.len() as u32;
            let starts = (range[0]..range[1]).step_by(CHUNK as usize);
            self.chunks
                .extend(starts.map(|at| [at, CHUNK.min(range[1] - at)]));
            self.faces.push([first, self.chunks.len() as u32 - first]);
        }
    }
}

/// Which buffer is which.
const CHUNKS: usize = 0;
const FACES: usize = 1;
const PIXELS: usize = 2;
const WEIGHTS: usize = 3;
const RADIANCE: usize = 4;
const PARTIAL: usize = 5;
const SUMS: usize = 6;

impl LuminancePass {
    /// The quicker way for an adapter.
    #[must_use]
    pub fn for_adapter(gpu: &Gpu) -> Self {
        if gpu.software {
            Self::with(&gpu.device, None)
        } else {
            Self::new(&gpu.device)
        }
    }

    /// Sums on the device, whatever it is. Compiles the shaders; buffers are made when there
    /// is light.
    #[must_use]
    pub fn new(device: &wgpu::Device) -> Self {
        Self::with(device, Some(Shaders::new(device)))
    }

    fn with(device: &wgpu::Device, shaders: Option<Shaders>) -> Self {
        Self {
            shaders,
            buffers: std::array::from_fn(|at| buffer(device, at, 16)),
            bound: None,
            membership: None,
            generation: None,
            tables: Tables::default(),
            due: false,
            sums: Vec::new(),
            rows: Vec::new(),
        }
    }

    /// Takes over what changed: the table when it is another one, radiance when `generation`
    /// is (that of the [`penumbra_lighting::Lighting`] it belongs to).
    ///
    /// # Errors
    /// More pixels than the device can bind; what was there before stays.
    pub fn upload(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        light: &FaceLight,
        generation: u64,
    ) -> Result<(), LuminanceError> {
        let on_device = self.shaders.is_some();
        if on_device {
            check(&device.limits(), light)?;
        }
        let same = |held: &Arc<Membership>| Arc::ptr_eq(held, &light.membership);
        let known = self.membership.as_ref().is_some_and(same);
        if known && self.generation == Some(generation) {
            return Ok(());
        }
        if !known {
            self.tables.fill(&light.membership);
            self.membership = Some(light.membership.clone());
        }
        if on_device && !known {
            self.upload_table(device, queue, &light.membership);
        }
        if on_device {
            let radiance: &[u8] = bytemuck::cast_slice(light.radiance.as_slice());
            self.write(device, queue, RADIANCE, radiance);
        } else {
            self.sum_here(device, queue, light);
        }
        self.generation = Some(generation);
        self.due = true;
        Ok(())
    }

    /// Lets the processor sum.
    fn sum_here(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, light: &FaceLight) {
        sum_faces_into(light, &mut self.sums);
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        rows.extend(self.sums.iter().map(|s| s.extend(0.0).to_array()));
        self.write(device, queue, SUMS, bytemuck::cast_slice(&rows));
        self.rows = rows;
    }

    fn upload_table(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, table: &Membership) {
        let tables = std::mem::take(&mut self.tables);
        let row = size_of::<[f32; 4]>();
        self.write(device, queue, CHUNKS, bytemuck::cast_slice(&tables.chunks));
        self.write(device, queue, FACES, bytemuck::cast_slice(&tables.faces));
        self.write(device, queue, PIXELS, bytemuck::cast_slice(&table.pixels));
        self.write(device, queue, WEIGHTS, bytemuck::cast_slice(&table.weights));
        self.reserve(device, PARTIAL, (tables.chunks.len() * row) as u64);
        self.reserve(device, SUMS, (tables.faces.len() * row) as u64);
        self.tables = tables;
    }

    fn write(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, at: usize, bytes: &[u8]) {
        self.reserve(device, at, bytes.len() as u64);
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffers[at], 0, bytes);
        }
    }

    /// Makes a buffer larger where it must be.
    fn reserve(&mut self, device: &wgpu::Device, at: usize, bytes: u64) {
        if self.buffers[at].size() < bytes {
            self.buffers[at] = buffer(device, at, bytes);
            self.bound = None;
        }
    }

    /// Records the sums, if anything changed since the last call; true if so. `timer` calls it
    /// "luminance".
    pub fn record(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
    ) -> bool {
        if !std::mem::take(&mut self.due) {
            return false;
        }
        let Some(shaders) = &self.shaders else {
            return true;
        };
        let bound = self.bound.get_or_insert_with(|| {
            let all: Vec<_> = self
                .buffers
                .iter()
                .map(wgpu::Buffer::as_entire_binding)
                .collect();
            group(device, "luminance", &shaders.layout, &all)
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("luminance"),
            timestamp_writes: timer.compute_span("luminance", true, true),
        });
        pass.set_bind_group(0, &*bound, &[]);
        pass.set_pipeline(&shaders.sum_chunk);
        pass.dispatch_workgroups(self.tables.chunks.len() as u32, 1, 1);
        pass.set_pipeline(&shaders.sum_face);
        pass.dispatch_workgroups(self.tables.faces.len() as u32, 1, 1);
        true
    }

    /// Irradiance S_i on a surface that faces the light, RGB in the scene camera's units, one
    /// `vec4f` a face; at least [`Self::faces`] of them. Another buffer after an upload of a
    /// dome with more faces: see [`Self::faces`].
    #[must_use]
    pub const fn buffer(&self) -> &wgpu::Buffer {
        &self.buffers[SUMS]
    }

    /// Faces of the dome; 0 before the first light.
    #[must_use]
    pub const fn faces(&self) -> u32 {
        self.tables.faces.len() as u32
    }
}

fn buffer(device: &wgpu::Device, at: usize, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("luminance"),
        size,
        usage: match at {
            SUMS => Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST,
            PARTIAL => Usage::STORAGE,
            _ => Usage::STORAGE | Usage::COPY_DST,
        },
        mapped_at_creation: false,
    })
}

/// Whether the device can bind it all.
fn check(limits: &wgpu::Limits, light: &FaceLight) -> Result<(), LuminanceError> {
    let most = limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size);
    let bytes = (light.radiance.len() * size_of::<[f32; 3]>()) as u64;
    let table = (light.membership.pixels.len() * size_of::<u32>()) as u64;
    if bytes.max(table) <= most {
        return Ok(());
    }
    Err(LuminanceError::TooManyPixels {
        pixels: light.radiance.len(),
        bytes: bytes.max(table),
        most,
    })
}

#[cfg(test)]
mod tests;
