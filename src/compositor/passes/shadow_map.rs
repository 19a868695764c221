//! Draws casters into the shadow maps of the dome lights chosen for this frame.

use super::super::bindings::{DepthTest, POSITION_LAYOUT, PipelineSpec};
use super::super::scene_buffers::{MeshBuffers, SceneBuffers};
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
    pub fn new(device: &wgpu::Device, frame: &wgpu::BindGroupLayout) -> Self {
        let module = shaders::module(device, "shadow_map", shaders::Variant::PLAIN);
        let build = |vertex: &str| {
            PipelineSpec {
                label: "shadow_map",
                module: &module,
                groups: &[frame],
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
        let sets = [
            (&self.virtual_pipeline, &scene.virtual_casters, maps.0),
            (&self.phantom_pipeline, &scene.phantom_casters, maps.1),
        ];
        // Where nothing casts, no map is ever read.
        let total = lights.len() * sets.iter().filter(|(_, c, _)| c.mesh.is_some()).count();
        let mut done = 0;
        for light in lights {
            for (pipeline, casters, maps) in sets {
                let Some(mesh) = &casters.mesh else { continue };
                done += 1;
                let writes = timer.span("shadow_map", done == 1, done == total);
                draw(encoder, writes, pipeline, frame, mesh, maps, *light);
            }
        }
    }
}

fn draw(
    encoder: &mut wgpu::CommandEncoder,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    pipeline: &wgpu::RenderPipeline,
    frame: &wgpu::BindGroup,
    mesh: &MeshBuffers,
    maps: &ShadowMaps,
    light: usize,
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("shadow_map"),
        depth_stencil_attachment: cleared_depth(&maps.layers[light], 1.0),
        timestamp_writes,
        ..Default::default()
    });
    let light = light as u32;
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, frame, &[]);
    pass.set_vertex_buffer(0, mesh.vertices.slice(..));
    pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
    pass.draw_indexed(0..mesh.count, 0, light..light + 1);
}
