//! The scene of a bake on the GPU: casters merged in world space, meshes of the receivers, and the
//! planes.

use super::super::caster_hull::CasterHull;
use super::super::mesh_buffers::{MeshBuffers, index_buffer, is_ground};
use super::compute::storage;
use crate::compiled::Device;
use bytemuck::{Pod, Zeroable};
use penumbra_scene::planes::{Layer, Receiver, ShadowingPlane};
use penumbra_scene::{Part, Scene, casters_within};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Maximum error of simplified casters, texels of the shadow maps.
const CASTER_TEXELS: f32 = 0.25;

/// Twin of WGSL `Plane` in `bake_evaluate.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct BakePlane {
    centre: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    kind: [u32; 4],
}

impl From<&ShadowingPlane> for BakePlane {
    fn from(plane: &ShadowingPlane) -> Self {
        let with = |v: glam::DVec3, w: f64| v.as_vec3().extend(w as f32).to_array();
        Self {
            centre: with(plane.centre, plane.depth),
            right: with(plane.right, plane.half_size.x),
            up: with(plane.up, plane.half_size.y),
            kind: [
                u32::from(plane.receiver == Receiver::Plane),
                u32::from(plane.layer == Layer::Virtual),
                0,
                0,
            ],
        }
    }
}

/// Casters of one layer.
pub(super) struct BakeCasters {
    pub mesh: Option<MeshBuffers>,
    pub hull: CasterHull,
}

/// The scene of a bake.
pub(super) struct BakeScene {
    pub model: BakeCasters,
    pub phantoms: BakeCasters,
    pub planes: wgpu::Buffer,
}

impl BakeScene {
    /// Uploads the scene for shadow maps of `map` texels along a side.
    pub fn new(
        device: &Device,
        queue: &wgpu::Queue,
        scene: &Scene,
        planes: &[ShadowingPlane],
        map: u32,
    ) -> Self {
        let solid: Vec<Part> = scene
            .phantom_parts
            .iter()
            .filter(|p| !is_ground(p, scene))
            .cloned()
            .collect();
        let bake_planes: Vec<BakePlane> = planes.iter().map(BakePlane::from).collect();
        let texel = extent(&scene.virtual_parts) / map as f32;
        let coarse = casters_within(scene, CASTER_TEXELS * texel);
        Self {
            model: casters(device, &coarse),
            phantoms: casters(device, &solid),
            planes: storage(device, queue, "planes", &bake_planes),
        }
    }
}

fn extent(parts: &[Part]) -> f32 {
    let hull = CasterHull::around(&positions(parts));
    glam::Vec3::AXES
        .iter()
        .filter_map(|axis| hull.extent(*axis))
        .map(|(low, high)| high - low)
        .fold(0.0, f32::max)
}

fn positions(parts: &[Part]) -> Vec<[f32; 3]> {
    let in_world = |part: &Part| -> Vec<[f32; 3]> {
        let world = |v: &penumbra_scene::Vertex| {
            part.world_from_part.transform_point3(v.position.as_dvec3())
        };
        part.mesh
            .vertices
            .iter()
            .map(|v| world(v).as_vec3().to_array())
            .collect()
    };
    parts.iter().flat_map(in_world).collect()
}

fn casters(device: &Device, parts: &[Part]) -> BakeCasters {
    let positions = positions(parts);
    let mut base = 0;
    let mut indices = Vec::new();
    for part in parts {
        indices.extend(part.mesh.indices.iter().map(|i| i + base));
        base += part.mesh.vertices.len() as u32;
    }
    BakeCasters {
        mesh: mesh(device, bytemuck::cast_slice(&positions), &indices),
        hull: CasterHull::around(&positions),
    }
}

/// Uploads a part with world positions and normals, for the planes' cameras.
pub(super) fn receiver_mesh(device: &Device, part: &Part) -> Option<MeshBuffers> {
    let normal_from_part = part.world_from_part.inverse().transpose();
    let vertices: Vec<[[f32; 3]; 2]> = part
        .mesh
        .vertices
        .iter()
        .map(|v| {
            let world = part.world_from_part.transform_point3(v.position.as_dvec3());
            let normal = normal_from_part.transform_vector3(v.normal.as_dvec3());
            [
                world.as_vec3().to_array(),
                normal.normalize_or(glam::DVec3::Z).as_vec3().to_array(),
            ]
        })
        .collect();
    mesh(device, bytemuck::cast_slice(&vertices), &part.mesh.indices)
}

fn mesh(device: &Device, vertices: &[u8], indices: &[u32]) -> Option<MeshBuffers> {
    (!indices.is_empty() && !vertices.is_empty()).then(|| MeshBuffers {
        vertices: device.create_buffer_init(&BufferInitDescriptor {
            label: Some("bake"),
            contents: vertices,
            usage: wgpu::BufferUsages::VERTEX,
        }),
        indices: index_buffer(device, indices),
        count: indices.len() as u32,
    })
}
