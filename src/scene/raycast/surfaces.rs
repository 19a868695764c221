//! Triangles and spheres, intersected in double precision.

use crate::mesh::Part;
use glam::{DMat3, DMat4, DVec3, Vec3};

/// A triangle in the world.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    corner: DVec3,
    edges: [DVec3; 2],
    /// At the corners, unit length.
    normals: [Vec3; 3],
    /// Index of its part.
    pub surface: u32,
}

/// A sphere in the world, in place of the triangles that approximate it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sphere {
    /// Metres.
    pub centre: DVec3,
    /// Metres.
    pub radius: f64,
    /// Index of its part.
    pub surface: u32,
}

/// Where a ray crosses a triangle: distance in lengths of its direction, and the barycentric
/// coordinates of the second and third corner.
pub(super) struct Crossing {
    pub distance: f64,
    u: f64,
    v: f64,
}

/// Nearer crossings than this belong to the surface from which the ray starts.
const MIN_DISTANCE: f64 = 1e-9;
/// Coarser meshes than this are no spheres, even with all corners on a sphere (a cube).
const MIN_SPHERE_TRIANGLES: usize = 200;

/// The triangles of a part in the world. Those with invalid indices or without finite corners
/// are left out.
pub(super) fn triangles_in_world(part: &Part, surface: u32) -> impl Iterator<Item = Triangle> {
    let world = part.world_from_part;
    let normal_from_part = normal_matrix(world);
    part.mesh.indices.chunks_exact(3).filter_map(move |ids| {
        let vertex = |i: usize| part.mesh.vertices.get(ids[i] as usize);
        let vertices = [vertex(0)?, vertex(1)?, vertex(2)?];
        let [a, b, c] = vertices.map(|v| world.transform_point3(v.position.as_dvec3()));
        let is_finite = a.is_finite() && b.is_finite() && c.is_finite();
        is_finite.then(|| Triangle {
            corner: a,
            edges: [b - a, c - a],
            normals: vertices.map(|v| {
                let normal = normal_from_part * v.normal.as_dvec3();
                normal.as_vec3().normalize_or(Vec3::Z)
            }),
            surface,
        })
    })
}

/// Transforms normals: the inverse transpose.
fn normal_matrix(matrix: DMat4) -> DMat3 {
    let linear = DMat3::from_mat4(matrix);
    if linear.determinant() == 0.0 {
        return DMat3::IDENTITY;
    }
    linear.inverse().transpose()
}

impl Triangle {
    pub fn corners(&self) -> [DVec3; 3] {
        [
            self.corner,
            self.corner + self.edges[0],
            self.corner + self.edges[1],
        ]
    }

    /// The corners of its bounding box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let [a, b, c] = self.corners();
        (a.min(b).min(c), a.max(b).max(c))
    }

    /// Where the ray crosses it, from either side (Möller and Trumbore 1997).
    pub fn crossing(&self, origin: DVec3, direction: DVec3) -> Option<Crossing> {
        let [e1, e2] = self.edges;
        let p = direction.cross(e2);
        let determinant = e1.dot(p);
        let s = origin - self.corner;
        let u = s.dot(p) / determinant;
        let q = s.cross(e1);
        let v = direction.dot(q) / determinant;
        let distance = e2.dot(q) / determinant;
        // Comparisons with the NaN of a degenerate triangle are false.
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        (inside && distance > MIN_DISTANCE).then_some(Crossing { distance, u, v })
    }

    /// The triangle's own unit normal and the interpolated one, both on the side from which
    /// a ray along `direction` comes.
    pub fn normals(&self, crossing: &Crossing, direction: DVec3) -> (DVec3, DVec3) {
        let own = self.edges[0].cross(self.edges[1]).normalize_or_zero();
        let own = -own * own.dot(direction).signum();
        let (u, v) = (crossing.u as f32, crossing.v as f32);
        let [a, b, c] = self.normals;
        let between = (a * (1.0 - u - v) + b * u + c * v).normalize_or(Vec3::Z);
        let between = between.as_dvec3();
        // At a grazing angle the interpolated normal may lean away from a ray that meets the
        // front: the triangle's own normal decides on the side.
        let side = if between.dot(own) < 0.0 {
            -between
        } else {
            between
        };
        (own, side)
    }
}

/// Returns the sphere that `triangles` approximate; `None` unless all corners lie on a sphere.
pub(super) fn as_sphere(triangles: &[Triangle]) -> Option<Sphere> {
    let points = || triangles.iter().flat_map(Triangle::corners);
    let (low, high) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
        (low.min(p), high.max(p))
    });
    let centre = 0.5 * (low + high);
    let radius = points().map(|p| p.distance(centre)).fold(0.0, f64::max);
    let is_on_sphere = |p: DVec3| p.distance(centre) > 0.99 * radius;
    let is_sphere = triangles.len() > MIN_SPHERE_TRIANGLES && points().all(is_on_sphere);
    is_sphere.then_some(Sphere {
        centre,
        radius,
        surface: triangles.first()?.surface,
    })
}

impl Sphere {
    /// The corners of its bounding box.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.centre - self.radius, self.centre + self.radius)
    }
}

/// Distance to the near side of a sphere, metres, for a ray from outside along the unit vector
/// `direction`.
#[must_use]
pub fn sphere_hit(centre: DVec3, radius: f64, origin: DVec3, direction: DVec3) -> Option<f64> {
    let to_centre = centre - origin;
    let along = to_centre.dot(direction);
    let miss = to_centre.length_squared() - along * along;
    let distance = along - (radius * radius - miss).sqrt();
    (distance > 0.0).then_some(distance)
}
