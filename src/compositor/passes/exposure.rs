//! The camera's picture in another exposure.

use super::super::bindings::{
    PipelineSpec, Slot, compute_layout, compute_pipeline, group, layout, sampler, view,
};
use super::super::exposure::{BLOCK, Region, constants, trust};
use super::super::shaders;
use super::super::targets::{ENCODING, Target, Targets, format};
use super::super::timing::Timer;
use super::cleared;
use half::f16;
use penumbra_camera::Response;
use penumbra_scene::Highlights;
use std::ops::Range;
use wgpu::BufferUsages as Usage;
use wgpu::TextureUsages as U;

/// Blocks that one workgroup sums, each way.
const GROUP: u32 = 8;

/// Twin of WGSL `Exposure`.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct ExposureUniform {
    change: [f32; 4],
    near: [f32; 4],
    linear: [f32; 256],
    codes: [f32; 256],
}

/// The passes.
pub struct ExposurePass {
    /// Sums of blocks, running sums along rows, along columns, means of regions.
    table: [wgpu::ComputePipeline; 4],
    /// Tiles without clipped pixels, tiles with some, everything.
    scaled_tiles: wgpu::RenderPipeline,
    highlights: wgpu::RenderPipeline,
    scaled: wgpu::RenderPipeline,
    /// Everything, by the paper's rule.
    raised: wgpu::RenderPipeline,
    /// Of the table and of the picture, each for summing and for drawing.
    table_layouts: [wgpu::BindGroupLayout; 2],
    picture_layouts: [wgpu::BindGroupLayout; 2],
    smooth: wgpu::Sampler,
    uniform: wgpu::Buffer,
}

/// What it makes and binds for pictures of one size.
pub struct ExposureInputs {
    /// Linear light in the exposure; may be above 1.
    pub linear: Target,
    blocks: (u32, u32),
    /// Running sums of colours and of brightness.
    #[cfg(test)]
    sums: (wgpu::Buffer, wgpu::Buffer),
    summing: [wgpu::BindGroup; 2],
    drawing: [wgpu::BindGroup; 2],
}

impl ExposurePass {
    pub fn new(device: &wgpu::Device) -> Self {
        let [table, picture, _] = shaders::exposing(&constants());
        let module = shaders::one(device, table);
        let (u, w) = (Slot::Uniform, Slot::StorageWritten);
        let picture_slots = [Slot::Unfilterable, u];
        let table_layouts = [
            compute_layout(device, "exposure table", &[u, w, w, Slot::WrittenLayers]),
            layout(
                device,
                "exposure around",
                &[u, Slot::Storage, Slot::Texture, Slot::Sampler],
            ),
        ];
        let picture_layouts = [
            compute_layout(device, "exposure picture", &picture_slots),
            layout(device, "exposure picture", &picture_slots),
        ];
        let groups = [&table_layouts[0], &picture_layouts[0]];
        let table = ["sum_blocks", "scan_rows", "scan_columns", "look_around"]
            .map(|entry| compute_pipeline(device, &module, &groups, entry));
        let module = shaders::one(device, picture);
        let build = |vertex, fragment| {
            PipelineSpec {
                label: "exposure",
                module: &module,
                groups: &[&table_layouts[1], &picture_layouts[1]],
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::LIGHT, format::OUTPUT],
                colours: wgpu::ColorWrites::ALL,
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        Self {
            table,
            scaled_tiles: build("plain_tile", "scaled"),
            highlights: build("clipped_tile", "highlights"),
            scaled: build("cover", "scaled"),
            raised: build("cover", "raised"),
            table_layouts,
            picture_layouts,
            smooth: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("around"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            uniform: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("exposure"),
                size: size_of::<ExposureUniform>() as u64,
                usage: Usage::UNIFORM | Usage::COPY_DST,
                mapped_at_creation: false,
            }),
        }
    }

    /// Makes what depends on the picture's size.
    pub fn bind(&self, device: &wgpu::Device, targets: &Targets) -> ExposureInputs {
        let blocks = (
            targets.width.div_ceil(BLOCK),
            targets.height.div_ceil(BLOCK),
        );
        let storage = |label, bytes: u64| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes * u64::from(blocks.0) * u64::from(blocks.1),
                usage: Usage::STORAGE | Usage::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let colours = storage("sums of colours", 16);
        let brightness = storage("sums of brightness", 8);
        let size = (targets.width, targets.height);
        let linear = U::RENDER_ATTACHMENT | U::TEXTURE_BINDING;
        let linear = Target::new(device, "exposed", size, format::LIGHT, linear);
        let around = U::STORAGE_BINDING | U::TEXTURE_BINDING;
        let around = Target::new(device, "around", blocks, format::LIGHT, around);
        let layers = around.texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let uniform = self.uniform.as_entire_binding();
        let (sums, squares) = (colours.as_entire_binding(), brightness.as_entire_binding());
        let summing = [uniform.clone(), sums.clone(), squares, view(&layers)];
        let drawing = [uniform, sums, view(&around.view), sampler(&self.smooth)];
        let picture = [
            view(&targets.camera.view),
            targets.codes.as_entire_binding(),
        ];
        let bound = |at: usize, of: &[wgpu::BindingResource<'_>]| {
            let label = "exposure";
            [
                group(device, label, &self.table_layouts[at], of),
                group(device, label, &self.picture_layouts[at], &picture),
            ]
        };
        ExposureInputs {
            summing: bound(0, &summing),
            drawing: bound(1, &drawing),
            linear,
            blocks,
            #[cfg(test)]
            sums: (colours, brightness),
        }
    }

    /// Which exposure comes next.
    pub fn upload(
        &self,
        queue: &wgpu::Queue,
        (factor, highlights): (f32, Highlights),
        region: Region,
        response: &Response,
    ) {
        let linear = response.linear_from_code();
        // As the shaders read it again from half floats, and encode it.
        let linear = linear.map(|v| f16::from_f32(v * factor).to_f32());
        let uniform = ExposureUniform {
            change: [factor, region.reach as f32, region.share, trust(factor)],
            near: [
                region.near as f32,
                f32::from(u8::from(highlights == Highlights::Paper)),
                0.0,
                0.0,
            ],
            codes: linear.map(|v| response.encoded_from_linear(tabled(v))),
            linear,
        };
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// The exposed picture into `inputs.linear` and, as codes, into the output. What is clipped
    /// matters only where it is darker: `highlights` says what becomes of it.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        inputs: &ExposureInputs,
        targets: &Targets,
        highlights: Option<Highlights>,
    ) {
        if highlights.is_some() {
            self.record_table(encoder, timer, inputs, 0..self.table.len());
        }
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("exposure"),
            color_attachments: &[cleared(&inputs.linear.view), cleared(&targets.output.view)],
            timestamp_writes: timer.span("exposure", true, true),
            ..Default::default()
        });
        for (index, group) in (0..).zip(&inputs.drawing) {
            pass.set_bind_group(index, group, &[]);
        }
        let all = match highlights {
            None => Some(&self.scaled),
            Some(Highlights::Paper) => Some(&self.raised),
            Some(Highlights::Estimated) => None,
        };
        if let Some(all) = all {
            pass.set_pipeline(all);
            pass.draw(0..3, 0..1);
            return;
        }
        for pipeline in [&self.scaled_tiles, &self.highlights] {
            pass.set_pipeline(pipeline);
            pass.draw(0..6 * targets.tile_count(), 0..1);
        }
    }

    fn record_table(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        inputs: &ExposureInputs,
        steps: Range<usize>,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("exposure_table"),
            timestamp_writes: timer.compute_span("exposure_table", true, true),
        });
        for (index, group) in (0..).zip(&inputs.summing) {
            pass.set_bind_group(index, group, &[]);
        }
        let (across, down) = inputs.blocks;
        let squares = (across.div_ceil(GROUP), down.div_ceil(GROUP));
        let groups = [squares, (down, 1), (across, 1), squares];
        for (pipeline, (x, y)) in self
            .table
            .iter()
            .zip(groups)
            .take(steps.end)
            .skip(steps.start)
        {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups(x, y, 1);
        }
    }
}

/// The entry of the shaders' table of codes that stands for a linear value.
fn tabled(linear: f32) -> f32 {
    let last = (ENCODING - 1) as f32;
    let root = (linear.clamp(0.0, 1.0).sqrt() * last + 0.5).floor() / last;
    root * root
}

#[cfg(test)]
mod tests;
