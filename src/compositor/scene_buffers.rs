//! A scene on the GPU: parts, materials, casters.

use super::bindings::{Slot, group, group_of, layout};
use super::detail::Details;
use super::emitters::Emitters;
use super::gpu_data::{CasterPlaceUniform, PhantomPartUniform, VirtualPartUniform};
use super::lamp_screens::LampScreens;
use super::materials::MaterialUploader;
use super::mesh_buffers::{
    MeshBuffers, index_buffer, is_ground, matrices, placed_indices, vertex_buffer,
};
use super::moving::{CasterPlaces, MovingPart};
use crate::compiled::Device;
use glam::{DMat4, Vec3};
use penumbra_lighting::lobes::phong_parameter;
use penumbra_scene::still_and_moving;
use penumbra_scene::{Mesh, Part, Scene};
use penumbra_surface_cache::{CacheVertex, Layer, SurfaceCache};
use std::sync::Arc;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Static casters, merged in world coordinates: one draw per shadow map.
pub struct Casters {
    pub mesh: Option<MeshBuffers>,
    /// The same vertices, to which shadow maps are fitted.
    pub positions: Vec<[f32; 3]>,
}

/// Draws the casters of a set into map number `map`, each at its place.
pub fn draw_casters<'a>(
    pass: &mut wgpu::RenderPass<'_>,
    places: &CasterPlaces,
    meshes: impl Iterator<Item = (u32, &'a MeshBuffers)>,
    map: u32,
) {
    for (number, mesh) in meshes {
        pass.set_bind_group(1, &places.group, &[CasterPlaceUniform::offset(number)]);
        pass.set_vertex_buffer(0, mesh.vertices.slice(..));
        pass.set_index_buffer(mesh.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..mesh.count, 0, map..map + 1);
    }
}

/// One part, ready to draw.
pub struct DrawPart {
    pub vertices: wgpu::Buffer,
    /// The vertices' coordinates in the surface cache, if there is one.
    pub cached: Option<wgpu::Buffer>,
    pub details: Details,
    pub material: Option<wgpu::BindGroup>,
    pub double_sided: bool,
    /// Whether the material has textures or an alpha cutoff.
    pub textured: bool,
}

impl DrawPart {
    /// Draws the chosen level of detail.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, instance: u32) {
        let level = self.details.level();
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        if let Some(cached) = &self.cached {
            pass.set_vertex_buffer(1, cached.slice(..));
        }
        pass.set_index_buffer(level.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..level.count, 0, instance..instance + 1);
    }
}

/// The resources of a [`Scene`] that passes bind.
pub struct SceneBuffers {
    pub virtual_parts: Vec<DrawPart>,
    pub phantom_parts: Vec<DrawPart>,
    pub virtual_uniforms: wgpu::BindGroup,
    pub phantom_uniforms: wgpu::BindGroup,
    /// The buffer of `virtual_uniforms`.
    pub virtual_buffer: wgpu::Buffer,
    pub virtual_casters: Casters,
    pub phantom_casters: Casters,
    /// Virtual parts that move, in the order of their indices.
    pub moving: Vec<MovingPart>,
    pub caster_places: CasterPlaces,
    /// All phantoms, the ground included, as one mesh of positions: they hide virtual objects
    /// behind them.
    pub occluders: Option<MeshBuffers>,
    pub ground_height: Option<f64>,
    /// Whether a material has Phong's lobe.
    pub has_phong: bool,
    /// Pictures of area lamps, for their light and as visible objects.
    pub screens: LampScreens,
    pub emitters: Emitters,
    /// Coordinates in the surface cache for a rectangle that it does not hold.
    pub uncached: wgpu::Buffer,
}

/// Layouts that are the same for all scenes.
#[derive(Clone)]
pub struct SceneLayouts {
    /// A virtual part, or the placement of a caster.
    pub part: wgpu::BindGroupLayout,
    /// All phantoms.
    pub parts: wgpu::BindGroupLayout,
    pub material: wgpu::BindGroupLayout,
}

impl SceneLayouts {
    pub fn new(device: &Device) -> Self {
        let t = Slot::Texture;
        Self {
            part: layout(device, "part", &[Slot::UniformOf]),
            parts: layout(device, "parts", &[Slot::Storage]),
            material: layout(device, "material", &[Slot::Sampler, t, t, t, t, t]),
        }
    }
}

impl SceneBuffers {
    /// Uploads `scene`. `casters` are its virtual parts as they cast shadows (simplified or the
    /// parts themselves); `cache` holds their light.
    pub fn upload(
        device: &Device,
        queue: &wgpu::Queue,
        layouts: &SceneLayouts,
        scene: &Scene,
        casters: &[Part],
        cache: Option<&SurfaceCache>,
    ) -> Self {
        let textures = MaterialUploader::new(device, queue, &layouts.material);
        let draw = |part: &Part, layer: Layer| {
            let split = cache.map(|cache| split(cache, part, layer));
            let (part, cached) = split.as_ref().map_or((part, None), |(p, c)| (p, Some(c)));
            let material = matches!(layer, Layer::Virtual(_));
            DrawPart {
                vertices: vertex_buffer(device, bytemuck::cast_slice(&part.mesh.vertices)),
                cached: cached.map(|c| vertex_buffer(device, bytemuck::cast_slice(c))),
                details: Details::new(device, part, material),
                material: material.then(|| textures.bind(&part.material)),
                double_sided: part.material.double_sided,
                textured: part.material.is_textured() || part.material.alpha_cutoff > 0.0,
            }
        };
        let (virtual_parts, phantom_parts) = (&scene.virtual_parts, &scene.phantom_parts);
        let virtual_draws = virtual_parts.iter().enumerate();
        let phantom_draws = phantom_parts.iter().enumerate();
        let solid: Vec<Part> = scene
            .phantom_parts
            .iter()
            .filter(|p| !is_ground(p, scene))
            .cloned()
            .collect();
        let (still, _) = still_and_moving(casters, &scene.motions);
        let moving = moving(device, scene, casters);
        let uniforms: Vec<_> = scene.virtual_parts.iter().map(virtual_uniform).collect();
        let virtual_buffer = buffer(device, wgpu::BufferUsages::UNIFORM, &uniforms);
        let virtual_uniforms =
            group_of::<VirtualPartUniform>(device, "parts", &layouts.part, &virtual_buffer);
        let phantom_uniforms: Vec<_> = scene.phantom_parts.iter().map(phantom_uniform).collect();
        let places = CasterPlaces::contents(&moving);
        let places = buffer(device, wgpu::BufferUsages::UNIFORM, &places);
        let group = group_of::<CasterPlaceUniform>(device, "casters", &layouts.part, &places);
        Self {
            virtual_parts: virtual_draws
                .map(|(i, p)| draw(p, Layer::Virtual(i)))
                .collect(),
            phantom_parts: phantom_draws
                .map(|(i, p)| draw(p, Layer::Phantom(i)))
                .collect(),
            uncached: vertex_buffer(device, &[0; 4 * size_of::<CacheVertex>()]),
            virtual_uniforms,
            virtual_buffer,
            phantom_uniforms: storage(device, &layouts.parts, &phantom_uniforms).1,
            virtual_casters: merge(device, still),
            phantom_casters: merge(device, &solid),
            moving,
            caster_places: CasterPlaces::new(places, group),
            occluders: merge(device, &scene.phantom_parts).mesh,
            ground_height: scene.ground_height,
            has_phong: scene.has_phong(),
            screens: LampScreens::new(device, queue, &scene.lamps),
            emitters: Emitters::new(device, &layouts.part, &scene.lamps, |m| textures.bind(m)),
        }
    }
}

/// A part with its vertices split for the surface cache, and their coordinates there; zeros for
/// mirrors.
fn split(cache: &SurfaceCache, part: &Part, layer: Layer) -> (Part, Vec<CacheVertex>) {
    let Some(split) = cache.split_mesh(layer) else {
        let nowhere = vec![CacheVertex::default(); part.mesh.vertices.len()];
        return (part.clone(), nowhere);
    };
    let own = &part.mesh.vertices;
    let mesh = Mesh {
        vertices: split.vertices.iter().map(|i| own[*i as usize]).collect(),
        indices: split.indices,
    };
    let part = Part {
        mesh: Arc::new(mesh),
        ..part.clone()
    };
    (part, split.cache)
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

    /// Draws all phantoms as visible surfaces.
    pub fn draw_phantoms(&self, pass: &mut wgpu::RenderPass<'_>) {
        for (part, instance) in self.phantom_parts.iter().zip(0..) {
            part.draw(pass, instance);
        }
    }
}

/// Creates the moving parts at their initial placements.
fn moving(device: &Device, scene: &Scene, casters: &[Part]) -> Vec<MovingPart> {
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

fn merge<'a>(device: &Device, parts: impl IntoIterator<Item = &'a Part>) -> Casters {
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
        ..VirtualPartUniform::default()
    }
}

fn phantom_uniform(part: &Part) -> PhantomPartUniform {
    let (world_from_part, normal_from_part) = matrices(part.world_from_part);
    let kind = if part.mirror { 2.0 } else { 1.0 };
    // Unknown albedo is white, for which the units of lamps are defined.
    let [r, g, b] = part.albedo.unwrap_or(Vec3::ONE).to_array();
    PhantomPartUniform {
        world_from_part,
        normal_from_part,
        kind: [kind, r, g, b],
    }
}

fn buffer<T: bytemuck::Pod>(
    device: &Device,
    usage: wgpu::BufferUsages,
    parts: &[T],
) -> wgpu::Buffer {
    // A binding may not be empty.
    let empty = [T::zeroed()];
    device.create_buffer_init(&BufferInitDescriptor {
        label: Some("parts"),
        contents: bytemuck::cast_slice(if parts.is_empty() { &empty } else { parts }),
        usage: usage | wgpu::BufferUsages::COPY_DST,
    })
}

fn storage<T: bytemuck::Pod>(
    device: &Device,
    layout: &wgpu::BindGroupLayout,
    parts: &[T],
) -> (wgpu::Buffer, wgpu::BindGroup) {
    let buffer = buffer(device, wgpu::BufferUsages::STORAGE, parts);
    let bound = group(device, "parts", layout, &[buffer.as_entire_binding()]);
    (buffer, bound)
}
