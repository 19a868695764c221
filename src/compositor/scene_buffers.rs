//! A scene on the GPU: vertices, indices, materials, casters.

use super::bindings::{Slot, group, layout, sampler, view};
use super::detail::Details;
use super::emitters::Emitters;
use super::gpu_data::{PhantomPartUniform, VirtualPartUniform};
use super::lamp_screens::LampScreens;
use super::moving::{CASTER_SHIFT, CasterPlaces, MovingPart};
use glam::{DMat4, Mat4, Vec3};
use penumbra_lighting::lobes::phong_parameter;
use penumbra_scene::motion::still_and_moving;
use penumbra_scene::{Material, Part, Scene, SceneTexture};
use std::sync::Arc;
use wgpu::util::{BufferInitDescriptor, DeviceExt, TextureDataOrder};

/// Indexed triangles on the GPU.
pub struct MeshBuffers {
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub count: u32,
}

/// Casters that stand still, merged in world coordinates: one draw per shadow map.
pub struct Casters {
    pub mesh: Option<MeshBuffers>,
    /// The same vertices, kept for fitting maps.
    pub positions: Vec<[f32; 3]>,
}

/// Casters of a set for one map: what stands still, then what moves, each with its number.
pub fn draw_casters<'a>(
    pass: &mut wgpu::RenderPass<'_>,
    meshes: impl Iterator<Item = (u32, &'a MeshBuffers)>,
    map: u32,
) {
    for (number, mesh) in meshes {
        let instance = map | number << CASTER_SHIFT;
        pass.set_vertex_buffer(0, mesh.vertices.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.count, 0, instance..instance + 1);
    }
}

/// One virtual part, ready to draw.
pub struct DrawPart {
    pub vertices: wgpu::Buffer,
    pub details: Details,
    pub material: Option<wgpu::BindGroup>,
    pub double_sided: bool,
    /// Looks different from place to place, or is cut away.
    pub textured: bool,
}

/// Everything of a [`Scene`] that passes bind.
pub struct SceneBuffers {
    pub virtual_parts: Vec<DrawPart>,
    pub phantom_parts: Vec<DrawPart>,
    pub virtual_uniforms: wgpu::BindGroup,
    pub phantom_uniforms: wgpu::BindGroup,
    /// What stands behind `virtual_uniforms`.
    pub virtual_buffer: wgpu::Buffer,
    pub virtual_casters: Casters,
    pub phantom_casters: Casters,
    /// Virtual parts that move, in the order of their indices.
    pub moving: Vec<MovingPart>,
    pub caster_places: CasterPlaces,
    /// All phantoms, ground included, as one position-only mesh: hides what is behind.
    pub occluders: Option<MeshBuffers>,
    pub ground_height: Option<f64>,
    /// Something has Phong's lobe.
    pub has_phong: bool,
    /// What area lamps show, for their light and for the eye.
    pub screens: LampScreens,
    pub emitters: Emitters,
}

/// Layouts that outlive any scene.
#[derive(Clone)]
pub struct SceneLayouts {
    pub parts: wgpu::BindGroupLayout,
    pub material: wgpu::BindGroupLayout,
}

impl SceneLayouts {
    pub fn new(device: &wgpu::Device) -> Self {
        let t = Slot::Texture;
        Self {
            parts: layout(device, "parts", &[Slot::Storage]),
            material: layout(device, "material", &[Slot::Sampler, t, t, t, t, t]),
        }
    }
}

impl SceneBuffers {
    /// Uploads `scene`. `casters` are the virtual parts as they cast (simplified or the
    /// parts themselves).
    pub fn upload(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        layouts: &SceneLayouts,
        scene: &Scene,
        casters: &[Part],
    ) -> Self {
        let textures = MaterialUploader::new(device, queue, &layouts.material);
        let draw = |part: &Part, material: bool| DrawPart {
            vertices: vertex_buffer(device, bytemuck::cast_slice(&part.mesh.vertices)),
            details: Details::new(device, part, material),
            material: material.then(|| textures.bind(&part.material)),
            double_sided: part.material.double_sided,
            textured: part.material.is_textured() || part.material.alpha_cutoff > 0.0,
        };
        let solid: Vec<Part> = scene
            .phantom_parts
            .iter()
            .filter(|p| !is_ground(p, scene))
            .cloned()
            .collect();
        let (still, _) = still_and_moving(casters, &scene.motions);
        let moving = moving(device, scene, casters);
        let uniforms: Vec<_> = scene.virtual_parts.iter().map(virtual_uniform).collect();
        let (virtual_buffer, virtual_uniforms) = storage(device, &layouts.parts, &uniforms);
        let places = CasterPlaces::contents(&moving);
        let (buffer, group) = storage(device, &layouts.parts, &places);
        Self {
            virtual_parts: scene.virtual_parts.iter().map(|p| draw(p, true)).collect(),
            phantom_parts: scene.phantom_parts.iter().map(|p| draw(p, false)).collect(),
            virtual_uniforms,
            virtual_buffer,
            phantom_uniforms: storage(
                device,
                &layouts.parts,
                &scene
                    .phantom_parts
                    .iter()
                    .map(phantom_uniform)
                    .collect::<Vec<_>>(),
            )
            .1,
            virtual_casters: merge(device, still),
            phantom_casters: merge(device, &solid),
            moving,
            caster_places: CasterPlaces::new(buffer, group),
            occluders: merge(device, &scene.phantom_parts).mesh,
            ground_height: scene.ground_height,
            has_phong: scene.has_phong(),
            screens: LampScreens::new(device, queue, &scene.lamps),
            emitters: Emitters::new(device, &layouts.parts, &scene.lamps, |m| textures.bind(m)),
        }
    }
}

impl SceneBuffers {
    /// All virtual casters with their numbers.
    pub fn virtual_caster_meshes(&self) -> impl Iterator<Item = (u32, &MeshBuffers)> {
        let still = self.virtual_casters.mesh.iter().map(|mesh| (0, mesh));
        let moving = (1..).zip(&self.moving);
        still.chain(moving.filter_map(|(k, part)| Some((k, part.caster.as_ref()?))))
    }

    /// All phantom casters with their numbers: none of them moves.
    pub fn phantom_caster_meshes(&self) -> impl Iterator<Item = (u32, &MeshBuffers)> {
        self.phantom_casters.mesh.iter().map(|mesh| (0, mesh))
    }
}

/// The parts that move, where they stand at first.
fn moving(device: &wgpu::Device, scene: &Scene, casters: &[Part]) -> Vec<MovingPart> {
    let movers = scene.motions.parts.iter().filter_map(|mover| {
        let part = scene.virtual_parts.get(mover.index)?;
        Some((mover, part, casters.get(mover.index)?))
    });
    movers
        .map(|(mover, part, caster)| {
            let own = Part {
                world_from_part: DMat4::IDENTITY,
                ..caster.clone()
            };
            let mesh = merge(device, [&own]).mesh;
            MovingPart::new(mover.index, mover.motion.clone(), part, caster, mesh)
        })
        .collect()
}

/// The ground shadows nothing above it, and would stretch the phantoms' shadow maps beyond
/// use: it is no caster.
pub(super) fn is_ground(part: &Part, scene: &Scene) -> bool {
    let Some(height) = scene.ground_height else {
        return false;
    };
    let world = part.world_from_part;
    part.mesh
        .vertices
        .iter()
        .all(|v| (world.transform_point3(v.position.as_dvec3()).z - height).abs() < 1e-6)
}

fn merge<'a>(device: &wgpu::Device, parts: impl IntoIterator<Item = &'a Part>) -> Casters {
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let mut indices: Vec<u32> = Vec::new();
    for part in parts {
        let base = positions.len() as u32;
        positions.extend(part.mesh.vertices.iter().map(|v| {
            part.world_from_part
                .transform_point3(v.position.as_dvec3())
                .as_vec3()
                .to_array()
        }));
        let placed = placed_indices(part, &part.mesh.indices);
        indices.extend(placed.iter().map(|i| i + base));
    }
    let mesh = (!indices.is_empty()).then(|| MeshBuffers {
        vertices: vertex_buffer(device, bytemuck::cast_slice(&positions)),
        indices: index_buffer(device, &indices),
        count: indices.len() as u32,
    });
    Casters { mesh, positions }
}

pub(super) fn vertex_buffer(device: &wgpu::Device, contents: &[u8]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::VERTEX;
    device.create_buffer_init(&BufferInitDescriptor {
        label: Some("vertices"),
        contents,
        usage,
    })
}

pub(super) fn index_buffer(device: &wgpu::Device, indices: &[u32]) -> wgpu::Buffer {
    device.create_buffer_init(&BufferInitDescriptor {
        label: Some("indices"),
        contents: bytemuck::cast_slice(indices),
        usage: wgpu::BufferUsages::INDEX,
    })
}

/// `indices` of the part's mesh, its outside out.
pub(super) fn placed_indices(part: &Part, indices: &[u32]) -> Vec<u32> {
    let mut indices = indices.to_vec();
    if part.world_from_part.determinant() < 0.0 {
        // A mirrored placement turns triangles inside out.
        indices.chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
    }
    indices
}

pub(super) fn matrices(world_from_part: DMat4) -> ([[f32; 4]; 4], [[f32; 4]; 4]) {
    let world: Mat4 = world_from_part.as_mat4();
    let normal = world_from_part.inverse().transpose().as_mat4();
    let mut normal = normal.to_cols_array_2d();
    // Has no use otherwise: the bitangent's side turns round with a mirroring placement.
    normal[3][3] = if world.determinant() < 0.0 { -1.0 } else { 1.0 };
    (world.to_cols_array_2d(), normal)
}

fn virtual_uniform(part: &Part) -> VirtualPartUniform {
    let (world_from_part, normal_from_part) = matrices(part.world_from_part);
    let m = &part.material;
    let bump = if m.normal_texture.is_some() {
        m.normal_scale
    } else {
        0.0
    };
    VirtualPartUniform {
        world_from_part,
        normal_from_part,
        base_colour: m.base_colour.to_array(),
        surface: [m.metallic, m.roughness, m.specular, m.alpha_cutoff],
        emissive: m.emissive.extend(bump).to_array(),
        phong: m.phong.map_or([-1.0; 4], |p| {
            let root = p.specular.max(Vec3::ZERO).to_array().map(f32::sqrt);
            Vec3::from(root)
                .extend(phong_parameter(p.exponent))
                .to_array()
        }),
    }
}

fn phantom_uniform(part: &Part) -> PhantomPartUniform {
    let (world_from_part, normal_from_part) = matrices(part.world_from_part);
    let kind = if part.mirror { 2.0 } else { 1.0 };
    // What is not known is white: a lamp's units hold for white.
    let [r, g, b] = part.albedo.unwrap_or(Vec3::ONE).to_array();
    PhantomPartUniform {
        world_from_part,
        normal_from_part,
        kind: [kind, r, g, b],
    }
}

fn storage<T: bytemuck::Pod>(
    device: &wgpu::Device,
    layout: &wgpu::BindGroupLayout,
    parts: &[T],
) -> (wgpu::Buffer, wgpu::BindGroup) {
    // A binding may not be empty.
    let empty = [T::zeroed()];
    let contents = bytemuck::cast_slice(if parts.is_empty() { &empty } else { parts });
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
    let buffer = device.create_buffer_init(&BufferInitDescriptor {
        label: Some("parts"),
        contents,
        usage,
    });
    let bound = group(device, "parts", layout, &[buffer.as_entire_binding()]);
    (buffer, bound)
}

struct MaterialUploader<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    layout: &'a wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl<'a> MaterialUploader<'a> {
    fn new(
        device: &'a wgpu::Device,
        queue: &'a wgpu::Queue,
        layout: &'a wgpu::BindGroupLayout,
    ) -> Self {
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("surface"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self {
            device,
            queue,
            layout,
            sampler,
        }
    }

    fn bind(&self, m: &Material) -> wgpu::BindGroup {
        let (srgb, plain) = (
            wgpu::TextureFormat::Rgba8UnormSrgb,
            wgpu::TextureFormat::Rgba8Unorm,
        );
        let views = [
            self.texture(m.base_colour_texture.as_ref(), srgb),
            self.texture(m.metallic_roughness_texture.as_ref(), plain),
            self.texture(m.normal_texture.as_ref(), plain),
            self.texture(m.occlusion_texture.as_ref(), plain),
            self.texture(m.emissive_texture.as_ref(), srgb),
        ];
        let mut resources = vec![sampler(&self.sampler)];
        resources.extend(views.iter().map(view));
        group(self.device, "material", self.layout, &resources)
    }

    fn texture(
        &self,
        texture: Option<&Arc<SceneTexture>>,
        format: wgpu::TextureFormat,
    ) -> wgpu::TextureView {
        let white = SceneTexture {
            width: 1,
            height: 1,
            rgba: vec![255; 4],
        };
        let t = texture.map_or(&white, |t| t.as_ref());
        let levels = mip_chain(t, format == wgpu::TextureFormat::Rgba8UnormSrgb);
        let data: Vec<u8> = levels.concat();
        let descriptor = wgpu::TextureDescriptor {
            label: Some("surface"),
            size: wgpu::Extent3d {
                width: t.width,
                height: t.height,
                depth_or_array_layers: 1,
            },
            mip_level_count: levels.len() as u32,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        self.device
            .create_texture_with_data(self.queue, &descriptor, TextureDataOrder::LayerMajor, &data)
            .create_view(&wgpu::TextureViewDescriptor::default())
    }
}

/// Box-filtered levels down to one texel, averaged in linear light for sRGB textures.
fn mip_chain(texture: &SceneTexture, srgb: bool) -> Vec<Vec<u8>> {
    let mut levels = vec![texture.rgba.clone()];
    let (mut w, mut h) = (texture.width, texture.height);
    while w > 1 || h > 1 {
        let finer = levels.last().map_or(&[][..], |l| l.as_slice());
        let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
        let mut coarser = Vec::with_capacity(4 * (nw * nh) as usize);
        for y in 0..nh {
            for x in 0..nw {
                coarser.extend(box_of_four(finer, (w, h), (2 * x, 2 * y), srgb));
            }
        }
        levels.push(coarser);
        (w, h) = (nw, nh);
    }
    levels
}

fn box_of_four(rgba: &[u8], (w, h): (u32, u32), (x, y): (u32, u32), srgb: bool) -> [u8; 4] {
    use penumbra_camera::{linear_from_srgb, srgb_from_linear};
    let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
    std::array::from_fn(|c| {
        let decode = srgb && c < 3;
        let sum: f32 = corners
            .iter()
            .map(|(x, y)| {
                let i = 4 * (y.min(&(h - 1)) * w + x.min(&(w - 1))) as usize + c;
                let v = f32::from(rgba[i]) / 255.0;
                if decode { linear_from_srgb(v) } else { v }
            })
            .sum();
        let mean = sum / 4.0;
        ((if decode { srgb_from_linear(mean) } else { mean }) * 255.0).round() as u8
    })
}
