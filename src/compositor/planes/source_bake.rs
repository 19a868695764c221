//! Bakes the images of a compact source over several frames, one step per frame.

use super::source_images::{Images, SourceBaker, SourceOutput};
use super::source_slots::BakeRequest;
use super::source_targets::{KINDS, SOURCE_LIGHTS};

/// The unfinished bake of a source's images.
#[derive(Debug)]
pub(super) struct SourceBake {
    pub request: BakeRequest,
    /// Index of the current direction.
    direction: usize,
    /// Number of planes evaluated for it; `None` before its maps are drawn.
    planes: Option<u32>,
}

impl SourceBake {
    pub const fn new(request: BakeRequest) -> Self {
        Self {
            request,
            direction: 0,
            planes: None,
        }
    }

    /// Does the work of one frame: draws the maps of a direction, or evaluates some planes. Returns
    /// true when the bake is finished.
    pub fn step(&mut self, baker: &SourceBaker, out: &SourceOutput) -> bool {
        let Some(direction) = self.request.directions.get(self.direction).copied() else {
            return true;
        };
        let descriptor = wgpu::CommandEncoderDescriptor {
            label: Some("source images"),
        };
        let mut encoder = baker.gpu.device.create_command_encoder(&descriptor);
        let first = self.planes.unwrap_or(0);
        baker.upload(direction, first);
        self.upload(baker, out, first);
        match self.planes {
            None => {
                self.begin(baker, out, &mut encoder);
                baker.draw_maps(&mut encoder);
                self.planes = Some(0);
            }
            Some(first) => self.evaluate(baker, out, &mut encoder, first),
        }
        baker.gpu.queue.submit([encoder.finish()]);
        let finished = self.direction == self.request.directions.len();
        if finished {
            let light = self.light(out);
            let mean = self.request.mean().extend(0.0).to_array();
            let queue = &baker.gpu.queue;
            queue.write_buffer(&out.faces, 16 * u64::from(light), bytemuck::bytes_of(&mean));
        }
        finished
    }

    /// Discards the old images of the set before the first direction.
    fn begin(&self, baker: &SourceBaker, out: &SourceOutput, encoder: &mut wgpu::CommandEncoder) {
        if self.direction > 0 {
            return;
        }
        encoder.clear_buffer(&baker.sums, 0, None);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&baker.store.reset);
        pass.set_bind_group(0, &out.group, &[]);
        pass.dispatch_workgroups(baker.planes.div_ceil(64), 1, 1);
    }

    fn evaluate(
        &mut self,
        baker: &SourceBaker,
        out: &SourceOutput,
        encoder: &mut wgpu::CommandEncoder,
        first: u32,
    ) {
        let count = baker.planes_per_frame.min(baker.planes - first);
        let passes = &baker.passes;
        passes.record(encoder, &baker.group, false, baker.side, count);
        let last_direction = self.direction + 1 == self.request.directions.len();
        let last_plane = first + count == baker.planes;
        if last_direction {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_bind_group(0, &out.group, &[]);
            pass.set_pipeline(&baker.store.store);
            pass.dispatch_workgroups((baker.side * baker.side / 4).div_ceil(64), count, 1);
            if last_plane {
                pass.set_pipeline(&baker.store.number);
                pass.dispatch_workgroups(baker.planes.div_ceil(64), 1, 1);
            }
        }
        self.planes = Some(first + count);
        if last_plane {
            self.direction += 1;
            self.planes = None;
        }
    }

    /// Index of the light to which the images belong.
    const fn light(&self, out: &SourceOutput) -> u32 {
        out.dome_lights + 2 * self.request.slot as u32 + self.request.set as u32
    }

    fn upload(&self, baker: &SourceBaker, out: &SourceOutput, first: u32) {
        let light = self.light(out);
        let image = out.first_image + (light - out.dome_lights) * KINDS * baker.planes;
        let lights = out.dome_lights + SOURCE_LIGHTS as u32;
        let uniform = Images {
            planes: [first, baker.planes, baker.real, lights],
            source: [light, image, out.across, 0],
        };
        let queue = &baker.gpu.queue;
        queue.write_buffer(&baker.images, 0, bytemuck::bytes_of(&uniform));
    }
}
