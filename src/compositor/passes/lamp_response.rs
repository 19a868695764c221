//! The light that virtual lights add to real surfaces by the response of DiVerdi and Höllerer
//! 2004, section 4.2, for comparison with the intrinsic estimate, which is a part of the shadow
//! buffer.

use super::super::bindings::{CachedGroup, DepthTest, PipelineSpec, Slot, VERTEX_LAYOUT, view};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, cleared};
use super::super::response_table::RealPicture;
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::shaders::{self, Variant};
use super::super::textures::{FrameTexture, format};
use super::phantom_geometry::PhantomPictures;

/// The pass.
pub struct LampResponsePass {
    pipeline: wgpu::RenderPipeline,
    picture: CachedGroup,
}

impl LampResponsePass {
    pub fn new(
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        let shader = shaders::shader("lamp_response", variant);
        let slots = [Slot::Unfilterable, Slot::Uniform];
        let picture = CachedGroup::from_slots(device, "lamp response picture", &slots);
        let pipeline = PipelineSpec {
            label: "lamp_response",
            shader: &shader,
            groups: &[frame, &picture.layout, &scene.parts],
            vertex: "phantom_vertex",
            buffers: &[VERTEX_LAYOUT],
            fragment: Some("respond"),
            targets: &[format::LIGHT],
            colours: wgpu::ColorWrites::ALL,
            // The triangles of `phantom_geometry` again: only visible surfaces are shaded.
            depth: Some(DepthTest::without_writing(wgpu::CompareFunction::Equal)),
            cull: Some(wgpu::Face::Back),
            samples: 1,
        }
        .build(device);
        Self { pipeline, picture }
    }

    /// Draws the light that is added to the phantoms. The camera picture in its own exposure is
    /// read, whatever the exposure of the frame.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        real: RealPicture<'_>,
        phantoms: &PhantomPictures,
        output: &'a FrameTexture,
    ) -> &'a FrameTexture {
        let resources = [view(&real.camera.view), real.codes.binding()];
        let picture = self.picture.get(r.device, &resources);
        let depth = wgpu::RenderPassDepthStencilAttachment {
            view: &phantoms.depth.view,
            depth_ops: None,
            stencil_ops: None,
        };
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("lamp_response"),
            color_attachments: &[cleared(&output.view)],
            depth_stencil_attachment: Some(depth),
            timestamp_writes: r.timer.span("lamp_response", true, true),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, picture, &[]);
        pass.set_bind_group(2, &scene.phantom_uniforms, &[]);
        scene.draw_phantoms(&mut pass);
        output
    }
}
