//! Draws casters into the shadow maps of the dome lights chosen for this frame.

use super::super::bindings::{DepthTest, POSITION_LAYOUT, PipelineSpec};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts, draw_casters};
use super::super::targets::format;
use super::super::{shaders, timing::Timer};
use super::cleared_depth;

/// Depth maps of all lights for one set of casters.
pub struct ShadowMaps {
    pub array: wgpu::TextureView,
    layers: Vec<wgpu::TextureView>,
}

impl ShadowMaps {
    /// `lights` square maps of `size` texels a side.
    pub fn new(device: &wgpu::Device, label: &str, size: u32, lights: u32) -> Self {
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

/// The pass.
pub struct ShadowMapPass {
    virtual_pipeline: wgpu::RenderPipeline,
    phantom_pipeline: wgpu::RenderPipeline,
}

impl ShadowMapPass {
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout, scene: &SceneLayouts) -> Self {
        let module = shaders::module(device, "shadow_map", shaders::Variant::PLAIN);
        let build = |vertex: &str| {
            PipelineSpec {
                label: "shadow_map",
                module: &module,
                groups: &[frame, &scene.parts],
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
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        maps: (&ShadowMaps, &ShadowMaps),
        lights: &[usize],
    ) {
        let [virtual_maps, phantom_maps] = [maps.0, maps.1];
        let casts = [
            scene.virtual_caster_meshes().next().is_some(),
            scene.phantom_caster_meshes().next().is_some(),
        ];
        // Where nothing casts, no map is ever read.
        let total = lights.len() * casts.iter().filter(|c| **c).count();
        let groups = [frame, &scene.caster_places.group];
        let mut done = 0;
        for light in lights {
            if casts[0] {
                done += 1;
                let writes = timer.span("shadow_map", done == 1, done == total);
                let mut pass = begin(encoder, writes, virtual_maps, *light);
                bind(&mut pass, &self.virtual_pipeline, groups);
                draw_casters(&mut pass, scene.virtual_caster_meshes(), *light as u32);
            }
            if casts[1] {
                done += 1;
                let writes = timer.span("shadow_map", done == 1, done == total);
                let mut pass = begin(encoder, writes, phantom_maps, *light);
                bind(&mut pass, &self.phantom_pipeline, groups);
                draw_casters(&mut pass, scene.phantom_caster_meshes(), *light as u32);
            }
        }
    }
}

fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    maps: &ShadowMaps,
    light: usize,
) -> wgpu::RenderPass<'e> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("shadow_map"),
        depth_stencil_attachment: cleared_depth(&maps.layers[light], 1.0),
        timestamp_writes,
        ..Default::default()
    })
}

fn bind(
    pass: &mut wgpu::RenderPass<'_>,
    pipeline: &wgpu::RenderPipeline,
    groups: [&wgpu::BindGroup; 2],
) {
    pass.set_pipeline(pipeline);
    for (group, slot) in groups.into_iter().zip(0..) {
        pass.set_bind_group(slot, group, &[]);
    }
}
