//! Draws the surface properties of the virtual objects, behind the phantoms' depth.

use super::super::bindings::{DepthTest, POSITION_LAYOUT, PipelineSpec, VERTEX_LAYOUT};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::shaders::{self, Variant};
use super::super::targets::{Targets, format};
use super::super::timing::Timer;
use super::{cleared, cleared_depth};

/// The pass.
pub struct VirtualGeometryPass {
    /// One-sided and two-sided surfaces, each without and with textures.
    surfaces: [[wgpu::RenderPipeline; 2]; 2],
    occluder: wgpu::RenderPipeline,
}

impl VirtualGeometryPass {
    pub fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        let module = shaders::module(device, "virtual_geometry", variant);
        let build = |cull, [vertex, fragment]: [&str; 2]| {
            PipelineSpec {
                label: "virtual_geometry",
                module: &module,
                groups: &[frame, &scene.parts, &scene.material],
                vertex,
                buffers: &[VERTEX_LAYOUT],
                fragment: Some(fragment),
                targets: &format::VIRTUAL,
                colours: wgpu::ColorWrites::ALL,
                depth: Some(DepthTest::NEAREST),
                cull,
                samples: variant.samples,
            }
            .build(device)
        };
        let plain = ["plain_vertex", "plain_fragment"];
        let textured = ["virtual_vertex", "virtual_fragment"];
        let surfaces = [Some(wgpu::Face::Back), None]
            .map(|cull| [plain, textured].map(|entries| build(cull, entries)));
        let occluder = Self::occluder(device, frame, &module, variant.samples);
        Self { surfaces, occluder }
    }

    /// Phantoms write depth and leave the colours empty.
    fn occluder(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        module: &wgpu::ShaderModule,
        samples: u32,
    ) -> wgpu::RenderPipeline {
        PipelineSpec {
            label: "occluder",
            module,
            groups: &[frame],
            vertex: "occluder_vertex",
            buffers: &[POSITION_LAYOUT],
            fragment: None,
            targets: &[],
            colours: wgpu::ColorWrites::ALL,
            depth: Some(DepthTest::NEAREST),
            cull: Some(wgpu::Face::Back),
            samples,
        }
        .build(device)
    }

    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        targets: &Targets,
    ) {
        self.record_occluders(encoder, timer, frame, scene, targets);
        let mut colours = targets.virtual_surface.each_ref().map(|t| cleared(&t.view));
        // Only the first tells where something is.
        for colour in colours[1..].iter_mut().flatten() {
            colour.ops.load = wgpu::LoadOp::Load;
        }
        let mut depth = cleared_depth(&targets.virtual_depth.view, 0.0);
        if let Some(ops) = depth.as_mut().and_then(|d| d.depth_ops.as_mut()) {
            ops.load = wgpu::LoadOp::Load;
        }
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("virtual_geometry"),
            color_attachments: &colours,
            depth_stencil_attachment: depth,
            timestamp_writes: timer.span("virtual_geometry", false, true),
            ..Default::default()
        });
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, &scene.virtual_uniforms, &[]);
        for (part, instance) in scene.virtual_parts.iter().zip(0..) {
            let sides = usize::from(part.double_sided);
            pass.set_pipeline(&self.surfaces[sides][usize::from(part.textured)]);
            pass.set_bind_group(2, part.material.as_ref(), &[]);
            let level = part.details.level();
            pass.set_vertex_buffer(0, part.vertices.slice(..));
            pass.set_index_buffer(level.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..level.count, 0, instance..instance + 1);
        }
        // Area lamps, one-sided rectangles with a picture or without.
        pass.set_bind_group(1, &scene.emitters.uniforms, &[]);
        pass.set_pipeline(&self.surfaces[0][1]);
        pass.set_index_buffer(scene.emitters.indices.slice(..), wgpu::IndexFormat::Uint32);
        for ((vertices, material), instance) in scene.emitters.draws().zip(0..) {
            pass.set_bind_group(2, material, &[]);
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.draw_indexed(0..6, 0, instance..instance + 1);
        }
    }

    fn record_occluders(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        targets: &Targets,
    ) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("occluder"),
            depth_stencil_attachment: cleared_depth(&targets.virtual_depth.view, 0.0),
            timestamp_writes: timer.span("virtual_geometry", true, false),
            ..Default::default()
        });
        let Some(mesh) = &scene.occluders else { return };
        pass.set_pipeline(&self.occluder);
        pass.set_bind_group(0, frame, &[]);
        pass.set_vertex_buffer(0, mesh.vertices.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.count, 0, 0..1);
    }
}
