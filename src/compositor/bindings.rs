//! Short spellings of wgpu's bind groups and pipelines.

use super::targets::format;
use wgpu::{BindGroupLayoutEntry, BindingType, ShaderStages};

/// What a shader binds, in the order of its bindings.
#[derive(Clone, Copy, Debug)]
pub enum Slot {
    Uniform,
    /// A part of a buffer, chosen when it is bound.
    UniformOf,
    Storage,
    /// Storage that compute shaders write.
    StorageWritten,
    Texture,
    /// Float texture that is only loaded, or of a format that cannot be filtered.
    Unfilterable,
    /// Unsigned integers.
    Integer,
    IntegerMultisampled,
    Depth,
    DepthMultisampled,
    DepthArray,
    Cube,
    /// An array of textures.
    Layers,
    Volume,
    /// An array of textures of half floats that compute shaders write.
    WrittenLayers,
    /// A texture of four codes of 8 bits that compute shaders write.
    WrittenCodes,
    Sampler,
    Comparison,
}

impl Slot {
    /// Properties and depth of virtual surfaces with so many samples a pixel.
    pub const fn sampled(samples: u32) -> (Self, Self) {
        if samples > 1 {
            (Self::IntegerMultisampled, Self::DepthMultisampled)
        } else {
            (Self::Integer, Self::Depth)
        }
    }

    const fn binding_type(self) -> BindingType {
        match self {
            Self::Uniform => buffer(wgpu::BufferBindingType::Uniform),
            Self::UniformOf => BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: true,
                min_binding_size: None,
            },
            Self::Storage => buffer(wgpu::BufferBindingType::Storage { read_only: true }),
            Self::StorageWritten => buffer(wgpu::BufferBindingType::Storage { read_only: false }),
            Self::Texture => texture(true, wgpu::TextureViewDimension::D2, false),
            Self::Unfilterable => texture(false, wgpu::TextureViewDimension::D2, false),
            Self::Integer => integer(false),
            Self::IntegerMultisampled => integer(true),
            Self::WrittenLayers => BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::WriteOnly,
                format: format::LIGHT,
                view_dimension: wgpu::TextureViewDimension::D2Array,
            },
            Self::WrittenCodes => BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::WriteOnly,
                format: wgpu::TextureFormat::Rgba8Unorm,
                view_dimension: wgpu::TextureViewDimension::D2,
            },
            Self::Volume => texture(true, wgpu::TextureViewDimension::D3, false),
            Self::Layers => texture(true, wgpu::TextureViewDimension::D2Array, false),
            Self::Cube => texture(true, wgpu::TextureViewDimension::Cube, false),
            Self::Depth => depth(wgpu::TextureViewDimension::D2, false),
            Self::DepthMultisampled => depth(wgpu::TextureViewDimension::D2, true),
            Self::DepthArray => depth(wgpu::TextureViewDimension::D2Array, false),
            Self::Sampler => BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            Self::Comparison => BindingType::Sampler(wgpu::SamplerBindingType::Comparison),
        }
    }
}

const fn buffer(ty: wgpu::BufferBindingType) -> BindingType {
    BindingType::Buffer {
        ty,
        has_dynamic_offset: false,
        min_binding_size: None,
    }
}

const fn texture(
    filterable: bool,
    view_dimension: wgpu::TextureViewDimension,
    multisampled: bool,
) -> BindingType {
    BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable },
        view_dimension,
        multisampled,
    }
}

const fn integer(multisampled: bool) -> BindingType {
    BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Uint,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled,
    }
}

const fn depth(view_dimension: wgpu::TextureViewDimension, multisampled: bool) -> BindingType {
    BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension,
        multisampled,
    }
}

/// A layout whose bindings are `slots`, in order, visible wherever something is drawn.
pub fn layout(device: &wgpu::Device, label: &str, slots: &[Slot]) -> wgpu::BindGroupLayout {
    layout_for(device, label, slots, ShaderStages::VERTEX_FRAGMENT)
}

/// The same for compute shaders.
pub fn compute_layout(device: &wgpu::Device, label: &str, slots: &[Slot]) -> wgpu::BindGroupLayout {
    layout_for(device, label, slots, ShaderStages::COMPUTE)
}

fn layout_for(
    device: &wgpu::Device,
    label: &str,
    slots: &[Slot],
    visibility: ShaderStages,
) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = slots
        .iter()
        .zip(0..)
        .map(|(slot, binding)| BindGroupLayoutEntry {
            binding,
            visibility,
            ty: slot.binding_type(),
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &entries,
    })
}

/// A group whose bindings are `resources`, in order.
pub fn group(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = resources
        .iter()
        .zip(0..)
        .map(|(resource, binding)| wgpu::BindGroupEntry {
            binding,
            resource: resource.clone(),
        })
        .collect();
    device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(label),
        layout,
        entries: &entries,
    })
}

/// Shorthand for a texture view in [`group`].
pub const fn view(view: &wgpu::TextureView) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::TextureView(view)
}

/// Shorthand for a sampler in [`group`].
pub const fn sampler(sampler: &wgpu::Sampler) -> wgpu::BindingResource<'_> {
    wgpu::BindingResource::Sampler(sampler)
}

/// Compiles a compute shader; the pipeline is called after its entry point.
pub fn compute_pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    groups: &[&wgpu::BindGroupLayout],
    entry: &str,
) -> wgpu::ComputePipeline {
    let groups: Vec<_> = groups.iter().map(|g| Some(*g)).collect();
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: &groups,
        immediate_size: 0,
    });
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout),
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

/// How fragments are held against the depth that is there.
#[derive(Clone, Copy, Debug)]
pub struct DepthTest {
    pub compare: wgpu::CompareFunction,
    pub write: bool,
}

impl DepthTest {
    /// The nearest surface stays, with reversed depth.
    pub const NEAREST: Self = Self::writing(wgpu::CompareFunction::GreaterEqual);

    pub const fn writing(compare: wgpu::CompareFunction) -> Self {
        Self {
            compare,
            write: true,
        }
    }

    pub const fn without_writing(compare: wgpu::CompareFunction) -> Self {
        Self {
            compare,
            write: false,
        }
    }
}

/// What differs between the compositor's render pipelines.
pub struct PipelineSpec<'a> {
    pub label: &'a str,
    pub module: &'a wgpu::ShaderModule,
    pub groups: &'a [&'a wgpu::BindGroupLayout],
    pub vertex: &'a str,
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    pub fragment: Option<&'a str>,
    pub targets: &'a [wgpu::TextureFormat],
    /// Which of the colours are written.
    pub colours: wgpu::ColorWrites,
    pub depth: Option<DepthTest>,
    pub cull: Option<wgpu::Face>,
    pub samples: u32,
}

impl PipelineSpec<'_> {
    /// Compiles it.
    pub fn build(&self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        let groups: Vec<_> = self.groups.iter().map(|g| Some(*g)).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(self.label),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let target = |format: &wgpu::TextureFormat| {
            Some(wgpu::ColorTargetState {
                format: *format,
                blend: None,
                write_mask: self.colours,
            })
        };
        let targets: Vec<_> = self.targets.iter().map(target).collect();
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.label),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: self.module,
                entry_point: Some(self.vertex),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &self.buffers.iter().cloned().map(Some).collect::<Vec<_>>(),
            },
            primitive: wgpu::PrimitiveState {
                cull_mode: self.cull,
                ..Default::default()
            },
            depth_stencil: self.depth.map(|test| wgpu::DepthStencilState {
                format: format::DEPTH,
                depth_write_enabled: Some(test.write),
                depth_compare: Some(test.compare),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState {
                count: self.samples,
                ..Default::default()
            },
            fragment: self.fragment.map(|entry| wgpu::FragmentState {
                module: self.module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Vertex buffer of [`penumbra_scene::Vertex`].
pub const VERTEX_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: size_of::<penumbra_scene::Vertex>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Float32x2, 3 => Float32x4],
};

/// Vertex buffer of bare positions.
pub const POSITION_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: 12,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3],
};
