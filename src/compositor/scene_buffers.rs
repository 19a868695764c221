//! A scene on the GPU: parts, materials, casters.

use super::bindings::{Slot, group, layout};
use super::detail::Details;
use super::emitters::Emitters;
use super::gpu_data::{PhantomPartUniform, VirtualPartUniform};
use super::lamp_screens::LampScreens;
use super::materials::MaterialUploader;
use super::mesh_buffers::{
    MeshBuffers, index_buffer, is_ground, matrices, placed_indices, vertex_buffer,
};
use super::moving::{CASTER_SHIFT, CasterPlaces, MovingPart};
use glam::{DMat4, Vec3};
use penumbra_lighting::lobes::phong_parameter;
use penumbra_scene::still_and_moving;
use penumbra_scene::{Part, Scene};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Static casters, merged in world coordinates: one draw per shadow map.
pub struct Casters {
    pub mesh: Option<MeshBuffers>,
    /// The same vertices, to which shadow maps are fitted.
    pub positions: Vec<[f32; 3]>,
}

/// Draws the casters of a set into one map, each with its number.
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

/// One part, ready to draw.
pub struct DrawPart {
    pub vertices: wgpu::Buffer,
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
}

/// Layouts that are the same for all scenes.
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
    /// Uploads `scene`. `casters` are its virtual parts as they cast shadows (simplified or the
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

    /// Draws all phantoms as visible surfaces.
    pub fn draw_phantoms(&self, pass: &mut wgpu::RenderPass<'_>) {
        for (part, instance) in self.phantom_parts.iter().zip(0..) {
            part.draw(pass, instance);
        }
    }
}

/// Creates the moving parts at their initial placements.
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
    // Unknown albedo is white, for which the units of lamps are defined.
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
