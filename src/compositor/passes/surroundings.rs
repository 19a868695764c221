//! The shadowed real picture, linear and ever coarser, for virtual objects to reflect.

use super::super::bindings::{PipelineSpec, Slot, group, layout, view};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::cover;

/// The pass.
pub struct SurroundingsPass {
    gather: wgpu::RenderPipeline,
    halve: wgpu::RenderPipeline,
    picture_layout: wgpu::BindGroupLayout,
    finer_layout: wgpu::BindGroupLayout,
}

/// What it binds of the targets.
pub struct SurroundingsInputs {
    picture: wgpu::BindGroup,
    finer: Vec<wgpu::BindGroup>,
}

impl SurroundingsPass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let module = shaders::module(device, "surroundings", variant);
        let u = Slot::Unfilterable;
        let picture_layout = layout(device, "surroundings picture", &[u, Slot::Uniform, u, u]);
        let finer_layout = layout(device, "surroundings level", &[u]);
        let build = |fragment: &str| {
            PipelineSpec {
                label: "surroundings",
                module: &module,
                groups: &[frame, &picture_layout, &finer_layout],
                vertex: "cover",
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::LIGHT],
                colours: wgpu::ColorWrites::ALL,
                depth: None,
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let (gather, halve) = (build("gather"), build("halve"));
        Self {
            gather,
            halve,
            picture_layout,
            finer_layout,
        }
    }

    /// Binds the targets and the real picture, the camera's or the exposed one.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        targets: &Targets,
        real: &wgpu::TextureView,
    ) -> SurroundingsInputs {
        let picture = group(
            device,
            "surroundings picture",
            &self.picture_layout,
            &[
                view(real),
                targets.codes.as_entire_binding(),
                view(&targets.shadow.view),
                view(&targets.response.view),
            ],
        );
        // The first level reads the picture, but the layout wants a finer one: any will do
        // that is not being drawn.
        let finer = std::iter::once(&targets.shadow.view)
            .chain(&targets.surroundings_levels)
            .map(|v| group(device, "surroundings level", &self.finer_layout, &[view(v)]))
            .collect();
        SurroundingsInputs { picture, finer }
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        inputs: &SurroundingsInputs,
        targets: &Targets,
    ) {
        let last = targets.surroundings_levels.len() - 1;
        for (level, target) in targets.surroundings_levels.iter().enumerate() {
            let pipeline = if level == 0 {
                &self.gather
            } else {
                &self.halve
            };
            let writes = timer.span("surroundings", level == 0, level == last);
            let groups = [frame, &inputs.picture, &inputs.finer[level]];
            cover(encoder, "surroundings", target, writes, pipeline, &groups);
        }
    }
}
