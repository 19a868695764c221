//! Measures on the device what virtual lights add to the real scene, and brings it back two
//! pictures later, so that nobody waits; always two, so that a replay is always the same.

use super::super::bindings::{CachedGroup, Slot, compute_layout, compute_pipeline, group, view};
use super::super::gpu::Gpu;
use super::super::passes::shadow_buffer::SurfaceLight;
use super::super::recorder::Recorder;
use super::super::response_table::RealPicture;
use super::super::shaders::{self, one};
use super::control::Brightness;
use super::region::{METER_GROUPS, constants};
use wgpu::BufferUsages as Usage;

/// Pictures between a measurement and its use.
const LATENCY: usize = 2;

const BYTES: u64 = METER_GROUPS as u64 * 16;

/// Twin of WGSL `Meter`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct MeterUniform {
    how: [u32; 4],
}

/// See the module.
pub struct Meter {
    pipeline: wgpu::ComputePipeline,
    picture: CachedGroup,
    own: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// Measurements on their way, by the picture's number.
    slots: [Sent; LATENCY],
    number: usize,
}

/// One measurement on its way.
struct Sent {
    buffer: wgpu::Buffer,
    /// It was recorded; once submitted, with what.
    submitted: Option<Option<wgpu::SubmissionIndex>>,
}

impl Meter {
    pub fn new(device: &wgpu::Device) -> Self {
        let [_, _, text] = shaders::exposing(&constants());
        let module = one(device, text);
        let own_layout = compute_layout(
            device,
            "exposure meter",
            &[Slot::Uniform, Slot::StorageWritten],
        );
        let u = Slot::Unfilterable;
        let picture = compute_layout(device, "metered picture", &[u, Slot::Uniform, u, u]);
        let picture = CachedGroup::new("metered picture", picture);
        let layouts = [&own_layout, &picture.layout];
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let uniform = buffer("exposure meter", 16, Usage::UNIFORM | Usage::COPY_DST);
        let sums = buffer("metered", BYTES, Usage::STORAGE | Usage::COPY_SRC);
        let bound = [uniform.as_entire_binding(), sums.as_entire_binding()];
        Self {
            pipeline: compute_pipeline(device, &module, &layouts, "measure"),
            own: group(device, "exposure meter", &own_layout, &bound),
            slots: std::array::from_fn(|_| Sent {
                buffer: buffer("metered", BYTES, Usage::COPY_DST | Usage::MAP_READ),
                submitted: None,
            }),
            number: 0,
            picture,
            uniform,
            sums,
        }
    }

    /// Begins a picture: what was measured [`LATENCY`] pictures before, if anything was.
    pub fn begin(&mut self, gpu: &Gpu) -> Option<Brightness> {
        self.number = (self.number + 1) % LATENCY;
        let slot = &mut self.slots[self.number];
        let submission_index = slot.submitted.take()??;
        let done = wgpu::PollType::Wait {
            submission_index: Some(submission_index),
            timeout: None,
        };
        // A lost device is told of when its picture is read.
        let polled = gpu.device.poll(done);
        let sums = match (polled, slot.buffer.get_mapped_range(..)) {
            (Ok(_), Ok(bytes)) => Some(add_up(bytemuck::cast_slice(&bytes))),
            _ => None,
        };
        slot.buffer.unmap();
        sums.flatten()
    }

    /// Records a measurement of the picture begun last.
    pub fn record(&mut self, r: &mut Recorder<'_>, real: RealPicture<'_>, light: SurfaceLight<'_>) {
        let resources = [
            view(&real.camera.view),
            real.codes.binding(),
            view(&light.shadows.phantom_shadow.view),
            view(&light.lamp_light.view),
        ];
        let picture = self.picture.get(r.device, &resources);
        let mut pass = r.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("exposure_meter"),
            timestamp_writes: r.timer.compute_span("exposure_meter", true, true),
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.own, &[]);
        pass.set_bind_group(1, picture, &[]);
        pass.dispatch_workgroups(METER_GROUPS, 1, 1);
        drop(pass);
        let slot = &mut self.slots[self.number];
        r.encoder
            .copy_buffer_to_buffer(&self.sums, 0, &slot.buffer, 0, BYTES);
        slot.submitted = Some(None);
    }

    /// How shadows and lamps are put into the picture that is measured next.
    pub fn upload(&self, queue: &wgpu::Queue, subtract: bool, shadow_step: u32, apart: bool) {
        let uniform = MeterUniform {
            how: [
                u32::from(subtract),
                shadow_step.ilog2(),
                u32::from(apart),
                0,
            ],
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// The picture begun last was submitted.
    pub fn submitted(&mut self, index: &wgpu::SubmissionIndex) {
        let slot = &mut self.slots[self.number];
        if let Some(waiting @ None) = &mut slot.submitted {
            *waiting = Some(index.clone());
            slot.buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        }
    }
}

/// Means from sums of luminance, of what is added, of what is taken, and of points.
fn add_up(sums: &[[f32; 4]]) -> Option<Brightness> {
    let all = sums.iter().fold([0.0_f64; 4], |mut all, group| {
        all.iter_mut()
            .zip(group)
            .for_each(|(a, v)| *a += f64::from(*v));
        all
    });
    let mean = |k: usize| (all[k] / all[3]) as f32;
    let brightness = Brightness {
        camera: mean(0),
        added: mean(1),
        taken: mean(2),
    };
    let known = all[3] > 0.0 && all.iter().all(|v| v.is_finite());
    known.then_some(brightness)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_over_all_points_and_nonsense_is_nothing() {
        let sums = [[1.0, 0.5, 0.25, 4.0], [3.0, 0.0, 0.0, 4.0]];
        let means = Brightness {
            camera: 0.5,
            added: 0.0625,
            taken: 0.03125,
        };
        assert_eq!(add_up(&sums), Some(means));
        assert_eq!(add_up(&[[0.0; 4]]), None);
        assert_eq!(add_up(&[[f32::NAN, 0.0, 0.0, 4.0]]), None);
    }
}
