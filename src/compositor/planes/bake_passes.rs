//! The pipelines of a bake.

use super::super::bindings::{
    DepthTest, POSITION_LAYOUT, PipelineSpec, Slot, compute_layout, compute_pipeline, group,
    layout, sampler, view,
};
use super::super::compiled::Device;
use super::super::mesh_buffers::MeshBuffers;
use super::super::recorder::{cleared, cleared_depth};
use super::super::shaders;
use super::super::textures::format;
use bytemuck::{Pod, Zeroable};

/// Texels along a side of a direction's shadow map.
pub(super) const MAP: u32 = 2048;

const RECEIVER_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: 24,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3],
};

/// Twin of WGSL `View` in `bake_receiver.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct ReceiverView {
    pub x: [f32; 4],
    pub y: [f32; 4],
    pub depth: [f32; 4],
    pub normal: [f32; 4],
}

/// Twin of WGSL `Direction` in `bake_evaluate.wgsl`; each half begins with a twin of `Map` in
/// `bake_map.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct Direction {
    pub model: [[f32; 4]; 3],
    pub phantoms: [[f32; 4]; 3],
    pub towards: [f32; 4],
    pub texels: [f32; 4],
    pub planes: [u32; 4],
}

/// The pipelines and layouts.
pub(super) struct BakePasses {
    receiver: wgpu::RenderPipeline,
    map: wgpu::RenderPipeline,
    one: wgpu::BindGroupLayout,
    evaluate: wgpu::BindGroupLayout,
    add: wgpu::ComputePipeline,
    finish: wgpu::ComputePipeline,
    compare: wgpu::Sampler,
}

impl BakePasses {
    pub fn new(device: &Device, resolution: u32) -> Self {
        let one = layout(device, "bake", &[Slot::Uniform]);
        let module = |name| shaders::bake_shader(name, resolution);
        let (receiver, map) = (module("bake_receiver"), module("bake_map"));
        let evaluate = compute_layout(
            device,
            "evaluate",
            &[
                Slot::Uniform,
                Slot::Storage,
                Slot::Storage,
                Slot::Depth,
                Slot::Depth,
                Slot::Comparison,
                Slot::StorageWritten,
                Slot::StorageWritten,
                Slot::StorageWritten,
            ],
        );
        let shader = module("bake_evaluate");
        let spec = PipelineSpec {
            label: "bake_map",
            shader: &map,
            groups: &[&one],
            vertex: "caster_vertex",
            buffers: &[POSITION_LAYOUT],
            fragment: None,
            targets: &[],
            colours: wgpu::ColorWrites::ALL,
            depth: Some(DepthTest::writing(wgpu::CompareFunction::LessEqual)),
            // Both sides of open meshes cast shadows.
            cull: None,
            samples: 1,
        };
        let seen = PipelineSpec {
            label: "bake_receiver",
            shader: &receiver,
            vertex: "receiver_vertex",
            buffers: &[RECEIVER_LAYOUT],
            fragment: Some("receiver_fragment"),
            targets: &[wgpu::TextureFormat::Rgba32Float],
            ..spec
        };
        Self {
            receiver: seen.build(device),
            map: PipelineSpec {
                shader: &map,
                ..spec
            }
            .build(device),
            add: compute_pipeline(device, &shader, &[&evaluate], "add"),
            finish: compute_pipeline(device, &shader, &[&evaluate], "finish"),
            compare: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("bake"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare: Some(wgpu::CompareFunction::LessEqual),
                ..Default::default()
            }),
            one,
            evaluate,
        }
    }

    /// Records the picture of `meshes` by a plane's camera.
    pub fn record_receiver(
        &self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        (colour, depth): (&wgpu::TextureView, &wgpu::TextureView),
        uniform: &wgpu::Buffer,
        meshes: &[&MeshBuffers],
    ) {
        let group = group(
            device,
            "receiver",
            &self.one,
            &[uniform.as_entire_binding()],
        );
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("bake_receiver"),
            color_attachments: &[cleared(colour)],
            depth_stencil_attachment: cleared_depth(depth, 1.0),
            ..Default::default()
        });
        pass.set_pipeline(&self.receiver);
        pass.set_bind_group(0, &group, &[]);
        for mesh in meshes {
            draw(&mut pass, mesh);
        }
    }

    /// Records a shadow map of casters; `uniform` contains its matrix rows.
    pub fn record_map(
        &self,
        device: &Device,
        encoder: &mut wgpu::CommandEncoder,
        map: &wgpu::TextureView,
        uniform: &wgpu::Buffer,
        mesh: Option<&MeshBuffers>,
    ) {
        let Some(mesh) = mesh else { return };
        let group = group(device, "map", &self.one, &[uniform.as_entire_binding()]);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("bake_map"),
            depth_stencil_attachment: cleared_depth(map, 1.0),
            ..Default::default()
        });
        pass.set_pipeline(&self.map);
        pass.set_bind_group(0, &group, &[]);
        draw(&mut pass, mesh);
    }

    /// Creates the bind group of [`Self::record`]: direction, planes, receivers; shadow maps; sums,
    /// visibilities, flags.
    pub fn bind(
        &self,
        device: &Device,
        read: [&wgpu::Buffer; 3],
        maps: [&wgpu::TextureView; 2],
        written: [&wgpu::Buffer; 3],
    ) -> wgpu::BindGroup {
        let mut all: Vec<_> = read.iter().map(|b| b.as_entire_binding()).collect();
        all.extend(maps.map(view));
        all.push(sampler(&self.compare));
        all.extend(written.iter().map(|b| b.as_entire_binding()));
        group(device, "evaluate", &self.evaluate, &all)
    }

    /// Records the addition of a direction (`finish` = false), or the conversion of the sums to
    /// visibilities, for `planes` planes.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        group: &wgpu::BindGroup,
        finish: bool,
        resolution: u32,
        planes: u32,
    ) {
        let texels = resolution * resolution;
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        let (pipeline, count) = if finish {
            (&self.finish, texels / 4)
        } else {
            (&self.add, texels)
        };
        pass.set_pipeline(pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(count.div_ceil(64), planes, 1);
    }
}

fn draw(pass: &mut wgpu::RenderPass<'_>, mesh: &MeshBuffers) {
    pass.set_vertex_buffer(0, mesh.vertices.slice(..));
    pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
    pass.draw_indexed(0..mesh.count, 0, 0..1);
}

/// Creates a square texture that is rendered to and read.
pub(super) fn square(
    device: &Device,
    label: &str,
    side: u32,
    format: wgpu::TextureFormat,
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d {
            width: side,
            height: side,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT
            | wgpu::TextureUsages::TEXTURE_BINDING
            | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

/// Creates a square depth target.
pub(super) fn depth_square(device: &Device, label: &str, side: u32) -> wgpu::TextureView {
    square(device, label, side, format::DEPTH).create_view(&wgpu::TextureViewDescriptor::default())
}
