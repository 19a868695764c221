//! Simplifies meshes for shadow maps: a caster needs its outline, not normals, texture coordinates or
//! seams.

use super::normals::recompute_normals;
use crate::mesh::{Mesh, Part, Vertex};
use glam::{DMat3, Vec2, Vec3, Vec4};
use meshopt::SimplifyOptions;
use std::collections::HashMap;

/// Ratio of the quadric error, a mean distance from planes, to the maximum error: on tori and
/// teapots the maximum is two to three times the quadric error (measured by this file's tests).
const QUADRIC_SHARE: f32 = 1.0 / 3.0;
/// Maximum number of runs: each leaves edges that the next can still collapse.
const MAX_RUNS: usize = 8;

/// Simplifies `mesh` with an error of at most about `max_error_m` (units of the mesh): vertices at
/// equal positions are merged, then edges are collapsed by quadric error (Garland and Heckbert
/// 1997, by meshoptimizer). A shadow map's bias must be larger than the error. Texture coordinates
/// and tangents are zero. `mesh` must have valid indices.
#[must_use]
pub fn simplify_for_casting(mesh: &Mesh, max_error_m: f32) -> Mesh {
    let (positions, mut indices) = welded(mesh);
    let mut left = max_error_m * QUADRIC_SHARE;
    for _ in 0..MAX_RUNS {
        let mut spent = 0.0;
        if indices.is_empty() || left.is_nan() || left <= 0.0 {
            break;
        }
        let options = SimplifyOptions::ErrorAbsolute;
        let fewer =
            meshopt::simplify_decoder(&indices, &positions, 0, left, options, Some(&mut spent));
        if fewer.len() >= indices.len() {
            break;
        }
        indices = fewer;
        // The error of each run is relative to its own input, so errors add up.
        left -= spent;
    }
    let mut out = compact(&positions, &indices);
    // Every vertex has one normal.
    recompute_normals(&mut out, std::f32::consts::PI);
    out
}

impl Part {
    /// Returns this part's mesh as a shadow caster, with an error of at most `max_error_m` metres in
    /// the *world*. Returns the mesh itself where it cannot be simplified: cut-out materials need
    /// their texture coordinates.
    #[must_use]
    pub fn caster(&self, max_error_m: f32) -> std::sync::Arc<Mesh> {
        let linear = DMat3::from_mat4(self.world_from_part);
        let scale = [linear.x_axis, linear.y_axis, linear.z_axis]
            .iter()
            .fold(0.0, |max: f64, axis| max.max(axis.length()));
        if self.material.alpha_cutoff > 0.0 || scale <= 0.0 {
            return self.mesh.clone();
        }
        let simple = simplify_for_casting(&self.mesh, max_error_m / scale as f32);
        if simple.indices.len() < self.mesh.indices.len() && !simple.indices.is_empty() {
            simple.into()
        } else {
            self.mesh.clone()
        }
    }
}

/// Distinct positions, and the triangles over them that are not degenerate.
fn welded(mesh: &Mesh) -> (Vec<[f32; 3]>, Vec<u32>) {
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let remap: Vec<u32> = mesh
        .vertices
        .iter()
        .map(|v| {
            // Adding zero maps −0 to +0.
            let p = (v.position + Vec3::ZERO).to_array();
            *known.entry(p.map(f32::to_bits)).or_insert_with(|| {
                positions.push(p);
                (positions.len() - 1) as u32
            })
        })
        .collect();
    let mut indices = Vec::with_capacity(mesh.indices.len());
    for t in mesh.indices.chunks_exact(3) {
        let corner = |i: usize| t.get(i).and_then(|i| remap.get(*i as usize)).copied();
        if let (Some(a), Some(b), Some(c)) = (corner(0), corner(1), corner(2))
            && a != b
            && b != c
            && c != a
        {
            indices.extend([a, b, c]);
        }
    }
    (positions, indices)
}

/// A mesh of the positions that are used.
fn compact(positions: &[[f32; 3]], indices: &[u32]) -> Mesh {
    let mut place = vec![u32::MAX; positions.len()];
    let mut out = Mesh::default();
    for i in indices {
        let (Some(slot), Some(p)) = (place.get_mut(*i as usize), positions.get(*i as usize)) else {
            continue;
        };
        if *slot == u32::MAX {
            *slot = out.vertices.len() as u32;
            out.vertices.push(Vertex {
                position: Vec3::from(*p),
                normal: Vec3::Z,
                uv: Vec2::ZERO,
                tangent: Vec4::ZERO,
            });
        }
        out.indices.push(*slot);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check_mesh, triangles};
    use crate::gltf_file::load_gltf;
    use crate::mesh::Material;
    use crate::primitives;
    use glam::{DMat4, DVec3};
    use std::sync::Arc;

    /// Maximum distance of the surface from the torus, by dense sampling.
    fn distance_from_torus(mesh: &Mesh, major: f32, minor: f32) -> f32 {
        let mut worst = 0.0f32;
        for [a, b, c] in triangles(mesh) {
            for i in 0..=8u8 {
                for j in 0..=(8 - i) {
                    let (u, v) = (f32::from(i) / 8.0, f32::from(j) / 8.0);
                    let p = a + (b - a) * u + (c - a) * v;
                    let ring = p.truncate().length() - major;
                    worst = worst.max((Vec2::new(ring, p.z).length() - minor).abs());
                }
            }
        }
        worst
    }

    #[test]
    fn simplified_torus_keeps_its_shape() {
        let torus = primitives::torus(0.08, 0.02, 225, 130);
        let mut last = torus.indices.len() / 3;
        for error in [0.0002, 0.0005, 0.001] {
            let simple = simplify_for_casting(&torus, error);
            check_mesh(&simple).unwrap();
            let count = simple.indices.len() / 3;
            let error_m = distance_from_torus(&simple, 0.08, 0.02);
            eprintln!("torus at {error} m: {count} triangles, error {error_m} m");
            assert!(count < last * 2 / 3, "{count} of {last}");
            assert!(error_m < error, "{error_m} at {error}");
            assert!(simple.vertices.iter().all(|v| v.normal.is_normalized()));
            last = count;
        }
    }

    #[test]
    fn flat_faces_collapse_completely_and_keep_the_volume() {
        // A box of many small squares.
        let mut mesh = primitives::cuboid(Vec3::ONE);
        for _ in 0..4 {
            mesh = split_in_four(&mesh);
        }
        assert_eq!(mesh.indices.len() / 3, 12 * 256);
        // Rounding of the quadrics is about 4e-4 of the object's size.
        let simple = simplify_for_casting(&mesh, 2e-3);
        assert_eq!(simple.indices.len() / 3, 12);
        let volume: f32 = triangles(&simple)
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!((volume - 1.0).abs() < 1e-5);
    }

    /// Distance from `p` to a triangle (Ericson 2004, section 5.1.5).
    fn distance_to(p: Vec3, [a, b, c]: [Vec3; 3]) -> f32 {
        let (e1, e2) = (b - a, c - a);
        let n = e1.cross(e2);
        let q = p - a;
        let (u, v) = (q.cross(e2).dot(n), e1.cross(q).dot(n));
        let area = n.length_squared();
        if area > 0.0 && u >= 0.0 && v >= 0.0 && u + v <= area {
            return q.dot(n).abs() / area.sqrt();
        }
        let to_edge = |s: Vec3, e: Vec3| {
            let t = ((p - s).dot(e) / e.length_squared().max(1e-30)).clamp(0.0, 1.0);
            (s + e * t).distance(p)
        };
        to_edge(a, e1).min(to_edge(a, e2)).min(to_edge(b, c - b))
    }

    /// Maximum distance from `b` of the centres of about 300 triangles of `a`.
    fn farthest(a: &Mesh, b: &Mesh) -> f32 {
        let step = (a.indices.len() / 3).div_ceil(300);
        let nearest = |p: Vec3| {
            triangles(b)
                .map(|t| distance_to(p, t))
                .fold(f32::MAX, f32::min)
        };
        triangles(a)
            .step_by(step)
            .map(|[a, b, c]| nearest((a + b + c) / 3.0))
            .fold(0.0, f32::max)
    }

    #[test]
    fn ground_truth_objects_keep_their_shape() {
        let Some(path) = penumbra_test_data::shared("truth") else {
            return;
        };
        for name in ["desk", "desk-sphere", "courtyard"] {
            let model = load_gltf(&path.join(name).join("object/object.glb")).unwrap();
            for object in model.parts {
                for error in [0.0002, 0.0005, 0.001] {
                    let simple = simplify_for_casting(&object.mesh, error);
                    let (all, left) = (object.mesh.indices.len() / 3, simple.indices.len() / 3);
                    let error_m =
                        farthest(&object.mesh, &simple).max(farthest(&simple, &object.mesh));
                    eprintln!(
                        "{name} {}: {all} -> {left} at {error} m, error {error_m} m",
                        object.name
                    );
                    assert!(left < all || all < 100);
                    assert!(error_m < error, "{name} {} {error_m} {error}", object.name);
                }
            }
        }
    }

    fn split_in_four(mesh: &Mesh) -> Mesh {
        let mut out = Mesh::default();
        for [a, b, c] in triangles(mesh) {
            let (ab, bc, ca) = ((a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0);
            for p in [a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca] {
                out.indices.push(out.vertices.len() as u32);
                out.vertices.push(Vertex {
                    position: p,
                    normal: Vec3::Z,
                    uv: Vec2::ZERO,
                    tangent: Vec4::ZERO,
                });
            }
        }
        out
    }

    fn part(mesh: Mesh, scale: f64, alpha_cutoff: f32) -> Part {
        Part {
            name: "p".into(),
            mesh: Arc::new(mesh),
            material: Arc::new(Material {
                alpha_cutoff,
                ..Material::default()
            }),
            world_from_part: DMat4::from_scale(DVec3::splat(scale)),
            mirror: false,
            albedo: None,
        }
    }

    #[test]
    fn maximum_error_is_measured_in_the_world() {
        let count = |scale: f64| {
            let torus = primitives::torus(0.08, 0.02, 100, 60);
            part(torus, scale, 0.0).caster(0.001).indices.len()
        };
        assert!(count(10.0) > 2 * count(1.0));
    }

    #[test]
    fn cut_out_and_small_meshes_are_not_simplified() {
        let cut_out = part(primitives::torus(0.08, 0.02, 100, 60), 1.0, 0.5);
        assert!(Arc::ptr_eq(&cut_out.caster(0.01), &cut_out.mesh));
        let small = part(primitives::plane(1.0, 1.0), 1.0, 0.0);
        assert!(Arc::ptr_eq(&small.caster(0.01), &small.mesh));
        let empty = simplify_for_casting(&Mesh::default(), 0.1);
        assert_eq!(empty, Mesh::default());
    }
}
