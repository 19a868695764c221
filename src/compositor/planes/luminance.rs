//! The luminance parameters S_i of a geodesic dome's faces, summed from the environment's
//! pixels (Kakuta et al. 2007, section 3.1).
//!
//! A software driver runs the shader on the processor, where it is several times slower than the
//! CPU implementation, which has the pixels in its caches. There the CPU implementation is used.

use super::super::compiled::Device;
use crate::bindings::{Slot, compute_layout, compute_pipeline, group};
use crate::gpu::Gpu;
use crate::shaders::{self, Variant};
use crate::timing::Timer;
use glam::Vec3;
use penumbra_lighting::geodesic::{FaceLight, Membership, sum_faces_into};
use std::mem::size_of;
use std::sync::Arc;
use wgpu::BufferUsages as Usage;

/// Pixels that one workgroup sums: 64 in each of its invocations.
const CHUNK: u32 = 4096;

/// The light cannot be summed on this device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LuminanceError {
    /// A buffer would be larger than the device can bind.
    #[error(
        "the light of the shadowing planes has {pixels} pixels, {bytes} bytes, but the graphics \
         device can read {max_bytes} bytes at most; record smaller environment pictures, or choose \
         another device with --adapter"
    )]
    TooManyPixels {
        /// Pixels and texels of the upper hemisphere.
        pixels: usize,
        /// Size of their radiance, bytes.
        bytes: u64,
        /// Maximum size of a storage buffer, bytes.
        max_bytes: u64,
    },
}

/// Sums the light of each face.
pub struct LuminancePass {
    /// `None` where the sums are computed on the CPU.
    shaders: Option<Shaders>,
    /// In the order of their bindings.
    buffers: [wgpu::Buffer; 7],
    bound: Option<wgpu::BindGroup>,
    /// The source of the tables. Owned, so that no other one can have its address, by which it is
    /// recognised.
    membership: Option<Arc<Membership>>,
    generation: Option<u64>,
    tables: Tables,
    /// Whether an upload is pending that [`Self::record`] has not yet processed or reported.
    due: bool,
    /// Buffers of the sums on the CPU: as computed, and in the layout of the device.
    sums: Vec<Vec3>,
    rows: Vec<[f32; 4]>,
}

struct Shaders {
    layout: wgpu::BindGroupLayout,
    sum_chunk: wgpu::ComputePipeline,
    sum_face: wgpu::ComputePipeline,
}

impl Shaders {
    fn new(device: &Device) -> Self {
        let (read, write) = (Slot::Storage, Slot::StorageWritten);
        let slots = [read, read, read, read, read, write, write];
        let layout = compute_layout(device, "luminance", &slots);
        let shader = shaders::shader("luminance", Variant::PLAIN);
        let pipeline = |entry| compute_pipeline(device, &shader, &[&layout], entry);
        Self {
            sum_chunk: pipeline("sum_chunk"),
            sum_face: pipeline("sum_face"),
            layout,
        }
    }
}

/// The chunks of the faces (first pixel, number of pixels), and each face as a range of chunks.
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

// Indices of the buffers.
const CHUNKS: usize = 0;
const FACES: usize = 1;
const PIXELS: usize = 2;
const WEIGHTS: usize = 3;
const RADIANCE: usize = 4;
const PARTIAL: usize = 5;
const SUMS: usize = 6;

impl LuminancePass {
    /// Creates the pass with the faster implementation for the adapter.
    #[must_use]
    pub fn for_adapter(gpu: &Gpu) -> Self {
        if gpu.software {
            Self::with(&gpu.device, None)
        } else {
            Self::new(&gpu.device)
        }
    }

    /// Creates the pass with the implementation on the device. Compiles the shaders; buffers are
    /// allocated at the first upload.
    #[must_use]
    pub fn new(device: &Device) -> Self {
        Self::with(device, Some(Shaders::new(device)))
    }

    fn with(device: &Device, shaders: Option<Shaders>) -> Self {
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

    /// Uploads the table and the radiance of `light`, each if it has changed. `generation` is that of
    /// the [`penumbra_lighting::Lighting`] to which the radiance belongs.
    ///
    /// # Errors
    /// There are more pixels than the device can bind; the previous light is kept.
    pub fn upload(
        &mut self,
        device: &Device,
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
            self.sum_on_cpu(device, queue, light);
        }
        self.generation = Some(generation);
        self.due = true;
        Ok(())
    }

    /// Computes the sums on the CPU and uploads them.
    fn sum_on_cpu(&mut self, device: &Device, queue: &wgpu::Queue, light: &FaceLight) {
        sum_faces_into(light, &mut self.sums);
        let mut rows = std::mem::take(&mut self.rows);
        rows.clear();
        rows.extend(self.sums.iter().map(|s| s.extend(0.0).to_array()));
        self.write(device, queue, SUMS, bytemuck::cast_slice(&rows));
        self.rows = rows;
    }

    fn upload_table(&mut self, device: &Device, queue: &wgpu::Queue, table: &Membership) {
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

    fn write(&mut self, device: &Device, queue: &wgpu::Queue, at: usize, bytes: &[u8]) {
        self.reserve(device, at, bytes.len() as u64);
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffers[at], 0, bytes);
        }
    }

    /// Replaces a buffer that is too small.
    fn reserve(&mut self, device: &Device, at: usize, bytes: u64) {
        if self.buffers[at].size() < bytes {
            self.buffers[at] = buffer(device, at, bytes);
            self.bound = None;
        }
    }

    /// Records the sums if there was an upload since the last call, and returns whether there was.
    /// The `timer` lists the pass as "luminance".
    pub fn record(
        &mut self,
        device: &Device,
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
    /// `vec4f` per face; at least [`Self::faces`] of them. The buffer is replaced by an upload of a
    /// dome with more faces.
    #[must_use]
    pub const fn buffer(&self) -> &wgpu::Buffer {
        &self.buffers[SUMS]
    }

    /// Number of faces of the dome; 0 before the first upload.
    #[must_use]
    pub const fn faces(&self) -> u32 {
        self.tables.faces.len() as u32
    }
}

fn buffer(device: &Device, at: usize, size: u64) -> wgpu::Buffer {
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

/// Checks that the device can bind the radiance and the table.
fn check(limits: &wgpu::Limits, light: &FaceLight) -> Result<(), LuminanceError> {
    let max_bytes = limits
        .max_storage_buffer_binding_size
        .min(limits.max_buffer_size);
    let bytes = (light.radiance.len() * size_of::<[f32; 3]>()) as u64;
    let table = (light.membership.pixels.len() * size_of::<u32>()) as u64;
    if bytes.max(table) <= max_bytes {
        return Ok(());
    }
    Err(LuminanceError::TooManyPixels {
        pixels: light.radiance.len(),
        bytes: bytes.max(table),
        max_bytes,
    })
}

#[cfg(test)]
mod tests;
