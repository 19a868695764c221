//! Fewer triangles for shadow maps: a caster needs its outline, not its normals, texture
//! coordinates or seams.

use super::normals::recompute_normals;
use crate::mesh::{Mesh, Part, Vertex};
use glam::{DMat3, Vec2, Vec3, Vec4};
use meshopt::SimplifyOptions;
use std::collections::HashMap;

/// The quadric error is a distance from planes, averaged over triangles; measured on
/// tori and teapots, the farthest point is two to three times as far off.
const QUADRIC_SHARE: f32 = 1.0 / 3.0;
/// One run leaves edges that the next can still collapse.
const MOST_RUNS: usize = 8;

/// A mesh whose surface departs from `mesh` by at most about `max_error_m` (in the mesh's
/// own units) and has as few triangles as that allows: vertices at one place are made
/// one, then edges are collapsed by quadric error (Garland & Heckbert 1997, as
/// meshoptimizer has it). A shadow map's bias against self-shadowing must be larger than
/// the error. Texture coordinates and tangents are zero. `mesh` must have valid indices.
#[must_use]
pub fn simplify_for_casting(mesh: &Mesh, max_error_m: f32) -> Mesh {
    let (positions, mut indices) = welded(mesh);
    let mut left = max_error_m * QUADRIC_SHARE;
    for _ in 0..MOST_RUNS {
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
        // Each run measures from its own input, so errors add up.
        left -= spent;
    }
    let mut out = compact(&positions, &indices);
    // Wide open, so that every vertex has one normal.
    recompute_normals(&mut out, std::f32::consts::PI);
    out
}

impl Part {
    /// This part's mesh as a shadow caster, within `max_error_m` metres of the *world*.
    /// Where nothing can be left out (cut-out materials need their texture coordinates)
    /// the mesh itself.
    #[must_use]
    pub fn caster(&self, max_error_m: f32) -> std::sync::Arc<Mesh> {
        let linear = DMat3::from_mat4(self.world_from_part);
        let scale = [linear.x_axis, linear.y_axis, linear.z_axis]
            .iter()
            .fold(0.0, |most: f64, axis| most.max(axis.length()));
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

/// Distinct positions, and triangles over them that are not collapsed.
fn welded(mesh: &Mesh) -> (Vec<[f32; 3]>, Vec<u32>) {
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut positions: Vec<[f32; 3]> = Vec::new();
    let remap: Vec<u32> = mesh
        .vertices
        .iter()
        .map(|v| {
            // Adding zero makes −0 and +0 one place.
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

/// A mesh of only those positions that are used.
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
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::check::{check_mesh, triangles};
    use crate::gltf_file::load_gltf;
    use crate::mesh::Material;
    use crate::primitives;
    use glam::{DMat4, DVec3};
    use std::sync::Arc;

    /// Farthest that the surface departs from the torus, by dense sampling.
    fn off_the_torus(mesh: &Mesh, major: f32, minor: f32) -> f32 {
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
    fn a_torus_keeps_its_shape_with_far_fewer_triangles() {
        let torus = primitives::torus(0.08, 0.02, 225, 130);
        let mut last = torus.indices.len() / 3;
        for error in [0.0002, 0.0005, 0.001] {
            let simple = simplify_for_casting(&torus, error);
            check_mesh(&simple).unwrap();
            let count = simple.indices.len() / 3;
            let off = off_the_torus(&simple, 0.08, 0.02);
            eprintln!("torus at {error} m: {count} triangles, {off} m off");
            assert!(count < last * 2 / 3, "{count} of {last}");
            assert!(off < error, "{off} at {error}");
            assert!(simple.vertices.iter().all(|v| v.normal.is_normalized()));
            last = count;
        }
    }

    #[test]
    fn flat_faces_collapse_completely_and_volume_stays() {
        // A box out of many small squares.
        let mut mesh = primitives::cuboid(Vec3::ONE);
        for _ in 0..4 {
            mesh = split_in_four(&mesh);
        }
        assert_eq!(mesh.indices.len() / 3, 12 * 256);
        // The quadrics' own rounding is some 4e-4 of an object's size.
        let simple = simplify_for_casting(&mesh, 2e-3);
        assert_eq!(simple.indices.len() / 3, 12);
        let volume: f32 = triangles(&simple)
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!((volume - 1.0).abs() < 1e-5);
    }

    /// From `p` to the nearest point of a triangle (Ericson 2004, section 5.1.5).
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

    /// The farthest that the middle of any of some hundred triangles of `a` is from `b`.
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
    fn the_truth_objects_keep_their_shape() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/truth");
        if !path.is_dir() {
            eprintln!("SKIPPED the_truth_objects_keep_their_shape: ../shared is missing");
            return;
        }
        for name in ["desk", "desk-sphere", "courtyard"] {
            let model = load_gltf(&path.join(name).join("object/object.glb")).unwrap();
            for object in model.parts {
                for error in [0.0002, 0.0005, 0.001] {
                    let simple = simplify_for_casting(&object.mesh, error);
                    let (all, left) = (object.mesh.indices.len() / 3, simple.indices.len() / 3);
                    let off = farthest(&object.mesh, &simple).max(farthest(&simple, &object.mesh));
                    eprintln!(
                        "{name} {}: {all} -> {left} at {error} m, {off} off",
                        object.name
                    );
                    assert!(left < all || all < 100);
                    assert!(off < error, "{name} {} {off} {error}", object.name);
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
    fn the_error_counts_in_the_world() {
        let count = |scale: f64| {
            let torus = primitives::torus(0.08, 0.02, 100, 60);
            part(torus, scale, 0.0).caster(0.001).indices.len()
        };
        assert!(count(10.0) > 2 * count(1.0));
    }

    #[test]
    fn cut_out_and_small_meshes_stay_as_they_are() {
        let cut_out = part(primitives::torus(0.08, 0.02, 100, 60), 1.0, 0.5);
        assert!(Arc::ptr_eq(&cut_out.caster(0.01), &cut_out.mesh));
        let small = part(primitives::plane(1.0, 1.0), 1.0, 0.0);
        assert!(Arc::ptr_eq(&small.caster(0.01), &small.mesh));
        let empty = simplify_for_casting(&Mesh::default(), 0.1);
        assert_eq!(empty, Mesh::default());
    }
}
