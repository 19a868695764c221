//! Points on the triangles of a part, and directions around a normal.

use crate::mesh::Part;
use glam::Vec3;
use std::f32::consts::TAU;

/// Returns the triangles of a part in the world, counter-clockwise from outside.
pub(super) fn world_triangles(part: &Part) -> impl Iterator<Item = [Vec3; 3]> {
    let corner = |i: &u32| {
        let vertex = part.mesh.vertices.get(*i as usize)?;
        Some(
            part.world_from_part
                .transform_point3(vertex.position.as_dvec3())
                .as_vec3(),
        )
    };
    // A mirroring transform reverses the winding.
    let (second, third) = if part.world_from_part.determinant() < 0.0 {
        (2, 1)
    } else {
        (1, 2)
    };
    let triangle = move |c: &[u32]| Some([corner(&c[0])?, corner(&c[second])?, corner(&c[third])?]);
    part.mesh.indices.chunks_exact(3).filter_map(triangle)
}

/// Returns the `k`-th of points evenly distributed over a triangle (the R2 sequence, Roberts 2018).
pub(super) fn point_in(t: &[Vec3; 3], k: usize) -> Vec3 {
    let at = |step: f64| (0.5 + step * k as f64).fract() as f32;
    let (u, v) = (at(0.754_877_666_246_693), at(0.569_840_290_998_053));
    let (u, v) = if u + v > 1.0 {
        (1.0 - u, 1.0 - v)
    } else {
        (u, v)
    };
    t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v
}

/// The `k`-th of `count` directions around +Z, with a density proportional to the cosine.
pub(super) fn cosine_direction(k: usize, count: usize, azimuth: f32) -> Vec3 {
    let u = (k as f32 + 0.5) / count as f32;
    let phi = azimuth + TAU * (k as f64 * 0.618_033_988_749_895).fract() as f32;
    let (sin, cos) = phi.sin_cos();
    let r = u.sqrt();
    Vec3::new(r * cos, r * sin, (1.0 - u).sqrt())
}
