//! What a mesh must be before anything else sees it.

use crate::mesh::Mesh;
use glam::Vec3;

/// Triangles of one file, instances counted.
pub const MOST_TRIANGLES: usize = 20_000_000;
/// Vertices of one file.
pub const MOST_VERTICES: usize = 60_000_000;
/// Texels along an edge of a texture.
pub const LARGEST_TEXTURE: u32 = 16_384;
/// Bytes of one file.
pub const LARGEST_FILE: usize = 1 << 30;
/// Metres from the origin.
const FARTHEST: f32 = 1e6;

/// Says in words why `mesh` cannot be drawn, if it cannot.
pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), String> {
    if mesh.indices.is_empty() || mesh.vertices.is_empty() {
        return Err("has no triangles; export it with geometry".into());
    }
    if mesh.indices.len() / 3 > MOST_TRIANGLES || mesh.vertices.len() > MOST_VERTICES {
        return Err(format!(
            "has more than {MOST_TRIANGLES} triangles; simplify it"
        ));
    }
    let count = mesh.vertices.len();
    if let Some(i) = mesh.indices.iter().find(|i| **i as usize >= count) {
        return Err(format!(
            "index {i} points past its {count} vertices; the file is damaged, export it again"
        ));
    }
    let near = |v: Vec3| v.is_finite() && v.abs().max_element() <= FARTHEST;
    if let Some(i) = mesh.vertices.iter().position(|v| !near(v.position)) {
        return Err(format!(
            "vertex {i} is not a finite place within {FARTHEST} m; the file is damaged or not in metres"
        ));
    }
    if triangles(mesh).all(|[a, b, c]| (b - a).cross(c - a).length() <= f32::MIN_POSITIVE) {
        return Err("has no area; check its scale".into());
    }
    Ok(())
}

/// The corners of each triangle whose indices are valid.
pub(crate) fn triangles(mesh: &Mesh) -> impl Iterator<Item = [Vec3; 3]> + '_ {
    mesh.indices.chunks_exact(3).filter_map(|t| {
        let corner = |i: usize| mesh.vertices.get(*t.get(i)? as usize).map(|v| v.position);
        Some([corner(0)?, corner(1)?, corner(2)?])
    })
}
