//! The camera picture in another exposure.

use super::super::bindings::{
    CachedGroup, PipelineSpec, Slot, compute_layout, compute_pipeline, layout, sampler, view,
};
use super::super::compiled::Device;
use super::super::exposure::region::{BLOCK, Region, constants, trust};
use super::super::recorder::{Recorder, cleared};
use super::super::response_table::{ENCODING, ResponseTable};
use super::super::shaders;
use super::super::textures::{DRAWN, FrameTexture, coarse_size, format, tile_grid};
use half::f16;
use penumbra_camera::Response;
use penumbra_scene::Highlights;
use std::ops::Range;
use wgpu::BufferUsages as Usage;
use wgpu::TextureUsages as U;

/// Blocks that one workgroup sums, per axis.
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
    /// Sums of blocks, running sums along rows and along columns, means of regions.
    table: [wgpu::ComputePipeline; 4],
    /// For tiles without clipped pixels, tiles with some, the entire picture.
    scaled_tiles: wgpu::RenderPipeline,
    highlights: wgpu::RenderPipeline,
    scaled: wgpu::RenderPipeline,
    /// For the entire picture, by the rule of DiVerdi and Höllerer 2004.
    scaled_by_region: wgpu::RenderPipeline,
    /// The table and the picture, for summing and for drawing.
    summing: [CachedGroup; 2],
    drawing: [CachedGroup; 2],
    smooth: wgpu::Sampler,
    uniform: wgpu::Buffer,
}

/// The pictures and sums that the passes make for pictures of one size.
pub struct ExposedPictures {
    /// Linear light in the exposure; may be above 1.
    pub linear: FrameTexture,
    /// Means of the region around each block.
    around: FrameTexture,
    /// `around` as an array of one layer.
    around_layers: wgpu::TextureView,
    /// Blocks across and down.
    blocks: (u32, u32),
    /// Running sums of colours and of brightness.
    sums: (wgpu::Buffer, wgpu::Buffer),
}

impl ExposedPictures {
    /// For pictures of `size` pixels.
    pub fn new(device: &Device, size: (u32, u32)) -> Self {
        let blocks = coarse_size(size, BLOCK);
        let storage = |label, bytes: u64| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes * u64::from(blocks.0) * u64::from(blocks.1),
                usage: Usage::STORAGE | Usage::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let usage = U::STORAGE_BINDING | U::TEXTURE_BINDING;
        let around = FrameTexture::new(device, "around", blocks, format::LIGHT, usage);
        Self {
            linear: FrameTexture::new(device, "exposed", size, format::LIGHT, DRAWN),
            around_layers: around.texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2Array),
                ..Default::default()
            }),
            around,
            blocks,
            sums: (
                storage("sums of colours", 16),
                storage("sums of brightness", 8),
            ),
        }
    }
}

impl ExposurePass {
    pub fn new(device: &Device) -> Self {
        let [table, picture, _] = shaders::exposing(&constants());
        let shader = shaders::one(table);
        let (u, w) = (Slot::Uniform, Slot::StorageWritten);
        let picture_slots = [Slot::Unfilterable, u];
        let around_slots = [u, Slot::Storage, Slot::Texture, Slot::Sampler];
        let summing = [
            compute_layout(device, "exposure table", &[u, w, w, Slot::WrittenLayers]),
            compute_layout(device, "exposure picture", &picture_slots),
        ]
        .map(|layout| CachedGroup::new("exposure", layout));
        let drawing = [
            layout(device, "exposure around", &around_slots),
            layout(device, "exposure picture", &picture_slots),
        ]
        .map(|layout| CachedGroup::new("exposure", layout));
        let groups = [&summing[0].layout, &summing[1].layout];
        let table = ["sum_blocks", "scan_rows", "scan_columns", "region_means"]
            .map(|entry| compute_pipeline(device, &shader, &groups, entry));
        let shader = shaders::one(picture);
        let build = |vertex, fragment| {
            PipelineSpec {
                label: "exposure",
                shader: &shader,
                groups: &[&drawing[0].layout, &drawing[1].layout],
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
            scaled_by_region: build("cover", "scaled_by_region"),
            summing,
            drawing,
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

    /// Uploads the exposure of the next frame: its factor on linear light, and the treatment of
    /// clipped areas.
    pub fn upload(
        &self,
        queue: &wgpu::Queue,
        (factor, highlights): (f32, Highlights),
        region: Region,
        response: &Response,
    ) {
        let linear = response.linear_from_code();
        // Rounded to half floats, from which the shaders read it before they encode it.
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

    /// Draws the exposed picture into `exposed.linear` and, as codes, into `output`. `highlights`
    /// selects the treatment of clipped areas in a shorter exposure; `None` for a longer one.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        camera: (&FrameTexture, &ResponseTable),
        highlights: Option<Highlights>,
        exposed: &'a ExposedPictures,
        output: &FrameTexture,
    ) -> &'a FrameTexture {
        if highlights.is_some() {
            self.record_table(r, camera, exposed, 0..self.table.len());
        }
        let drawing = [
            self.uniform.as_entire_binding(),
            exposed.sums.0.as_entire_binding(),
            view(&exposed.around.view),
            sampler(&self.smooth),
        ];
        let [around, picture] = &mut self.drawing;
        let around = around.get(r.device, &drawing);
        let picture = picture.get(r.device, &[view(&camera.0.view), camera.1.binding()]);
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("exposure"),
            color_attachments: &[cleared(&exposed.linear.view), cleared(&output.view)],
            timestamp_writes: r.timer.span("exposure", true, true),
            ..Default::default()
        });
        pass.set_bind_group(0, around, &[]);
        pass.set_bind_group(1, picture, &[]);
        let all = match highlights {
            None => Some(&self.scaled),
            Some(Highlights::Paper) => Some(&self.scaled_by_region),
            Some(Highlights::Estimated) => None,
        };
        if let Some(all) = all {
            pass.set_pipeline(all);
            pass.draw(0..3, 0..1);
        } else {
            let (across, down) = tile_grid(output.size());
            for pipeline in [&self.scaled_tiles, &self.highlights] {
                pass.set_pipeline(pipeline);
                pass.draw(0..6 * across * down, 0..1);
            }
        }
        &exposed.linear
    }

    /// Records the `steps` of the summed-area table.
    fn record_table(
        &mut self,
        r: &mut Recorder<'_>,
        (camera, codes): (&FrameTexture, &ResponseTable),
        exposed: &ExposedPictures,
        steps: Range<usize>,
    ) {
        let (colours, brightness) = &exposed.sums;
        let table = [
            self.uniform.as_entire_binding(),
            colours.as_entire_binding(),
            brightness.as_entire_binding(),
            view(&exposed.around_layers),
        ];
        let [sums, picture] = &mut self.summing;
        let sums = sums.get(r.device, &table);
        let picture = picture.get(r.device, &[view(&camera.view), codes.binding()]);
        let mut pass = r.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("exposure_table"),
            timestamp_writes: r.timer.compute_span("exposure_table", true, true),
        });
        pass.set_bind_group(0, sums, &[]);
        pass.set_bind_group(1, picture, &[]);
        let (across, down) = exposed.blocks;
        let squares = (across.div_ceil(GROUP), down.div_ceil(GROUP));
        let groups = [squares, (down, 1), (across, 1), squares];
        let jobs = self.table.iter().zip(groups);
        for (pipeline, (x, y)) in jobs.take(steps.end).skip(steps.start) {
            pass.set_pipeline(pipeline);
            pass.dispatch_workgroups(x, y, 1);
        }
    }
}

/// The linear value of the entry of the inverse response that the shaders read for `linear`.
fn tabled(linear: f32) -> f32 {
    let last = (ENCODING - 1) as f32;
    let root = (linear.clamp(0.0, 1.0).sqrt() * last + 0.5).floor() / last;
    root * root
}

#[cfg(test)]
mod tests;
