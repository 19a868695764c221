//! Draws the surface properties of the virtual objects where no phantom hides them.

use super::super::bindings::{
    CACHED_VERTEX_LAYOUT, DepthTest, POSITION_LAYOUT, PipelineSpec, VERTEX_LAYOUT,
};
use super::super::gpu_data::VirtualPartUniform;
use super::super::recorder::{Recorder, cleared, cleared_depth, colour, depth};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::shaders::{self, Variant};
use super::super::textures::{FrameTexture, format};

/// The pass.
pub struct VirtualGeometryPass {
    /// One-sided and two-sided surfaces, each without and with textures.
    surfaces: [[wgpu::RenderPipeline; 2]; 2],
    occluder: wgpu::RenderPipeline,
}

/// The virtual objects as the camera sees them, with several samples a pixel.
pub struct VirtualPictures {
    /// Shape and material, packed.
    pub surface: [FrameTexture; 2],
    /// Reversed depth, that of the phantoms included.
    pub depth: FrameTexture,
    /// Places in the surface cache, if there is one.
    pub place: Option<FrameTexture>,
}

impl VirtualPictures {
    /// `cached`: with places in the surface cache.
    pub fn new(device: &wgpu::Device, size: (u32, u32), samples: u32, cached: bool) -> Self {
        let picture =
            |label, format| FrameTexture::multisampled(device, label, size, format, samples);
        Self {
            surface: format::VIRTUAL.map(|format| picture("virtual surface", format)),
            depth: picture("virtual depth", format::DEPTH),
            place: cached.then(|| picture("virtual place", format::PLACE)),
        }
    }
}

impl VirtualGeometryPass {
    pub fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        let module = shaders::module(device, "virtual_geometry", variant);
        let [first, second] = format::VIRTUAL;
        let targets = [first, second, format::PLACE];
        let build = |cull, [vertex, fragment]: [&str; 2]| {
            PipelineSpec {
                label: "virtual_geometry",
                module: &module,
                groups: &[frame, &scene.part, &scene.material],
                vertex,
                buffers: if variant.cached {
                    &CACHED_VERTEX_LAYOUT
                } else {
                    &[VERTEX_LAYOUT]
                },
                fragment: Some(fragment),
                targets: &targets[..if variant.cached { 3 } else { 2 }],
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

    /// Compiles the pipeline of phantoms, which writes depth alone.
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

    /// Draws phantoms (depth alone), virtual parts and area lamps into `output`; nothing virtual is
    /// outside the rectangle `covered` (x, y, width, height, pixels).
    pub fn record<'a>(
        &self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        covered: [u32; 4],
        output: &'a VirtualPictures,
    ) -> &'a VirtualPictures {
        self.record_occluders(r, frame, scene, covered, output);
        let [first, second] = output.surface.each_ref();
        // The first target alone marks surfaces: the others need not be cleared.
        let targets = [
            cleared(&first.view),
            colour(&second.view, wgpu::LoadOp::Load),
            output
                .place
                .as_ref()
                .and_then(|place| colour(&place.view, wgpu::LoadOp::Load)),
        ];
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("virtual_geometry"),
            color_attachments: &targets[..if output.place.is_some() { 3 } else { 2 }],
            depth_stencil_attachment: depth(&output.depth.view, wgpu::LoadOp::Load),
            timestamp_writes: r.timer.span("virtual_geometry", false, true),
            ..Default::default()
        });
        let [x, y, width, height] = covered;
        pass.set_scissor_rect(x, y, width, height);
        pass.set_bind_group(0, frame, &[]);
        for (part, number) in scene.virtual_parts.iter().zip(0..) {
            pass.set_bind_group(
                1,
                &scene.virtual_uniforms,
                &[VirtualPartUniform::offset(number)],
            );
            let sides = usize::from(part.double_sided);
            pass.set_pipeline(&self.surfaces[sides][usize::from(part.textured)]);
            pass.set_bind_group(2, part.material.as_ref(), &[]);
            part.draw(&mut pass, 0);
        }
        // Area lamps are one-sided rectangles with or without a picture.
        pass.set_pipeline(&self.surfaces[0][1]);
        pass.set_index_buffer(scene.emitters.indices.slice(..), wgpu::IndexFormat::Uint32);
        for ((vertices, material), number) in scene.emitters.draws().zip(0..) {
            pass.set_bind_group(
                1,
                &scene.emitters.uniforms,
                &[VirtualPartUniform::offset(number)],
            );
            pass.set_bind_group(2, material, &[]);
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.set_vertex_buffer(1, scene.uncached.slice(..));
            pass.draw_indexed(0..6, 0, 0..1);
        }
        output
    }

    fn record_occluders(
        &self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        [x, y, width, height]: [u32; 4],
        output: &VirtualPictures,
    ) {
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("occluder"),
            depth_stencil_attachment: cleared_depth(&output.depth.view, 0.0),
            timestamp_writes: r.timer.span("virtual_geometry", true, false),
            ..Default::default()
        });
        let Some(mesh) = &scene.occluders else { return };
        pass.set_scissor_rect(x, y, width, height);
        pass.set_pipeline(&self.occluder);
        pass.set_bind_group(0, frame, &[]);
        pass.set_vertex_buffer(0, mesh.vertices.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.count, 0, 0..1);
    }
}
