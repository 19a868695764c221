//! What lamps add to real surfaces by the paper's response (DiVerdi and Höllerer 2004,
//! section 4.2), for comparison with the intrinsic estimate, which is a part of the shadow
//! buffer.

use super::super::bindings::{DepthTest, PipelineSpec, Slot, VERTEX_LAYOUT, group, layout, view};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::cleared;

/// The pass.
pub struct LampResponsePass {
    pipeline: wgpu::RenderPipeline,
    picture_layout: wgpu::BindGroupLayout,
}

impl LampResponsePass {
    pub fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        let module = shaders::module(device, "lamp_response", variant);
        let slots = [Slot::Unfilterable, Slot::Uniform];
        let picture_layout = layout(device, "lamp response picture", &slots);
        let pipeline = PipelineSpec {
            label: "lamp_response",
            module: &module,
            groups: &[frame, &picture_layout, &scene.parts],
            vertex: "phantom_vertex",
            buffers: &[VERTEX_LAYOUT],
            fragment: Some("answer"),
            targets: &[format::LIGHT],
            colours: wgpu::ColorWrites::ALL,
            // Triangles of `phantom_geometry`, drawn again: only what is seen is worked out.
            depth: Some(DepthTest::without_writing(wgpu::CompareFunction::Equal)),
            cull: Some(wgpu::Face::Back),
            samples: 1,
        }
        .build(device);
        Self {
            pipeline,
            picture_layout,
        }
    }

    /// Binds the camera's own picture, whatever exposure it is shown in.
    pub fn bind(&self, device: &wgpu::Device, targets: &Targets) -> wgpu::BindGroup {
        let bound = [
            view(&targets.camera.view),
            targets.codes.as_entire_binding(),
        ];
        group(
            device,
            "lamp response picture",
            &self.picture_layout,
            &bound,
        )
    }

    /// `groups`: the frame, the picture.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        groups: [&wgpu::BindGroup; 2],
        scene: &SceneBuffers,
        targets: &Targets,
    ) {
        let depth = wgpu::RenderPassDepthStencilAttachment {
            view: &targets.phantom_depth.view,
            depth_ops: None,
            stencil_ops: None,
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("lamp_response"),
            color_attachments: &[cleared(&targets.response.view)],
            depth_stencil_attachment: Some(depth),
            timestamp_writes: timer.span("lamp_response", true, true),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, groups[0], &[]);
        pass.set_bind_group(1, groups[1], &[]);
        pass.set_bind_group(2, &scene.phantom_uniforms, &[]);
        for (part, instance) in scene.phantom_parts.iter().zip(0..) {
            let level = part.details.level();
            pass.set_vertex_buffer(0, part.vertices.slice(..));
            pass.set_index_buffer(level.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..level.count, 0, instance..instance + 1);
        }
    }
}
