//! Checks of meshes that were read from files, and limits of files.

use crate::mesh::Mesh;
use glam::Vec3;

/// Maximum number of triangles of a file, instances included.
pub const MAX_TRIANGLES: usize = 20_000_000;
/// Maximum number of vertices of a file.
pub const MAX_VERTICES: usize = 60_000_000;
/// Maximum side of a texture, texels.
pub const MAX_TEXTURE_SIZE: u32 = 16_384;
/// Maximum size of a file, bytes.
pub const MAX_FILE_BYTES: usize = 1 << 30;
/// Maximum coordinate of a vertex, metres.
const MAX_COORDINATE: f32 = 1e6;

/// Checks that `mesh` can be rendered.
///
/// # Errors
/// It is empty, too large or without area, or an index or a position is invalid.
pub(crate) fn check_mesh(mesh: &Mesh) -> Result<(), String> {
    if mesh.indices.is_empty() || mesh.vertices.is_empty() {
        return Err("has no triangles; export it with geometry".into());
    }
    if mesh.indices.len() / 3 > MAX_TRIANGLES || mesh.vertices.len() > MAX_VERTICES {
        return Err(format!(
            "has more than {MAX_TRIANGLES} triangles; simplify it"
        ));
    }
    let count = mesh.vertices.len();
    if let Some(i) = mesh.indices.iter().find(|i| **i as usize >= count) {
        return Err(format!(
            "index {i} exceeds its {count} vertices; the file is damaged, export it again"
        ));
    }
    let near = |v: Vec3| v.is_finite() && v.abs().max_element() <= MAX_COORDINATE;
    if let Some(i) = mesh.vertices.iter().position(|v| !near(v.position)) {
        return Err(format!(
            "vertex {i} is not a finite position within {MAX_COORDINATE} m; the file is damaged or not in metres"
        ));
    }
    if triangles(mesh).all(|[a, b, c]| (b - a).cross(c - a).length() <= f32::MIN_POSITIVE) {
        return Err("has no area; check its scale".into());
    }
    Ok(())
}

/// Returns the corners of each triangle with valid indices.
pub(crate) fn triangles(mesh: &Mesh) -> impl Iterator<Item = [Vec3; 3]> + '_ {
    mesh.indices.chunks_exact(3).filter_map(|t| {
        let corner = |i: usize| mesh.vertices.get(*t.get(i)? as usize).map(|v| v.position);
        Some([corner(0)?, corner(1)?, corner(2)?])
    })
}
