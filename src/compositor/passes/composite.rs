//! Puts the picture together.

use super::super::bindings::{DepthTest, PipelineSpec, Slot, group, layout, sampler, view};
use super::super::gloss_maps::GlossMaps;
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::{cleared, cleared_depth};
use wgpu::CompareFunction as Compare;

/// Depth of a pixel that nothing virtual covers; `NOTHING_VIRTUAL` in the shader.
const NOTHING_VIRTUAL: f32 = 0.5;

/// The pass.
pub struct CompositePass {
    /// Tiles without virtual surfaces, then, where there are some: what is behind them,
    /// pixels that show one of them, pixels on outlines.
    pipelines: [wgpu::RenderPipeline; 4],
    picture_layout: wgpu::BindGroupLayout,
    surfaces_layout: wgpu::BindGroupLayout,
    light_layout: wgpu::BindGroupLayout,
    smooth: wgpu::Sampler,
    /// The output holds the real picture already, exposed.
    exposed: bool,
}

/// What it binds.
pub struct CompositeInputs {
    picture: wgpu::BindGroup,
    surfaces: wgpu::BindGroup,
    light: wgpu::BindGroup,
}

impl CompositePass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let module = shaders::module(device, "composite", variant);
        let (u, i) = (Slot::Unfilterable, Slot::Integer);
        let (packed, depth) = Slot::sampled(variant.samples);
        let picture_layout = layout(
            device,
            "composite picture",
            &[u, Slot::Uniform, u, i, u, i, i, i, u],
        );
        let surfaces_layout = layout(device, "composite surfaces", &[packed, packed, depth]);
        let light_layout = layout(
            device,
            "composite light",
            &[
                Slot::Sampler,
                Slot::Cube,
                Slot::Texture,
                Slot::Texture,
                Slot::Cube,
                Slot::Uniform,
            ],
        );
        let build = |vertex: &str, fragment: &str, compare, write| {
            PipelineSpec {
                label: "composite",
                module: &module,
                groups: &[frame, &picture_layout, &surfaces_layout, &light_layout],
                vertex,
                buffers: &[],
                fragment: Some(fragment),
                targets: &[format::OUTPUT],
                colours: wgpu::ColorWrites::ALL,
                depth: Some(DepthTest { compare, write }),
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        let pipelines = [
            build("real_tile", "real", Compare::Always, false),
            build("background_tile", "background", Compare::Always, true),
            build("whole_tile", "whole", Compare::Less, false),
            build("outline_tile", "outline", Compare::Greater, false),
        ];
        let smooth = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("smooth"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self {
            pipelines,
            picture_layout,
            surfaces_layout,
            light_layout,
            smooth,
            exposed: variant.exposed,
        }
    }

    /// Binds the targets, the real picture (the camera's or the exposed one) and what glossy surfaces
    /// mirror.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        targets: &Targets,
        real: &wgpu::TextureView,
        gloss: &GlossMaps,
    ) -> CompositeInputs {
        let t = targets;
        let picture = [
            view(real),
            t.codes.as_entire_binding(),
            view(&t.shadow.view),
            view(&t.light.view),
            view(&t.phantom_normal.view),
            view(&t.tiles[0].view),
            view(&t.covered.view),
            view(&t.lamp_tiles[1].view),
            view(&t.response.view),
        ];
        let s = &t.virtual_surface;
        let surfaces = [&s[0], &s[1], &t.virtual_depth].map(|t| view(&t.view));
        let light = [
            sampler(&self.smooth),
            view(&gloss.ggx.view),
            view(&t.surroundings.view),
            view(&gloss.table),
            view(&gloss.phong.view),
            gloss.glints.as_entire_binding(),
        ];
        CompositeInputs {
            picture: group(device, "composite picture", &self.picture_layout, &picture),
            surfaces: group(
                device,
                "composite surfaces",
                &self.surfaces_layout,
                &surfaces,
            ),
            light: group(device, "composite light", &self.light_layout, &light),
        }
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        inputs: &CompositeInputs,
        targets: &Targets,
    ) {
        let groups = [frame, &inputs.picture, &inputs.surfaces, &inputs.light];
        // Where nothing virtual is, the picture is the camera's, bit for bit.
        if !self.exposed {
            encoder.copy_texture_to_texture(
                targets.camera.texture.as_image_copy(),
                targets.output.texture.as_image_copy(),
                targets.output.texture.size(),
            );
        }
        let mut colour = cleared(&targets.output.view);
        if let Some(colour) = &mut colour {
            colour.ops.load = wgpu::LoadOp::Load;
        }
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("composite"),
            color_attachments: &[colour],
            depth_stencil_attachment: cleared_depth(&targets.kinds.view, NOTHING_VIRTUAL),
            timestamp_writes: timer.span("composite", true, true),
            ..Default::default()
        });
        for (group, index) in groups.iter().zip(0..) {
            pass.set_bind_group(index, *group, &[]);
        }
        for pipeline in &self.pipelines {
            pass.set_pipeline(pipeline);
            pass.draw(0..6 * targets.tile_count(), 0..1);
        }
    }
}
