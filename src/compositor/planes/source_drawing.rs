//! Images of a compact source in the making: one step with each picture.

use super::source_images::{Images, SourceBaker, SourceOutput};
use super::source_slots::Wanted;
use super::source_targets::{KINDS, SOURCE_LIGHTS};

/// Images in the making.
#[derive(Debug)]
pub(super) struct Drawing {
    pub wanted: Wanted,
    /// The direction at work.
    at: usize,
    /// Planes that are done with it; `None` before its maps are drawn.
    planes: Option<u32>,
}

impl Drawing {
    pub const fn new(wanted: Wanted) -> Self {
        Self {
            wanted,
            at: 0,
            planes: None,
        }
    }

    /// One picture's share of the work: the maps of a direction, or some planes. True when
    /// all is done.
    pub fn step(&mut self, baker: &SourceBaker, out: &SourceOutput) -> bool {
        let Some(direction) = self.wanted.directions.get(self.at).copied() else {
            return true;
        };
        let descriptor = wgpu::CommandEncoderDescriptor {
            label: Some("source images"),
        };
        let mut encoder = baker.gpu.device.create_command_encoder(&descriptor);
        let first = self.planes.unwrap_or(0);
        baker.tell(direction, first);
        self.tell(baker, out, first);
        match self.planes {
            None => {
                self.begin(baker, out, &mut encoder);
                baker.draw_maps(&mut encoder);
                self.planes = Some(0);
            }
            Some(first) => self.evaluate(baker, out, &mut encoder, first),
        }
        baker.gpu.queue.submit([encoder.finish()]);
        let done = self.at == self.wanted.directions.len();
        if done {
            let light = self.light(out);
            let mean = self.wanted.mean().extend(0.0).to_array();
            let queue = &baker.gpu.queue;
            queue.write_buffer(&out.faces, 16 * u64::from(light), bytemuck::bytes_of(&mean));
        }
        done
    }

    /// Before the first direction: what is there of the set is thrown away.
    fn begin(&self, baker: &SourceBaker, out: &SourceOutput, encoder: &mut wgpu::CommandEncoder) {
        if self.at > 0 {
            return;
        }
        encoder.clear_buffer(&baker.sums, 0, None);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&baker.store.forget);
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
        let count = baker.pace.min(baker.planes - first);
        let passes = &baker.passes;
        passes.record(encoder, &baker.group, false, baker.side, count);
        let last_direction = self.at + 1 == self.wanted.directions.len();
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
            self.at += 1;
            self.planes = None;
        }
    }

    /// The light that the images belong to.
    const fn light(&self, out: &SourceOutput) -> u32 {
        out.dome_lights + 2 * self.wanted.slot as u32 + self.wanted.set as u32
    }

    fn tell(&self, baker: &SourceBaker, out: &SourceOutput, first: u32) {
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
