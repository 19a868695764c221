//! Draws the surface properties of the virtual objects where no phantom hides them.

use super::super::bindings::{
    CACHED_VERTEX_LAYOUT, DepthTest, POSITION_LAYOUT, PipelineSpec, VERTEX_LAYOUT,
};
use super::super::compiled::{Device, Shader};
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
    /// Clears what may be covered; `None` where the targets are cleared as a whole.
    clear: Option<wgpu::RenderPipeline>,
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
    pub fn new(device: &Device, size: (u32, u32), samples: u32, cached: bool) -> Self {
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
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        let shader = shaders::shader("virtual_geometry", variant);
        let [first, second] = format::VIRTUAL;
        let targets = [first, second, format::PLACE];
        let build = |cull, [vertex, fragment]: [&str; 2]| {
            PipelineSpec {
                label: "virtual_geometry",
                shader: &shader,
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
        // Software drivers clear every sample of a target in memory, which takes longer than to
        // draw over the part that may be covered; on a GPU to clear costs nothing.
        let clear = variant
            .cached
            .then(|| clear(device, &shader, frame, variant.samples));
        let occluder = PipelineSpec {
            label: "occluder",
            shader: &shader,
            groups: &[frame],
            vertex: "occluder_vertex",
            buffers: &[POSITION_LAYOUT],
            fragment: clear.is_some().then_some("nothing"),
            targets: &targets[..usize::from(clear.is_some())],
            colours: wgpu::ColorWrites::empty(),
            depth: Some(DepthTest::NEAREST),
            cull: Some(wgpu::Face::Back),
            samples: variant.samples,
        }
        .build(device);
        Self {
            surfaces,
            occluder,
            clear,
        }
    }

    /// Draws phantoms (depth alone), virtual parts and area lamps into `output`; nothing virtual is
    /// outside the rectangle `covered` (x, y, width, height, pixels), and nothing was drawn before
    /// outside `to_clear`.
    pub fn record<'a>(
        &self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        [to_clear, covered]: [[u32; 4]; 2],
        output: &'a VirtualPictures,
    ) -> &'a VirtualPictures {
        self.record_occluders(r, frame, scene, [to_clear, covered], output);
        let [first, second] = output.surface.each_ref();
        // The first target alone marks surfaces: the others need not be cleared.
        let targets = [
            if self.clear.is_some() {
                colour(&first.view, wgpu::LoadOp::Load)
            } else {
                cleared(&first.view)
            },
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
        [to_clear, [x, y, width, height]]: [[u32; 4]; 2],
        output: &VirtualPictures,
    ) {
        let (shape, depths) = (&output.surface[0].view, &output.depth.view);
        let shape = [colour(shape, wgpu::LoadOp::Load)];
        let (targets, depths): (&[_], _) = if self.clear.is_some() {
            (&shape, depth(depths, wgpu::LoadOp::Load))
        } else {
            (&[], cleared_depth(depths, 0.0))
        };
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("occluder"),
            color_attachments: targets,
            depth_stencil_attachment: depths,
            timestamp_writes: r.timer.span("virtual_geometry", true, false),
            ..Default::default()
        });
        pass.set_bind_group(0, frame, &[]);
        if let Some(pipeline) = &self.clear {
            let [x, y, width, height] = to_clear;
            pass.set_scissor_rect(x, y, width, height);
            pass.set_pipeline(pipeline);
            pass.draw(0..3, 0..1);
        }
        let Some(mesh) = &scene.occluders else { return };
        pass.set_scissor_rect(x, y, width, height);
        pass.set_pipeline(&self.occluder);
        pass.set_vertex_buffer(0, mesh.vertices.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.count, 0, 0..1);
    }
}

/// Compiles the pipeline that draws over what is there: no surface, as far away as can be.
fn clear(
    device: &Device,
    shader: &Shader,
    frame: &wgpu::BindGroupLayout,
    samples: u32,
) -> wgpu::RenderPipeline {
    PipelineSpec {
        label: "clear",
        shader,
        groups: &[frame],
        vertex: "cover",
        buffers: &[],
        fragment: Some("nothing"),
        targets: &format::VIRTUAL[..1],
        colours: wgpu::ColorWrites::ALL,
        depth: Some(DepthTest::writing(wgpu::CompareFunction::Always)),
        cull: None,
        samples,
    }
    .build(device)
}
