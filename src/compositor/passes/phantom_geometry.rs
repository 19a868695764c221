//! Draws the depth and normals of the real scene's proxies.

use super::super::bindings::{DepthTest, PipelineSpec, VERTEX_LAYOUT};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::targets::{Targets, format};
use super::super::{shaders, timing::Timer};
use super::{cleared, cleared_depth};

/// The pass.
pub struct PhantomGeometryPass {
    pipeline: wgpu::RenderPipeline,
}

impl PhantomGeometryPass {
    pub fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: shaders::Variant,
    ) -> Self {
        let module = shaders::module(device, "phantom_geometry", variant);
        let pipeline = PipelineSpec {
            label: "phantom_geometry",
            module: &module,
            groups: &[frame, &scene.parts],
            vertex: "phantom_vertex",
            buffers: &[VERTEX_LAYOUT],
            fragment: Some("phantom_fragment"),
            targets: &[format::PHANTOM_NORMAL],
            colours: wgpu::ColorWrites::ALL,
            depth: Some(DepthTest::NEAREST),
            cull: Some(wgpu::Face::Back),
            samples: 1,
        }
        .build(device);
        Self { pipeline }
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        targets: &Targets,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("phantom_geometry"),
            color_attachments: &[cleared(&targets.phantom_normal.view)],
            depth_stencil_attachment: cleared_depth(&targets.phantom_depth.view, 0.0),
            timestamp_writes: timer.span("phantom_geometry", true, true),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, &scene.phantom_uniforms, &[]);
        for (part, instance) in scene.phantom_parts.iter().zip(0..) {
            let level = part.details.level();
            pass.set_vertex_buffer(0, part.vertices.slice(..));
            pass.set_index_buffer(level.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..level.count, 0, instance..instance + 1);
        }
    }
}
