//! Short forms of wgpu's bind groups and pipelines.

use super::compiled::{Device, Shader};
use super::textures::format;
use wgpu::{BindGroupLayoutEntry, BindingType, ShaderStages};

/// The kind of one binding of a shader.
#[derive(Clone, Copy, Debug)]
pub enum Slot {
    Uniform,
    /// A part of a uniform buffer, chosen by an offset when it is bound.
    UniformOf,
    Storage,
    /// Storage buffer that compute shaders write.
    StorageWritten,
    Texture,
    /// Float texture that is read texel by texel, or whose format cannot be filtered.
    Unfilterable,
    /// Texture of unsigned integers.
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
    /// A texture of four 8-bit codes that compute shaders write.
    WrittenCodes,
    Sampler,
    Comparison,
}

impl Slot {
    /// The slots of the properties and of the depth of virtual surfaces with `samples` samples a
    /// pixel.
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

/// Creates a layout whose bindings are `slots`, in order, visible in vertex and fragment shaders.
pub fn layout(device: &wgpu::Device, label: &str, slots: &[Slot]) -> wgpu::BindGroupLayout {
    layout_for(device, label, slots, ShaderStages::VERTEX_FRAGMENT)
}

/// Creates a layout whose bindings are `slots`, in order, for compute shaders.
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

/// Creates the bind group of one [`Slot::UniformOf`]: a `T` of `buffer`, chosen by its offset.
pub fn group_of<T>(
    device: &wgpu::Device,
    label: &str,
    layout: &wgpu::BindGroupLayout,
    buffer: &wgpu::Buffer,
) -> wgpu::BindGroup {
    let one = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer,
        offset: 0,
        size: std::num::NonZeroU64::new(size_of::<T>() as u64),
    });
    group(device, label, layout, &[one])
}

/// Creates a group whose bindings are `resources`, in order.
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

/// A bind group that is created again only when one of its resources was replaced: passes receive
/// their pictures with every frame, but these change only with the picture size.
pub struct CachedGroup {
    label: &'static str,
    pub layout: wgpu::BindGroupLayout,
    bound: Option<(Vec<Bound>, wgpu::BindGroup)>,
}

/// A resource that is bound.
#[derive(PartialEq)]
enum Bound {
    Buffer(wgpu::Buffer),
    View(wgpu::TextureView),
    Sampler(wgpu::Sampler),
}

impl Bound {
    /// The resource; `None` for kinds that no pass of the compositor binds.
    fn from_resource(resource: &wgpu::BindingResource<'_>) -> Option<Self> {
        match resource {
            wgpu::BindingResource::Buffer(binding) => Some(Self::Buffer(binding.buffer.clone())),
            wgpu::BindingResource::TextureView(view) => Some(Self::View((*view).clone())),
            wgpu::BindingResource::Sampler(sampler) => Some(Self::Sampler((*sampler).clone())),
            _ => None,
        }
    }

    fn is_same(&self, resource: &wgpu::BindingResource<'_>) -> bool {
        match (self, resource) {
            (Self::Buffer(bound), wgpu::BindingResource::Buffer(binding)) => {
                bound == binding.buffer
            }
            (Self::View(bound), wgpu::BindingResource::TextureView(view)) => bound == *view,
            (Self::Sampler(bound), wgpu::BindingResource::Sampler(sampler)) => bound == *sampler,
            _ => false,
        }
    }
}

impl CachedGroup {
    /// Creates an empty cache of groups with `layout`.
    pub const fn new(label: &'static str, layout: wgpu::BindGroupLayout) -> Self {
        Self {
            label,
            layout,
            bound: None,
        }
    }

    /// Creates an empty cache whose layout consists of `slots` for vertex and fragment shaders.
    pub fn from_slots(device: &wgpu::Device, label: &'static str, slots: &[Slot]) -> Self {
        Self::new(label, layout(device, label, slots))
    }

    /// The group of `resources`, in the order of the layout.
    pub fn get(
        &mut self,
        device: &wgpu::Device,
        resources: &[wgpu::BindingResource<'_>],
    ) -> &wgpu::BindGroup {
        let kept = self.bound.take().filter(|(bound, _)| {
            bound.len() == resources.len() && bound.iter().zip(resources).all(|(b, r)| b.is_same(r))
        });
        let (_, group) = self.bound.insert(kept.unwrap_or_else(|| {
            let bound = resources.iter().filter_map(Bound::from_resource).collect();
            (bound, group(device, self.label, &self.layout, resources))
        }));
        group
    }
}

/// Compiles a compute shader, unless that was done before; the pipeline is named after its entry
/// point.
pub fn compute_pipeline(
    device: &Device,
    shader: &Shader,
    groups: &[&wgpu::BindGroupLayout],
    entry: &str,
) -> wgpu::ComputePipeline {
    device.pipeline(shader, entry.to_owned(), |module| {
        compile_compute(device, module, groups, entry)
    })
}

fn compile_compute(
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

/// The depth test of a pipeline.
#[derive(Clone, Copy, Debug)]
pub struct DepthTest {
    pub compare: wgpu::CompareFunction,
    pub write: bool,
}

impl DepthTest {
    /// Keeps the nearest surface, with reversed depth.
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

/// The properties in which the compositor's render pipelines differ.
pub struct PipelineSpec<'a> {
    pub label: &'a str,
    pub shader: &'a Shader,
    pub groups: &'a [&'a wgpu::BindGroupLayout],
    pub vertex: &'a str,
    pub buffers: &'a [wgpu::VertexBufferLayout<'a>],
    pub fragment: Option<&'a str>,
    pub targets: &'a [wgpu::TextureFormat],
    /// The colour channels that are written.
    pub colours: wgpu::ColorWrites,
    pub depth: Option<DepthTest>,
    pub cull: Option<wgpu::Face>,
    pub samples: u32,
}

impl PipelineSpec<'_> {
    /// Compiles the pipeline, unless that was done before.
    pub fn build(&self, device: &Device) -> wgpu::RenderPipeline {
        device.pipeline(self.shader, self.key(), |module| {
            self.compile(device, module)
        })
    }

    /// All but the shader. Layouts of groups follow from the shader and its entries.
    fn key(&self) -> String {
        let entries = (self.vertex, self.fragment, self.buffers);
        let output = (self.targets, self.colours, self.depth);
        format!("{entries:?} {output:?} {:?} {}", self.cull, self.samples)
    }

    fn compile(&self, device: &wgpu::Device, module: &wgpu::ShaderModule) -> wgpu::RenderPipeline {
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
                module,
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
                module,
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

/// Vertex buffers of surfaces whose light is kept in the surface cache: [`VERTEX_LAYOUT`] and the
/// vertices' coordinates in the cache.
pub const CACHED_VERTEX_LAYOUT: [wgpu::VertexBufferLayout<'static>; 2] = [
    VERTEX_LAYOUT,
    wgpu::VertexBufferLayout {
        array_stride: size_of::<penumbra_surface_cache::CacheVertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![4 => Float32x2, 5 => Uint16x4],
    },
];

/// Vertex buffer of bare positions.
pub const POSITION_LAYOUT: wgpu::VertexBufferLayout<'static> = wgpu::VertexBufferLayout {
    array_stride: 12,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &wgpu::vertex_attr_array![0 => Float32x3],
};
