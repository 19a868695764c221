//! Computes normals and tangents of meshes.

use crate::mesh::{Mesh, Vertex};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// Maximum number of triangles at a position whose normals are smoothed, so that a hostile mesh
/// cannot make the smoothing quadratic.
const MAX_NEIGHBOURS: usize = 64;

/// Replaces all normals. Corners share a normal (the mean of the adjacent faces, weighted by angle:
/// Thürmer and Wüthrich 1998) where the angle between the faces is less than `crease` radians;
/// zero gives flat faces. Indices must be valid.
pub(crate) fn recompute_normals(mesh: &mut Mesh, crease: f32) {
    let faces: Vec<Vec3> = super::check::triangles(mesh).map(face_normal).collect();
    let meeting = faces_by_position(mesh);
    let mut out = Mesh::default();
    let mut known: HashMap<(u32, [u32; 3]), u32> = HashMap::new();
    for (corner, &index) in mesh.indices.iter().enumerate() {
        let Some((vertex, face)) = mesh
            .vertices
            .get(index as usize)
            .zip(faces.get(corner / 3).copied())
        else {
            continue;
        };
        let around = meeting
            .get(&bits(vertex.position))
            .map_or(&[][..], Vec::as_slice);
        let normal = smooth_normal(face, around, &faces, crease);
        let key = (index, bits(normal));
        let next = out.vertices.len() as u32;
        let at = *known.entry(key).or_insert(next);
        if at == next {
            out.vertices.push(Vertex { normal, ..*vertex });
        }
        out.indices.push(at);
    }
    *mesh = out;
}

fn face_normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a).normalize_or(Vec3::Z)
}

fn bits(v: Vec3) -> [u32; 3] {
    // Adding zero maps −0 to +0, so that both have the same neighbours.
    [v.x, v.y, v.z].map(|x| (x + 0.0).to_bits())
}

/// Adjacent faces of each position and their angles there.
fn faces_by_position(mesh: &Mesh) -> HashMap<[u32; 3], Vec<(usize, f32)>> {
    let mut map: HashMap<[u32; 3], Vec<(usize, f32)>> = HashMap::new();
    for (face, corners) in super::check::triangles(mesh).enumerate() {
        let [a, b, c] = corners;
        for (at, left, right) in [(a, b, c), (b, c, a), (c, a, b)] {
            let (u, v) = (
                (left - at).normalize_or_zero(),
                (right - at).normalize_or_zero(),
            );
            let angle = u.dot(v).clamp(-1.0, 1.0).acos();
            map.entry(bits(at)).or_default().push((face, angle));
        }
    }
    map
}

fn smooth_normal(face: Vec3, around: &[(usize, f32)], faces: &[Vec3], crease: f32) -> Vec3 {
    if crease <= 0.0 || around.len() > MAX_NEIGHBOURS {
        return face;
    }
    let min_cosine = crease.cos();
    let sum: Vec3 = around
        .iter()
        .filter_map(|(i, angle)| faces.get(*i).map(|n| (*n, *angle)))
        .filter(|(n, _)| n.dot(face) >= min_cosine)
        .map(|(n, angle)| n * angle)
        .sum();
    sum.normalize_or(face)
}

/// Computes every tangent from the texture coordinates (Lengyel 2001): the direction of increasing
/// u, made orthogonal to the normal; w is the bitangent's sign. Corners where a texture meets its
/// mirror image are duplicated.
pub(crate) fn recompute_tangents(mesh: &mut Mesh) {
    separate_mirrored(mesh);
    let mut along = vec![(Vec3::ZERO, Vec3::ZERO); mesh.vertices.len()];
    for t in mesh.indices.chunks_exact(3) {
        let Some((u, v)) = uv_directions(mesh, t) else {
            continue;
        };
        for i in t {
            if let Some(sum) = along.get_mut(*i as usize) {
                *sum = (sum.0 + u, sum.1 + v);
            }
        }
    }
    for (vertex, (u, v)) in mesh.vertices.iter_mut().zip(along) {
        let n = vertex.normal;
        let tangent = (u - n * n.dot(u)).normalize_or(n.any_orthonormal_vector());
        // glTF's bitangent, cross(n, t) · w, points up in the texture, where v decreases.
        let sign = if n.cross(tangent).dot(v) > 0.0 {
            -1.0
        } else {
            1.0
        };
        vertex.tangent = tangent.extend(sign);
    }
}

/// Gives triangles with a mirrored texture their own vertices.
fn separate_mirrored(mesh: &mut Mesh) {
    let mut sides: Vec<Option<bool>> = vec![None; mesh.vertices.len()];
    let mut twins: HashMap<u32, u32> = HashMap::new();
    for first in (0..mesh.indices.len() / 3).map(|t| 3 * t) {
        let Some(mirrored) = is_mirrored(mesh, &mesh.indices[first..first + 3]) else {
            continue;
        };
        for corner in first..first + 3 {
            let index = mesh.indices[corner];
            let Some(side) = sides.get_mut(index as usize) else {
                continue;
            };
            if *side.get_or_insert(mirrored) == mirrored {
                continue;
            }
            let next = mesh.vertices.len() as u32;
            let twin = *twins.entry(index).or_insert(next);
            if twin == next {
                mesh.vertices.push(mesh.vertices[index as usize]);
            }
            mesh.indices[corner] = twin;
        }
    }
}

/// Whether the texture on a triangle is mirrored; `None` for degenerate texture coordinates.
fn is_mirrored(mesh: &Mesh, t: &[u32]) -> Option<bool> {
    let uv = |i: usize| mesh.vertices.get(*t.get(i)? as usize).map(|v| v.uv);
    let (a, b, c) = (uv(0)?, uv(1)?, uv(2)?);
    let area = (b - a).perp_dot(c - a);
    (area.abs() > f32::MIN_POSITIVE && area.is_finite()).then_some(area < 0.0)
}

/// Directions of increasing u and v on a triangle, weighted by its area.
fn uv_directions(mesh: &Mesh, t: &[u32]) -> Option<(Vec3, Vec3)> {
    let corner = |i: usize| mesh.vertices.get(*t.get(i)? as usize);
    let (a, b, c) = (corner(0)?, corner(1)?, corner(2)?);
    let (e1, e2) = (b.position - a.position, c.position - a.position);
    let (d1, d2): (Vec2, Vec2) = (b.uv - a.uv, c.uv - a.uv);
    let area = d1.perp_dot(d2);
    if area.abs() <= f32::MIN_POSITIVE || !area.is_finite() {
        return None;
    }
    let weight = e1.cross(e2).length();
    let u = (e1 * d2.y - e2 * d1.y) * area.signum();
    let v = (e2 * d1.x - e1 * d2.x) * area.signum();
    Some((
        u.normalize_or_zero() * weight,
        v.normalize_or_zero() * weight,
    ))
}

/// Normalises every normal, normalises or zeroes every tangent, and zeroes texture coordinates that
/// are not finite.
pub(crate) fn normalise_directions(mesh: &mut Mesh) {
    for v in &mut mesh.vertices {
        v.normal = v.normal.normalize_or(Vec3::Z);
        let t = v.tangent.truncate().normalize_or_zero();
        v.tangent = if v.tangent.is_finite() && t != Vec3::ZERO {
            t.extend(if v.tangent.w < 0.0 { -1.0 } else { 1.0 })
        } else {
            Vec4::ZERO
        };
        if !v.uv.is_finite() {
            v.uv = Vec2::ZERO;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two adjacent squares that share corners; the texture of the right one mirrors that of the
    /// left one.
    fn butterfly() -> Mesh {
        let corner = |x: f32, y: f32| Vertex {
            position: Vec3::new(x, y, 0.0),
            normal: Vec3::Z,
            uv: Vec2::new(1.0 - x.abs(), 1.0 - y),
            tangent: Vec4::ZERO,
        };
        let xs = [-1.0, 0.0, 1.0];
        Mesh {
            vertices: [0.0, 1.0]
                .iter()
                .flat_map(|y| xs.map(|x| corner(x, *y)))
                .collect(),
            indices: vec![0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4],
        }
    }

    #[test]
    fn mirrored_textures_have_mirrored_tangents_at_the_seam() {
        let mut mesh = butterfly();
        recompute_tangents(&mut mesh);
        assert_eq!(mesh.vertices.len(), 8);
        for t in mesh.indices.chunks_exact(3) {
            let corners = [0, 1, 2].map(|i| mesh.vertices[t[i] as usize]);
            let right = corners.iter().any(|v| v.position.x > 0.0);
            // u increases towards the seam from both sides; v decreases towards +Y on both.
            let (along, side) = if right { (-1.0, -1.0) } else { (1.0, 1.0) };
            for v in corners {
                assert_eq!(v.tangent, Vec4::new(along, 0.0, 0.0, side), "{v:?}");
                let up = v.normal.cross(v.tangent.truncate()) * v.tangent.w;
                assert_eq!(up, Vec3::Y);
            }
        }
    }

    #[test]
    fn triangles_without_texture_coordinates_have_tangents() {
        let mut mesh = butterfly();
        for v in &mut mesh.vertices {
            v.uv = Vec2::ZERO;
        }
        recompute_tangents(&mut mesh);
        for v in &mesh.vertices {
            let t = v.tangent.truncate();
            assert!((t.length() - 1.0).abs() < 1e-6 && t.dot(v.normal).abs() < 1e-6);
        }
    }
}
