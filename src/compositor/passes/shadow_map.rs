//! Draws casters into the shadow maps of the dome lights chosen for this frame.

use super::super::bindings::{DepthTest, POSITION_LAYOUT, PipelineSpec};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, cleared_depth};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts, draw_casters};
use super::super::shaders;
use super::super::textures::format;

/// Depth maps of all lights for one set of casters.
pub struct ShadowMaps {
    pub array: wgpu::TextureView,
    layers: Vec<wgpu::TextureView>,
}

impl ShadowMaps {
    /// An array of `lights` square maps of `size` texels a side.
    fn new(device: &Device, label: &str, size: u32, lights: u32) -> Self {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width: size,
                height: size,
                depth_or_array_layers: lights.max(1),
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: format::DEPTH,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let array = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::D2Array),
            ..Default::default()
        });
        let layers = (0..lights.max(1))
            .map(|layer| {
                texture.create_view(&wgpu::TextureViewDescriptor {
                    dimension: Some(wgpu::TextureViewDimension::D2),
                    base_array_layer: layer,
                    array_layer_count: Some(1),
                    ..Default::default()
                })
            })
            .collect();
        Self { array, layers }
    }
}

/// The depth maps of all dome lights, one array for each set of casters.
pub struct DomeShadowMaps {
    pub virtual_casters: ShadowMaps,
    pub phantom_casters: ShadowMaps,
}

impl DomeShadowMaps {
    /// Two arrays of `lights` square maps of `size` texels a side.
    pub fn new(device: &Device, size: u32, lights: u32) -> Self {
        let maps = |label| ShadowMaps::new(device, label, size, lights);
        Self {
            virtual_casters: maps("virtual shadow maps"),
            phantom_casters: maps("phantom shadow maps"),
        }
    }
}

/// The pass.
pub struct ShadowMapPass {
    virtual_pipeline: wgpu::RenderPipeline,
    phantom_pipeline: wgpu::RenderPipeline,
}

impl ShadowMapPass {
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, scene: &SceneLayouts) -> Self {
        let shader = shaders::shader("shadow_map", shaders::Variant::PLAIN);
        let build = |vertex: &str| {
            PipelineSpec {
                label: "shadow_map",
                shader: &shader,
                groups: &[frame, &scene.part],
                vertex,
                buffers: &[POSITION_LAYOUT],
                fragment: None,
                targets: &[],
                colours: wgpu::ColorWrites::ALL,
                depth: Some(DepthTest::writing(wgpu::CompareFunction::LessEqual)),
                // Open meshes (a leaf, a cloth) cast with both sides.
                cull: None,
                samples: 1,
            }
            .build(device)
        };
        Self {
            virtual_pipeline: build("virtual_caster"),
            phantom_pipeline: build("phantom_caster"),
        }
    }

    /// Draws the maps of `lights` again, both sets of casters.
    pub fn record(
        &self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        lights: &[usize],
        output: &DomeShadowMaps,
    ) {
        let casts = [
            scene.virtual_caster_meshes().next().is_some(),
            scene.phantom_caster_meshes().next().is_some(),
        ];
        // A map without casters is never read.
        let total = lights.len() * casts.iter().filter(|c| **c).count();
        let places = &scene.caster_places;
        let mut done = 0;
        for light in lights {
            if casts[0] {
                done += 1;
                let span = (done == 1, done == total);
                let mut pass = begin(r, span, &output.virtual_casters, *light);
                pass.set_pipeline(&self.virtual_pipeline);
                pass.set_bind_group(0, frame, &[]);
                let meshes = scene.virtual_caster_meshes();
                draw_casters(&mut pass, places, meshes, *light as u32);
            }
            if casts[1] {
                done += 1;
                let span = (done == 1, done == total);
                let mut pass = begin(r, span, &output.phantom_casters, *light);
                pass.set_pipeline(&self.phantom_pipeline);
                pass.set_bind_group(0, frame, &[]);
                let meshes = scene.phantom_caster_meshes();
                draw_casters(&mut pass, places, meshes, *light as u32);
            }
        }
    }
}

fn begin<'r>(
    r: &'r mut Recorder<'_>,
    (first, last): (bool, bool),
    maps: &ShadowMaps,
    light: usize,
) -> wgpu::RenderPass<'r> {
    r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("shadow_map"),
        depth_stencil_attachment: cleared_depth(&maps.layers[light], 1.0),
        timestamp_writes: r.timer.span("shadow_map", first, last),
        ..Default::default()
    })
}
