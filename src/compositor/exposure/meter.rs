//! Measures on the device the light that virtual lights add to the real scene. Each measurement is
//! read two frames later, so that the CPU does not wait; always two, so that replays are
//! reproducible.

use super::super::bindings::{CachedGroup, Slot, compute_layout, compute_pipeline, group, view};
use super::super::compiled::Device;
use super::super::gpu::Gpu;
use super::super::passes::shadow_buffer::SurfaceLight;
use super::super::recorder::Recorder;
use super::super::response_table::RealPicture;
use super::super::shaders::{self, one};
use super::control::Brightness;
use super::region::{METER_GROUPS, constants};
use wgpu::BufferUsages as Usage;

/// Frames between a measurement and its use.
const LATENCY_FRAMES: usize = 2;

const BYTES: u64 = METER_GROUPS as u64 * 16;

/// Twin of WGSL `Meter`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct MeterUniform {
    how: [u32; 4],
}

/// The exposure meter: its pass, and the measurements that are not read yet.
pub struct Meter {
    pipeline: wgpu::ComputePipeline,
    picture: CachedGroup,
    own: wgpu::BindGroup,
    uniform: wgpu::Buffer,
    sums: wgpu::Buffer,
    /// Measurements that are not read yet, by the frame's number.
    slots: [PendingMeasurement; LATENCY_FRAMES],
    /// Number of the current frame, modulo [`LATENCY_FRAMES`].
    number: usize,
}

/// A measurement that is not read yet.
struct PendingMeasurement {
    buffer: wgpu::Buffer,
    /// `None` if nothing was recorded, `Some(None)` until it is submitted, then the submission.
    submitted: Option<Option<wgpu::SubmissionIndex>>,
}

impl Meter {
    pub fn new(device: &Device) -> Self {
        let [_, _, text] = shaders::exposing(&constants());
        let shader = one(text);
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
            pipeline: compute_pipeline(device, &shader, &layouts, "measure"),
            own: group(device, "exposure meter", &own_layout, &bound),
            slots: std::array::from_fn(|_| PendingMeasurement {
                buffer: buffer("metered", BYTES, Usage::COPY_DST | Usage::MAP_READ),
                submitted: None,
            }),
            number: 0,
            picture,
            uniform,
            sums,
        }
    }

    /// Begins a frame; returns the measurement of [`LATENCY_FRAMES`] frames before, if there was
    /// one. Waits for its submission.
    pub fn begin(&mut self, gpu: &Gpu) -> Option<Brightness> {
        self.number = (self.number + 1) % LATENCY_FRAMES;
        let slot = &mut self.slots[self.number];
        let submission_index = slot.submitted.take()??;
        let done = wgpu::PollType::Wait {
            submission_index: Some(submission_index),
            timeout: None,
        };
        // A lost device is reported when the picture is read.
        let polled = gpu.device.poll(done);
        let sums = match (polled, slot.buffer.get_mapped_range(..)) {
            (Ok(_), Ok(bytes)) => Some(means(bytemuck::cast_slice(&bytes))),
            _ => None,
        };
        slot.buffer.unmap();
        sums.flatten()
    }

    /// Records a measurement of the current frame.
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

    /// Uploads how shadows and lamps change the picture of the next measurement.
    pub fn upload(&self, queue: &wgpu::Queue, subtract: bool, lamps_apart: bool) {
        let uniform = MeterUniform {
            how: [u32::from(subtract), 0, u32::from(lamps_apart), 0],
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// Starts reading the measurement of the current frame, which was submitted as `index`.
    pub fn submitted(&mut self, index: &wgpu::SubmissionIndex) {
        let slot = &mut self.slots[self.number];
        if let Some(unsubmitted @ None) = &mut slot.submitted {
            *unsubmitted = Some(index.clone());
            slot.buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        }
    }
}

/// Returns the means from the workgroups' sums: camera luminance, added light, removed light,
/// number of points; `None` without points or with values that are not finite.
fn means(sums: &[[f32; 4]]) -> Option<Brightness> {
    let totals = sums.iter().fold([0.0_f64; 4], |mut totals, group| {
        totals
            .iter_mut()
            .zip(group)
            .for_each(|(a, v)| *a += f64::from(*v));
        totals
    });
    let mean = |k: usize| (totals[k] / totals[3]) as f32;
    let brightness = Brightness {
        camera: mean(0),
        added: mean(1),
        taken: mean(2),
    };
    let is_valid = totals[3] > 0.0 && totals.iter().all(|v| v.is_finite());
    is_valid.then_some(brightness)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_cover_all_points_and_invalid_sums_give_none() {
        let sums = [[1.0, 0.5, 0.25, 4.0], [3.0, 0.0, 0.0, 4.0]];
        let expected = Brightness {
            camera: 0.5,
            added: 0.0625,
            taken: 0.03125,
        };
        assert_eq!(means(&sums), Some(expected));
        assert_eq!(means(&[[0.0; 4]]), None);
        assert_eq!(means(&[[f32::NAN, 0.0, 0.0, 4.0]]), None);
    }
}
