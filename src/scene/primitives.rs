//! Built-in shapes. All are centred on the z axis, +Z up, counter-clockwise seen from outside; the
//! solids are closed. Lengths in metres.

use crate::mesh::{Mesh, Vertex};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// A rectangle in the plane z = 0, centred, facing +Z; v increases towards −Y.
#[must_use]
pub fn plane(size_x: f32, size_y: f32) -> Mesh {
    let mut mesh = Mesh::default();
    quad(&mut mesh, Vec3::ZERO, Vec3::X * size_x, Vec3::Y * size_y);
    mesh
}

/// A cuboid that stands on z = 0.
#[must_use]
pub fn cuboid(size: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    let middle = Vec3::Z * size.z / 2.0;
    for (out, u, v) in [
        (Vec3::X, Vec3::Y, Vec3::Z),
        (Vec3::NEG_X, Vec3::NEG_Y, Vec3::Z),
        (Vec3::Y, Vec3::NEG_X, Vec3::Z),
        (Vec3::NEG_Y, Vec3::X, Vec3::Z),
        (Vec3::Z, Vec3::X, Vec3::Y),
        (Vec3::NEG_Z, Vec3::X, Vec3::NEG_Y),
    ] {
        quad(&mut mesh, middle + out * size / 2.0, u * size, v * size);
    }
    mesh
}

/// A cylinder that stands on z = 0, `4 * segments` triangles.
#[must_use]
pub fn cylinder(radius: f32, height: f32, segments: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let side = [(radius, 0.0, Vec2::X), (radius, height, Vec2::X)];
    lathe(&mut mesh, &side, segments);
    disc(&mut mesh, radius, 0.0, false, segments);
    disc(&mut mesh, radius, height, true, segments);
    mesh
}

/// A cone that stands on z = 0, `2 * segments` triangles.
#[must_use]
pub fn cone(radius: f32, height: f32, segments: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let slope = Vec2::new(height, radius).normalize_or(Vec2::X);
    lathe(
        &mut mesh,
        &[(radius, 0.0, slope), (0.0, height, slope)],
        segments,
    );
    disc(&mut mesh, radius, 0.0, false, segments);
    mesh
}

/// A sphere about the origin: `segments` around, `rings` from pole to pole,
/// `2 * segments * (rings - 1)` triangles.
#[must_use]
pub fn sphere(radius: f32, segments: u32, rings: u32) -> Mesh {
    let rings = rings.clamp(2, 4096);
    let profile: Vec<_> = (0..=rings)
        .map(|i| {
            let angle = PI * i as f32 / rings as f32;
            // The poles lie exactly on the axis, so that the surface is closed.
            let out = if i == 0 || i == rings {
                0.0
            } else {
                angle.sin()
            };
            (
                radius * out,
                -radius * angle.cos(),
                Vec2::new(out, -angle.cos()),
            )
        })
        .collect();
    let mut mesh = Mesh::default();
    lathe(&mut mesh, &profile, segments);
    mesh
}

/// A torus about the z axis through the origin: `major` from the centre to the tube's
/// middle, `minor` the tube's radius; `2 * segments_u * segments_v` triangles.
#[must_use]
pub fn torus(major: f32, minor: f32, segments_u: u32, segments_v: u32) -> Mesh {
    let rings = segments_v.clamp(3, 4096);
    let profile: Vec<_> = (0..=rings)
        .map(|i| {
            let out = Vec2::from_angle(TAU * (i % rings) as f32 / rings as f32);
            (major + minor * out.x, minor * out.y, out)
        })
        .collect();
    let mut mesh = Mesh::default();
    lathe(&mut mesh, &profile, segments_u);
    mesh
}

fn vertex(position: Vec3, normal: Vec3, uv: Vec2, tangent: Vec3) -> Vertex {
    Vertex {
        position,
        normal,
        uv,
        tangent: tangent.extend(1.0),
    }
}

/// A rectangle about `centre` with edges `u` and `v`, facing u × v.
fn quad(mesh: &mut Mesh, centre: Vec3, u: Vec3, v: Vec3) {
    let first = mesh.vertices.len() as u32;
    let (along, up) = (u.normalize_or(Vec3::X), v.normalize_or(Vec3::Y));
    for (s, t) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        let position = centre + u * (s - 0.5) + v * (t - 0.5);
        let uv = Vec2::new(s, 1.0 - t);
        mesh.vertices
            .push(vertex(position, along.cross(up), uv, along));
    }
    mesh.indices.extend([0, 1, 2, 0, 2, 3].map(|i| first + i));
}

/// Revolves a profile of (distance from the axis, height, outward normal in that plane) about the z
/// axis; the outside is to the right along the profile. Degenerate triangles on the axis are left
/// out.
fn lathe(mesh: &mut Mesh, profile: &[(f32, f32, Vec2)], segments: u32) {
    let segments = segments.clamp(3, 4096);
    let first = mesh.vertices.len() as u32;
    let row = segments + 1;
    for (i, (out, z, normal)) in profile.iter().enumerate() {
        let v = 1.0 - i as f32 / (profile.len().max(2) - 1) as f32;
        for j in 0..row {
            // The two columns at the seam have bit-identical positions.
            let d = Vec2::from_angle(TAU * (j % segments) as f32 / segments as f32);
            mesh.vertices.push(vertex(
                (d * *out).extend(*z),
                (d * normal.x).extend(normal.y).normalize_or(Vec3::Z),
                Vec2::new(j as f32 / segments as f32, v),
                d.perp().extend(0.0),
            ));
        }
    }
    for (i, pair) in profile.windows(2).enumerate() {
        for j in 0..segments {
            let a = first + i as u32 * row + j;
            if pair[0].0 > 0.0 {
                mesh.indices.extend([a, a + 1, a + row + 1]);
            }
            if pair[1].0 > 0.0 {
                mesh.indices.extend([a, a + row + 1, a + row]);
            }
        }
    }
}

/// A disc at height `z`, facing up or down, whose rim has the corners of [`lathe`].
fn disc(mesh: &mut Mesh, radius: f32, z: f32, up: bool, segments: u32) {
    let segments = segments.clamp(3, 4096);
    let first = mesh.vertices.len() as u32;
    let normal = if up { Vec3::Z } else { Vec3::NEG_Z };
    let flip = if up { 1.0 } else { -1.0 };
    let middle = Vec2::splat(0.5);
    mesh.vertices
        .push(vertex(Vec3::Z * z, normal, middle, Vec3::X));
    for j in 0..segments {
        let d = Vec2::from_angle(TAU * j as f32 / segments as f32);
        let uv = middle + Vec2::new(d.x, -flip * d.y) / 2.0;
        mesh.vertices
            .push(vertex((d * radius).extend(z), normal, uv, Vec3::X));
    }
    for j in 0..segments {
        let (a, b) = (first + 1 + j, first + 1 + (j + 1) % segments);
        mesh.indices
            .extend(if up { [first, a, b] } else { [first, b, a] });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check_mesh, triangles};
    use std::collections::HashMap;

    fn signed_volume(mesh: &Mesh) -> f64 {
        triangles(mesh)
            .map(|[a, b, c]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3())) / 6.0)
            .sum()
    }

    /// Whether every edge occurs once in each direction.
    fn is_closed(mesh: &Mesh) -> bool {
        let bits = |v: Vec3| [v.x + 0.0, v.y + 0.0, v.z + 0.0].map(f32::to_bits);
        let mut edges = HashMap::new();
        for [a, b, c] in triangles(mesh) {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry((bits(p), bits(q))).or_insert(0) += 1;
                *edges.entry((bits(q), bits(p))).or_insert(0) -= 1;
            }
        }
        edges.values().all(|n| *n == 0)
    }

    fn solids() -> Vec<(&'static str, Mesh, usize, f64)> {
        let tau = f64::from(TAU);
        let n = 128.0;
        // Area of the inscribed polygon over that of the circle.
        let polygon = (tau / n).sin() / (tau / n);
        let circle = std::f64::consts::PI * polygon;
        vec![
            ("box", cuboid(Vec3::new(0.1, 0.2, 0.3)), 12, 0.006),
            (
                "cylinder",
                cylinder(0.1, 0.5, 128),
                512,
                circle * 0.01 * 0.5,
            ),
            ("cone", cone(0.1, 0.5, 128), 256, circle * 0.01 * 0.5 / 3.0),
            (
                "sphere",
                sphere(0.1, 256, 128),
                2 * 256 * 127,
                0.004 / 3.0 * std::f64::consts::PI,
            ),
            (
                "torus",
                torus(0.08, 0.02, 225, 130),
                58_500,
                tau * std::f64::consts::PI * 0.08 * 0.0004,
            ),
        ]
    }

    #[test]
    fn solids_are_closed_and_have_the_right_volume_and_count() {
        for (name, mesh, count, volume) in solids() {
            check_mesh(&mesh).unwrap();
            assert_eq!(mesh.indices.len() / 3, count, "{name}");
            assert!(is_closed(&mesh), "{name}");
            let error = signed_volume(&mesh) / volume - 1.0;
            assert!(error.abs() < 1e-3, "{name}: {error}");
        }
    }

    #[test]
    fn normals_and_tangents_are_orthonormal_and_consistent_with_the_faces() {
        let mut all: Vec<Mesh> = solids().into_iter().map(|s| s.1).collect();
        all.push(plane(2.0, 3.0));
        for mesh in all {
            for v in &mesh.vertices {
                assert!((v.normal.length() - 1.0).abs() < 1e-5);
                assert!((v.tangent.truncate().length() - 1.0).abs() < 1e-5);
                assert!(v.normal.dot(v.tangent.truncate()).abs() < 1e-5);
                assert!(v.uv.min_element() >= -1e-6 && v.uv.max_element() <= 1.0 + 1e-6);
            }
            for (t, [a, b, c]) in mesh.indices.chunks_exact(3).zip(triangles(&mesh)) {
                let face = (b - a).cross(c - a).normalize();
                let mean: Vec3 = t.iter().map(|i| mesh.vertices[*i as usize].normal).sum();
                assert!(face.dot(mean.normalize()) > 0.9, "{face} {mean}");
            }
        }
    }

    #[test]
    fn torus_vertices_lie_on_the_torus() {
        for v in torus(0.08, 0.02, 50, 40).vertices {
            let ring = v.position.truncate().length() - 0.08;
            let tube = Vec2::new(ring, v.position.z).length();
            assert!((tube - 0.02).abs() < 1e-6);
        }
    }

    #[test]
    fn plane_tangents_equal_those_from_texture_coordinates() {
        let mut mesh = plane(1.0, 1.0);
        let own: Vec<_> = mesh.vertices.iter().map(|v| v.tangent).collect();
        crate::normals::recompute_tangents(&mut mesh);
        for (v, own) in mesh.vertices.iter().zip(own) {
            assert!((v.tangent - own).length() < 1e-6, "{} {own}", v.tangent);
        }
    }
}
