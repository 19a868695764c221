//! Sorts the picture into tiles by the dome lights that could be blocked there, and by the lamps
//! that shine there.

use super::super::bindings::{PipelineSpec, Slot, group, layout, view};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::cleared;

/// The pass.
pub struct TilesPass {
    real: wgpu::RenderPipeline,
    virtual_surfaces: wgpu::RenderPipeline,
    surfaces_layout: wgpu::BindGroupLayout,
}

impl TilesPass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let module = shaders::module(device, "tiles", variant);
        let (packed, depth) = Slot::sampled(variant.samples);
        let surfaces_layout = layout(
            device,
            "tile surfaces",
            &[Slot::Unfilterable, Slot::Depth, packed, depth],
        );
        let build = |fragment: &str| {
            PipelineSpec {
                label: "tiles",
                module: &module,
                groups: &[frame, &surfaces_layout],
                vertex: "cover",
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::TILES, format::LAMP_TILES],
                colours: wgpu::ColorWrites::ALL,
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let (real, virtual_surfaces) = (build("classify_real"), build("classify_virtual"));
        Self {
            real,
            virtual_surfaces,
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
                view(&targets.virtual_depth.view),
            ],
        )
    }

    /// `covered` is the rectangle of tiles (x, y, width, height) that virtual surfaces lie
    /// in.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        groups: [&wgpu::BindGroup; 2],
        targets: &Targets,
        covered: [u32; 4],
    ) {
        let whole = [
            0,
            0,
            targets.tiles[0].texture.width(),
            targets.tiles[0].texture.height(),
        ];
        let jobs = [(&self.real, whole), (&self.virtual_surfaces, covered)];
        for (k, (pipeline, [x, y, width, height])) in jobs.into_iter().enumerate() {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("tiles"),
                color_attachments: &[
                    cleared(&targets.tiles[k].view),
                    cleared(&targets.lamp_tiles[k].view),
                ],
                timestamp_writes: timer.span("tiles", k == 0, k == 1),
                ..Default::default()
            });
            pass.set_pipeline(pipeline);
            for (group, index) in groups.iter().zip(0..) {
                pass.set_bind_group(index, *group, &[]);
            }
            if width > 0 {
                pass.set_scissor_rect(x, y, width, height);
                pass.draw(0..3, 0..1);
            }
        }
    }
}
