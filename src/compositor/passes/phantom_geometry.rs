//! Draws the depth and the normals of the phantoms (proxies of the real scene), or at once the change
//! of the picture on them.

use super::super::bindings::{CACHED_VERTEX_LAYOUT, DepthTest, PipelineSpec, VERTEX_LAYOUT};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, cleared, cleared_depth, colour};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::super::shaders;
use super::super::textures::{DRAWN, FrameTexture, format};

/// The pass.
pub struct PhantomGeometryPass {
    pipeline: wgpu::RenderPipeline,
    /// Whether the change of the picture is drawn.
    is_shadowed: bool,
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
    pub fn new(device: &Device, size: (u32, u32), cached: bool) -> Self {
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
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: shaders::Variant,
    ) -> Self {
        let shader = shaders::shader("phantom_geometry", variant);
        let is_shadowed = variant.shadows_phantoms();
        let pipeline = PipelineSpec {
            label: "phantom_geometry",
            shader: &shader,
            groups: &[frame, &scene.parts],
            vertex: "phantom_vertex",
            buffers: if variant.cached {
                &CACHED_VERTEX_LAYOUT
            } else {
                &[VERTEX_LAYOUT]
            },
            fragment: Some(if is_shadowed {
                "shadowed_fragment"
            } else {
                "phantom_fragment"
            }),
            targets: match (is_shadowed, variant.cached) {
                (true, _) => &[format::LIGHT],
                (false, true) => &[format::PHANTOM_NORMAL, format::PLACE],
                (false, false) => &[format::PHANTOM_NORMAL],
            },
            colours: wgpu::ColorWrites::ALL,
            depth: Some(DepthTest::NEAREST),
            cull: Some(wgpu::Face::Back),
            samples: 1,
        }
        .build(device);
        Self {
            pipeline,
            is_shadowed,
        }
    }

    /// Draws all phantoms into `output`, or the change of the picture on them into `shadow`, which
    /// gets `unshadowed` elsewhere.
    pub fn record<'a>(
        &self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        (shadow, unshadowed): (&FrameTexture, f64),
        output: &'a PhantomPictures,
    ) -> &'a PhantomPictures {
        // Places are read where there is a surface only.
        let place = output.place.as_ref();
        let unshadowed = wgpu::LoadOp::Clear(unshadowed_texel(unshadowed));
        let surfaces = [
            cleared(&output.normal.view),
            place.and_then(|place| colour(&place.view, wgpu::LoadOp::Load)),
        ];
        let shadow = [colour(&shadow.view, unshadowed)];
        let targets = if self.is_shadowed {
            &shadow[..]
        } else {
            &surfaces[..1 + usize::from(place.is_some())]
        };
        let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("phantom_geometry"),
            color_attachments: targets,
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

/// The texel of the shadow buffer where the picture is multiplied by `change`, or less `change`.
pub const fn unshadowed_texel(change: f64) -> wgpu::Color {
    wgpu::Color {
        r: change,
        g: change,
        b: change,
        a: 0.0,
    }
}
