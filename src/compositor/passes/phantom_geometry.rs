//! Draws the depth and the normals of the phantoms (proxies of the real scene).

use super::super::bindings::{CACHED_VERTEX_LAYOUT, DepthTest, PipelineSpec, VERTEX_LAYOUT};
use super::super::recorder::{Recorder, cleared, cleared_depth};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::shaders;
use super::super::textures::{DRAWN, FrameTexture, format};

/// The pass.
pub struct PhantomGeometryPass {
    pipeline: wgpu::RenderPipeline,
}

/// The phantoms as the camera sees them.
pub struct PhantomPictures {
    /// World normal and kind of surface.
    pub normal: FrameTexture,
    /// Reversed depth.
    pub depth: FrameTexture,
    /// Places in the surface cache, if there is one.
    pub place: Option<FrameTexture>,
}

impl PhantomPictures {
    /// `cached`: with places in the surface cache.
    pub fn new(device: &wgpu::Device, size: (u32, u32), cached: bool) -> Self {
        let normal = format::PHANTOM_NORMAL;
        let place = || FrameTexture::new(device, "phantom place", size, format::PLACE, DRAWN);
        Self {
            normal: FrameTexture::new(device, "phantom normal", size, normal, DRAWN),
            depth: FrameTexture::new(device, "phantom depth", size, format::DEPTH, DRAWN),
            place: cached.then(place),
        }
    }
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
            buffers: if variant.cached {
                &CACHED_VERTEX_LAYOUT
            } else {
                &[VERTEX_LAYOUT]
            },
            fragment: Some("phantom_fragment"),
            targets: if variant.cached {
                &[format::PHANTOM_NORMAL, format::PLACE]
            } else {
                &[format::PHANTOM_NORMAL]
            },
            colours: wgpu::ColorWrites::ALL,
            depth: Some(DepthTest::NEAREST),
            cull: Some(wgpu::Face::Back),
            samples: 1,
        }
        .build(device);
        Self { pipeline }
    }

    /// Draws all phantoms into `output`.
    pub fn record<'a>(
        &self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        output: &'a PhantomPictures,
    ) -> &'a PhantomPictures {
        let targets = [
            cleared(&output.normal.view),
            output.place.as_ref().and_then(|place| cleared(&place.view)),
        ];
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("phantom_geometry"),
            color_attachments: &targets[..1 + usize::from(output.place.is_some())],
            depth_stencil_attachment: cleared_depth(&output.depth.view, 0.0),
            timestamp_writes: r.timer.span("phantom_geometry", true, true),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, &scene.phantom_uniforms, &[]);
        scene.draw_phantoms(&mut pass);
        output
    }
}
