//! Levels of detail: coarser triangles over the same vertices, for objects whose triangles are
//! smaller than pixels.

use crate::mesh::Mesh;
use meshopt::SimplifyOptions;

/// Errors of normals (about three degrees) and of texture coordinates (half a texel of a texture
/// of 256) that count as much as the maximum error of positions.
const NORMAL_ERROR: f32 = 0.05;
const UV_ERROR: f32 = 0.002;

/// Returns indices of fewer triangles over the vertices of `mesh`, with an error of about
/// `max_error_m` (units of the mesh; quadric error of Garland and Heckbert 1998 with normals and,
/// if `textured`, texture coordinates). `None` if fewer than half of the triangles are removed.
#[must_use]
pub fn coarser(mesh: &Mesh, max_error_m: f32, textured: bool) -> Option<Vec<u32>> {
    if mesh.indices.len() < 3 * 500 || max_error_m.is_nan() || max_error_m <= 0.0 {
        return None;
    }
    let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(|v| v.position.into()).collect();
    let attributes: Vec<f32> = mesh
        .vertices
        .iter()
        .flat_map(|v| [v.normal.x, v.normal.y, v.normal.z, v.uv.x, v.uv.y])
        .collect();
    // Errors are relative to the extent of the mesh, as meshoptimizer measures positions.
    let extent = meshopt::simplify_scale_decoder(&positions);
    let relative = max_error_m / extent.max(f32::MIN_POSITIVE);
    let (normal, uv) = (relative / NORMAL_ERROR, relative / UV_ERROR);
    let uv = if textured { uv } else { 0.0 };
    let free = vec![false; positions.len()];
    let indices = meshopt::simplify_with_attributes_and_locks_decoder(
        &mesh.indices,
        &positions,
        &attributes,
        &[normal, normal, normal, uv, uv],
        5 * size_of::<f32>(),
        &free,
        0,
        relative,
        SimplifyOptions::None,
        None,
    );
    (!indices.is_empty() && 2 * indices.len() < mesh.indices.len()).then_some(indices)
}

#[cfg(test)]
mod tests {
    use super::coarser;
    use crate::primitives;
    use glam::Vec2;

    #[test]
    fn simplified_torus_keeps_its_shape_and_normals() {
        let mut torus = primitives::torus(0.09, 0.035, 225, 130);
        let error = 1.2e-4;
        let indices = coarser(&torus, error, false).unwrap();
        assert!(
            4 * indices.len() < torus.indices.len(),
            "{}",
            indices.len() / 3
        );
        torus.indices = indices;
        for t in torus.indices.chunks_exact(3) {
            let [a, b, c] = [t[0], t[1], t[2]].map(|i| torus.vertices[i as usize]);
            let middle = (a.position + b.position + c.position) / 3.0;
            let ring = Vec2::new(middle.truncate().length() - 0.09, middle.z);
            assert!(
                (ring.length() - 0.035).abs() < 5.0 * error,
                "{}",
                ring.length()
            );
            let normal = (a.normal + b.normal + c.normal).normalize();
            let away = middle.truncate().normalize() * ring.x;
            let true_normal = away.extend(ring.y).normalize();
            assert!(normal.dot(true_normal) > 0.99);
        }
    }

    #[test]
    fn small_meshes_and_zero_tolerance_are_not_simplified() {
        assert!(coarser(&primitives::torus(0.09, 0.035, 8, 8), 1.0, false).is_none());
        assert!(coarser(&primitives::torus(0.09, 0.035, 60, 60), 0.0, false).is_none());
    }
}
