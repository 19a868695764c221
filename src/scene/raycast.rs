//! Rays against the phantoms on the CPU: what real surface does a camera's pixel show,
//! and does it see the light?

use super::check::triangles;
use super::{Part, Scene};
use glam::{DMat3, DMat4, Vec3};

/// Triangles in a leaf.
const LEAF: usize = 4;
/// The tree is balanced, so that even 2³² triangles stay within this depth.
const DEEPEST: usize = 40;

/// Where a ray meets a phantom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Along the ray, in lengths of its direction.
    pub distance: f32,
    /// World, metres.
    pub point: Vec3,
    /// Unit normal of the surface, interpolated, on the ray's side.
    pub normal: Vec3,
    /// Index into [`Scene::phantom_parts`]; its length where the ray meets the unbounded
    /// ground of a scene whose ground is no part.
    pub part: usize,
}

#[derive(Clone, Copy, Debug)]
struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
    normals: [Vec3; 3],
    part: u32,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// First triangle of a leaf, else the left child (the right one follows it).
    first: u32,
    /// Triangles in a leaf; 0 for an inner node.
    count: u32,
}

/// A bounding-volume hierarchy over all phantom triangles, in the world.
#[derive(Clone, Debug, Default)]
pub struct PhantomRays {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
    /// Height and part index of a ground without edges.
    endless_ground: Option<(f32, usize)>,
}

impl PhantomRays {
    /// Prepares the phantoms of a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let mut rays = Self::from_parts(&scene.phantom_parts);
        let has_part = scene.phantom_parts.iter().any(|p| p.name == "ground");
        if let Some(height) = scene.ground_height.filter(|_| !has_part) {
            rays.endless_ground = Some((height as f32, scene.phantom_parts.len()));
        }
        rays
    }

    /// Prepares any parts.
    #[must_use]
    pub fn from_parts(parts: &[Part]) -> Self {
        let mut all = Vec::new();
        for (i, part) in parts.iter().enumerate() {
            add_triangles(&mut all, part, i as u32);
        }
        let mut rays = Self {
            nodes: Vec::new(),
            triangles: all,
            endless_ground: None,
        };
        rays.build();
        rays
    }

    /// The nearest surface along the ray from `origin`; `direction` need not have unit
    /// length.
    #[must_use]
    pub fn hit(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let mut ray = Ray::new(origin, direction, f32::INFINITY);
        let mut best = None;
        self.visit(&mut ray, |triangle, distance, u, v| {
            best = Some((triangle, distance, u, v));
            false
        });
        let ground = self.ground_hit(&ray);
        let (triangle, distance, u, v) = match (best, ground) {
            (_, Some(ground)) => return Some(ground),
            (None, None) => return None,
            (Some(best), None) => best,
        };
        let [a, b, c] = triangle.normals;
        let normal = (a * (1.0 - u - v) + b * u + c * v).normalize_or(Vec3::Z);
        // Which side is seen is the flat triangle's business: at a grazing angle an
        // interpolated normal may lean away from a ray that meets the front.
        let flat = triangle.edges[0].cross(triangle.edges[1]);
        let outward = if flat.dot(normal) < 0.0 { -flat } else { flat };
        Some(Hit {
            distance,
            point: origin + direction * distance,
            normal: if outward.dot(direction) > 0.0 {
                -normal
            } else {
                normal
            },
            part: triangle.part as usize,
        })
    }

    /// Whether anything lies on the ray within `farthest` lengths of its direction.
    #[must_use]
    pub fn is_blocked(&self, origin: Vec3, direction: Vec3, farthest: f32) -> bool {
        let mut ray = Ray::new(origin, direction, farthest);
        let mut blocked = false;
        self.visit(&mut ray, |_, _, _, _| {
            blocked = true;
            true
        });
        blocked || self.ground_hit(&ray).is_some()
    }

    /// The endless ground, if it is nearer than what the ray has met so far.
    fn ground_hit(&self, ray: &Ray) -> Option<Hit> {
        let (height, part) = self.endless_ground?;
        let distance = (height - ray.origin.z) / ray.direction.z;
        (distance > 0.0 && distance < ray.farthest).then(|| Hit {
            distance,
            point: ray.origin + ray.direction * distance,
            normal: if ray.direction.z > 0.0 {
                Vec3::NEG_Z
            } else {
                Vec3::Z
            },
            part,
        })
    }

    /// Walks the tree front to back; `found` gets ever nearer triangles and ends the walk
    /// by returning true.
    fn visit<'a>(
        &'a self,
        ray: &mut Ray,
        mut found: impl FnMut(&'a Triangle, f32, f32, f32) -> bool,
    ) {
        let mut stack = [0u32; 2 * DEEPEST];
        let mut top = usize::from(!self.nodes.is_empty());
        while top > 0 {
            top -= 1;
            let Some(node) = stack.get(top).and_then(|n| self.nodes.get(*n as usize)) else {
                return;
            };
            if ray.enters(node).is_none() {
                continue;
            }
            if node.count > 0 {
                let range = node.first as usize..(node.first + node.count) as usize;
                for triangle in self.triangles.get(range).unwrap_or_default() {
                    if let Some((distance, u, v)) = ray.meets(triangle) {
                        ray.farthest = distance;
                        if found(triangle, distance, u, v) {
                            return;
                        }
                    }
                }
                continue;
            }
            let entry = |n: u32| self.nodes.get(n as usize).and_then(|n| ray.enters(n));
            let (left, right) = (node.first, node.first + 1);
            let (near, far) = match (entry(left), entry(right)) {
                (Some(l), Some(r)) if r < l => (Some(right), Some(left)),
                (l, r) => (l.map(|_| left), r.map(|_| right)),
            };
            for child in [far, near].into_iter().flatten() {
                if let Some(slot) = stack.get_mut(top) {
                    *slot = child;
                    top += 1;
                }
            }
        }
    }

    fn build(&mut self) {
        if self.triangles.is_empty() {
            return;
        }
        let count = self.triangles.len();
        self.nodes.push(enclosing(&self.triangles, 0));
        let mut waiting = vec![(0usize, 0usize, count)];
        while let Some((node, start, end)) = waiting.pop() {
            if end - start <= LEAF {
                self.nodes[node].first = start as u32;
                self.nodes[node].count = (end - start) as u32;
                continue;
            }
            let middle = usize::midpoint(start, end);
            median_split(&mut self.triangles[start..end], middle - start);
            let left = self.nodes.len();
            self.nodes[node].first = left as u32;
            self.nodes
                .push(enclosing(&self.triangles[start..middle], 0));
            self.nodes.push(enclosing(&self.triangles[middle..end], 0));
            waiting.push((left, start, middle));
            waiting.push((left + 1, middle, end));
        }
    }
}

fn add_triangles(all: &mut Vec<Triangle>, part: &Part, index: u32) {
    let world = part.world_from_part;
    let turn = normal_matrix(world);
    let place = |p: Vec3| world.transform_point3(p.as_dvec3()).as_vec3();
    let corners = part.mesh.indices.chunks_exact(3);
    for (ids, [a, b, c]) in corners.zip(triangles(&part.mesh)) {
        let [a, b, c] = [place(a), place(b), place(c)];
        let mut normals = [Vec3::Z; 3];
        for (normal, i) in normals.iter_mut().zip(ids) {
            if let Some(vertex) = part.mesh.vertices.get(*i as usize) {
                *normal = (turn * vertex.normal.as_dvec3())
                    .as_vec3()
                    .normalize_or(Vec3::Z);
            }
        }
        if a.is_finite() && b.is_finite() && c.is_finite() {
            all.push(Triangle {
                corner: a,
                edges: [b - a, c - a],
                normals,
                part: index,
            });
        }
    }
}

/// Carries normals: the inverse transpose.
fn normal_matrix(matrix: DMat4) -> DMat3 {
    let linear = DMat3::from_mat4(matrix);
    if linear.determinant() == 0.0 {
        return DMat3::IDENTITY;
    }
    linear.inverse().transpose()
}

fn bounds(t: &Triangle) -> (Vec3, Vec3) {
    let (b, c) = (t.corner + t.edges[0], t.corner + t.edges[1]);
    (t.corner.min(b).min(c), t.corner.max(b).max(c))
}

fn middle(t: &Triangle) -> Vec3 {
    t.corner + (t.edges[0] + t.edges[1]) / 3.0
}

fn enclosing(triangles: &[Triangle], first: u32) -> Node {
    let empty = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    let (low, high) = triangles
        .iter()
        .map(bounds)
        .fold(empty, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    Node {
        low,
        high,
        first,
        count: 0,
    }
}

/// Orders triangles along the axis on which their middles spread widest, so that the
/// first `at` lie before the rest.
fn median_split(triangles: &mut [Triangle], at: usize) {
    let empty = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    let (low, high) = triangles
        .iter()
        .map(middle)
        .fold(empty, |a, m| (a.0.min(m), a.1.max(m)));
    let axis = (high - low).max_position();
    triangles.select_nth_unstable_by(at, |a, b| {
        middle(a).to_array()[axis].total_cmp(&middle(b).to_array()[axis])
    });
}

struct Ray {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
    farthest: f32,
}

impl Ray {
    fn new(origin: Vec3, direction: Vec3, farthest: f32) -> Self {
        // A component of exactly zero would make 0 · ∞ where the origin lies on a slab.
        let safe = |x: f32| {
            if x.abs() < 1e-20 {
                1e-20f32.copysign(x)
            } else {
                x
            }
        };
        Self {
            origin,
            direction,
            inverse: direction.map(safe).recip(),
            farthest,
        }
    }

    /// The distance at which the ray enters a node's box (slab test, Kay & Kajiya 1986).
    fn enters(&self, node: &Node) -> Option<f32> {
        let a = (node.low - self.origin) * self.inverse;
        let b = (node.high - self.origin) * self.inverse;
        let near = a.min(b).max_element().max(0.0);
        // Widened by rounding (Ize 2013), else rays slip between boxes that touch.
        let far = a.max(b).min_element() * (1.0 + 4.0 * f32::EPSILON);
        (near <= far && near < self.farthest).then_some(near)
    }

    /// Distance and barycentric coordinates (Möller & Trumbore 1997), both sides.
    fn meets(&self, t: &Triangle) -> Option<(f32, f32, f32)> {
        let [e1, e2] = t.edges;
        let p = self.direction.cross(e2);
        let determinant = e1.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let s = self.origin - t.corner;
        let u = s.dot(p) / determinant;
        let q = s.cross(e1);
        let v = self.direction.dot(q) / determinant;
        let distance = e2.dot(q) / determinant;
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
        (inside && distance > 0.0 && distance < self.farthest).then_some((distance, u, v))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::{Material, Mesh, primitives};
    use glam::DVec3;
    use proptest::prelude::*;
    use std::sync::Arc;

    fn part(mesh: Mesh, world_from_part: DMat4) -> Part {
        Part {
            name: "p".into(),
            mesh: Arc::new(mesh),
            material: Arc::new(Material::default()),
            world_from_part,
            mirror: false,
            albedo: None,
        }
    }

    fn some_parts() -> Vec<Part> {
        let turned =
            DMat4::from_rotation_z(0.4) * DMat4::from_translation(DVec3::new(1.0, 0.5, 0.2));
        let stretched = DMat4::from_scale(DVec3::new(1.0, 2.0, -0.5));
        vec![
            part(primitives::plane(10.0, 10.0), DMat4::IDENTITY),
            part(primitives::torus(0.8, 0.2, 40, 20), turned),
            part(primitives::sphere(0.7, 24, 12), stretched),
        ]
    }

    #[test]
    fn a_plane_is_hit_where_it_lies() {
        let rays = PhantomRays::from_parts(&[part(
            primitives::plane(4.0, 4.0),
            DMat4::from_translation(DVec3::Z),
        )]);
        let hit = rays
            .hit(Vec3::new(0.5, 0.5, 3.0), Vec3::new(0.25, 0.0, -0.5))
            .unwrap();
        assert!((hit.distance - 4.0).abs() < 1e-6);
        assert!((hit.point - Vec3::new(1.5, 0.5, 1.0)).length() < 1e-6);
        assert_eq!((hit.normal, hit.part), (Vec3::Z, 0));
        // From below its other side is seen; beside it there is nothing.
        assert_eq!(rays.hit(Vec3::ZERO, Vec3::Z).unwrap().normal, Vec3::NEG_Z);
        assert!(rays.hit(Vec3::new(3.0, 0.0, 3.0), Vec3::NEG_Z).is_none());
        assert!(rays.hit(Vec3::new(0.0, 0.0, 3.0), Vec3::Z).is_none());
        assert!(
            rays.is_blocked(Vec3::ZERO, Vec3::Z, 1.01)
                && !rays.is_blocked(Vec3::ZERO, Vec3::Z, 0.99)
        );
    }

    #[test]
    fn a_stretched_sphere_has_the_normals_of_an_ellipsoid() {
        let axes = DVec3::new(1.0, 2.0, -0.5) * 0.7;
        let matrix = DMat4::from_scale(DVec3::new(1.0, 2.0, -0.5));
        let rays = PhantomRays::from_parts(&[part(primitives::sphere(0.7, 256, 128), matrix)]);
        for direction in [
            Vec3::new(1.0, 1.0, 1.0),
            Vec3::new(-1.0, 0.3, 0.2),
            Vec3::new(0.1, -1.0, -2.0),
        ] {
            let hit = rays.hit(direction * 5.0, -direction).unwrap();
            let gradient = hit.point.as_dvec3() / (axes * axes);
            let truth = gradient.normalize().as_vec3();
            assert!(hit.normal.dot(truth) > 0.9999, "{} {truth}", hit.normal);
        }
    }

    #[test]
    fn a_ground_without_edges_goes_on_for_ever() {
        let scene = Scene {
            ground_height: Some(1.0),
            phantom_parts: vec![part(
                primitives::sphere(1.0, 16, 8),
                DMat4::from_translation(DVec3::Z * 3.0),
            )],
            ..Scene::default()
        };
        let rays = PhantomRays::new(&scene);
        let far = rays.hit(Vec3::new(500.0, 0.0, 2.0), Vec3::NEG_Z).unwrap();
        assert_eq!((far.distance, far.part, far.normal), (1.0, 1, Vec3::Z));
        assert_eq!(rays.hit(Vec3::Z * 9.0, Vec3::NEG_Z).unwrap().part, 0);
        assert!(
            PhantomRays::new(&Scene::default())
                .hit(Vec3::ZERO, Vec3::X)
                .is_none()
        );
    }

    proptest! {
        #[test]
        fn the_tree_finds_what_trying_every_triangle_finds(
            o in prop::array::uniform3(-3.0f32..3.0), d in prop::array::uniform3(-1.0f32..1.0),
        ) {
            let (origin, direction) = (Vec3::from(o), Vec3::from(d));
            let rays = PhantomRays::from_parts(&some_parts());
            let mut ray = Ray::new(origin, direction, f32::INFINITY);
            for t in &rays.triangles {
                if let Some((distance, ..)) = ray.meets(t) {
                    ray.farthest = distance;
                }
            }
            let hit = rays.hit(origin, direction);
            prop_assert_eq!(hit.map_or(f32::INFINITY, |h| h.distance), ray.farthest);
            prop_assert_eq!(hit.is_some(), rays.is_blocked(origin, direction, f32::INFINITY));
            if let Some(hit) = hit {
                prop_assert!(hit.normal.is_normalized());
            }
        }

        #[test]
        fn strange_rays_never_panic(o in prop::array::uniform3(any::<f32>()), d in prop::array::uniform3(any::<f32>())) {
            let rays = PhantomRays::from_parts(&some_parts());
            let _ = rays.hit(Vec3::from(o), Vec3::from(d));
        }
    }
}
