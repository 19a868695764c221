//! Sorts the picture into tiles by the dome lights that could be blocked there.

use super::super::bindings::{PipelineSpec, Slot, group, layout, view};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::cleared;

/// The pass.
pub struct TilesPass {
    pipeline: wgpu::RenderPipeline,
    surfaces_layout: wgpu::BindGroupLayout,
}

impl TilesPass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let module = shaders::module(device, "tiles", variant);
        let (colour, depth) = Slot::sampled(variant.samples);
        let surfaces_layout = layout(
            device,
            "tile surfaces",
            &[Slot::Unfilterable, Slot::Depth, colour, colour, depth],
        );
        let pipeline = PipelineSpec {
            label: "tiles",
            module: &module,
            groups: &[frame, &surfaces_layout],
            vertex: "cover",
            buffers: &[],
            fragment: Some("classify"),
            targets: &[format::TILES, format::TILES],
            depth: None,
            cull: None,
            samples: 1,
        }
        .build(device);
        Self {
            pipeline,
            surfaces_layout,
        }
    }

    pub fn bind(&self, device: &wgpu::Device, targets: &Targets) -> wgpu::BindGroup {
        group(
            device,
            "tile surfaces",
            &self.surfaces_layout,
            &[
                view(&targets.phantom_normal.view),
                view(&targets.phantom_depth.view),
                view(&targets.virtual_surface[0].view),
                view(&targets.virtual_surface[2].view),
                view(&targets.virtual_depth.view),
            ],
        )
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        surfaces: &wgpu::BindGroup,
        targets: &Targets,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("tiles"),
            color_attachments: &targets.tiles.each_ref().map(|t| cleared(&t.view)),
            timestamp_writes: timer.span("tiles", true, true),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, surfaces, &[]);
        pass.draw(0..3, 0..1);
    }
}
