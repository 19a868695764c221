//! Indexed triangles on the GPU.

use crate::compiled::Device;
use glam::{DMat4, Mat4};
use penumbra_scene::{Part, Scene};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Indexed triangles.
pub struct MeshBuffers {
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    pub count: u32,
}

/// Uploads vertices.
pub fn vertex_buffer(device: &Device, contents: &[u8]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::VERTEX;
    device.create_buffer_init(&BufferInitDescriptor {
        label: Some("vertices"),
        contents,
        usage,
    })
}

/// Uploads the indices of triangles.
pub fn index_buffer(device: &Device, indices: &[u32]) -> wgpu::Buffer {
    device.create_buffer_init(&BufferInitDescriptor {
        label: Some("indices"),
        contents: bytemuck::cast_slice(indices),
        usage: wgpu::BufferUsages::INDEX,
    })
}

/// The `indices` of a part's mesh with outward-facing triangles in its placement.
pub fn placed_indices(part: &Part, indices: &[u32]) -> Vec<u32> {
    let mut indices = indices.to_vec();
    if part.world_from_part.determinant() < 0.0 {
        // A mirroring placement reverses the winding of triangles.
        indices.chunks_exact_mut(3).for_each(|t| t.swap(1, 2));
    }
    indices
}

/// The matrices of a part for its points and for its normals.
pub fn matrices(world_from_part: DMat4) -> ([[f32; 4]; 4], [[f32; 4]; 4]) {
    let world: Mat4 = world_from_part.as_mat4();
    let normal = world_from_part.inverse().transpose().as_mat4();
    let mut normal = normal.to_cols_array_2d();
    // This entry is unused otherwise: a mirroring placement flips the bitangent.
    normal[3][3] = if world.determinant() < 0.0 { -1.0 } else { 1.0 };
    (world.to_cols_array_2d(), normal)
}

/// Whether a part lies in the ground plane. The ground casts no shadow onto anything above it, and
/// would stretch the shadow maps of the phantoms far beyond the scene: it is no caster.
pub fn is_ground(part: &Part, scene: &Scene) -> bool {
    let Some(height) = scene.ground_height else {
        return false;
    };
    let world = part.world_from_part;
    part.mesh
        .vertices
        .iter()
        .all(|v| (world.transform_point3(v.position.as_dvec3()).z - height).abs() < 1e-6)
}
