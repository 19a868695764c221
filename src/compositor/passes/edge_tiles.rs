//! Finds the tiles in which edges of the real scene matter.

use super::super::bindings::{CachedGroup, PipelineSpec, Slot, view};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, bind_all, cleared};
use super::super::shaders::{self, Variant};
use super::super::textures::{FrameTexture, format};
use super::shadow_buffer::{ShadowPictures, Surfaces};

/// The pass.
pub struct EdgeTilesPass {
    pipeline: wgpu::RenderPipeline,
    inputs: CachedGroup,
}

impl EdgeTilesPass {
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let slots = [Slot::Unfilterable, Slot::Integer, Slot::Integer];
        let inputs = CachedGroup::from_slots(device, "edge tiles", &slots);
        let pipeline = PipelineSpec {
            label: "edge_tiles",
            shader: &shaders::shader("edge_tiles", variant),
            groups: &[frame, &inputs.layout],
            vertex: "cover",
            buffers: &[],
            fragment: Some("find_edges"),
            targets: &[format::COVERED],
            colours: wgpu::ColorWrites::ALL,
            depth: None,
            cull: None,
            samples: 1,
        }
        .build(device);
        Self { pipeline, inputs }
    }

    /// Writes 1 for each half of a tile in which an edge may matter, and 0 for the others, into
    /// `output`.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        surfaces: Surfaces<'_>,
        shadows: &ShadowPictures,
        output: &'a FrameTexture,
    ) -> &'a FrameTexture {
        let resources = [
            view(&shadows.phantom_shadow.view),
            view(&surfaces.tiles.phantom.lights.view),
            view(&surfaces.covered_tiles.view),
        ];
        let groups = [frame, self.inputs.get(r.device, &resources)];
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("edge tiles"),
            color_attachments: &[cleared(&output.view)],
            timestamp_writes: r.timer.span("edge_tiles", true, true),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        bind_all(&mut pass, &groups);
        pass.draw(0..3, 0..1);
        output
    }
}
