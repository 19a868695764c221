//! Casts rays against the surfaces of parts: nearest hit and occlusion.
//!
//! Triangles and exact spheres are the leaves of one bounding-volume hierarchy, which the crate
//! `parry3d` builds and traverses. Boxes have single precision and are widened; hits are
//! computed in double precision, so that they do not depend on the hierarchy.

mod surfaces;

use crate::mesh::Part;
use crate::scene::Scene;
use glam::DVec3;
use parry3d::bounding_volume::Aabb;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode};
use std::cell::Cell;
use surfaces::{Sphere, Triangle, as_sphere, triangles_in_world};

pub use surfaces::sphere_hit;

/// [`Hit::surface`] of the ground plane.
pub const GROUND: u32 = u32::MAX;

/// Where a ray hits a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, in lengths of its direction.
    pub distance: f64,
    /// World, metres.
    pub point: DVec3,
    /// Unit normal of the triangle, sphere or plane, towards the ray's origin.
    pub normal: DVec3,
    /// Unit normal interpolated between the vertices, on the same side of the surface.
    pub shading_normal: DVec3,
    /// Index of the part among those that the caster was made of, or [`GROUND`].
    pub surface: u32,
    /// Whether the surface is a mirror: it looks different from every viewpoint.
    pub mirror: bool,
}

/// Surfaces that rays can hit, in the world.
#[derive(Clone, Debug, Default)]
pub struct RayCaster {
    /// Leaves: the triangles by index, then the spheres.
    bvh: Bvh,
    triangles: Vec<Triangle>,
    spheres: Vec<Sphere>,
    /// World, metres; empty if there are more than [`FEW_PARTS`].
    part_bounds: Vec<(DVec3, DVec3)>,
    /// By part.
    finishes: Vec<Finish>,
    ground: Option<Ground>,
}

/// Properties of a part that a hit reports.
#[derive(Clone, Debug)]
struct Finish {
    name: String,
    mirror: bool,
    albedo: Option<DVec3>,
}

/// The unbounded plane z = `height`.
#[derive(Clone, Copy, Debug)]
struct Ground {
    height: f64,
    albedo: Option<DVec3>,
}

impl RayCaster {
    /// Prepares the triangles of `parts` as they are.
    #[must_use]
    pub fn from_parts(parts: &[Part]) -> Self {
        let mut caster = Self::default();
        for (i, part) in parts.iter().enumerate() {
            caster.add_finish(part);
            caster.triangles.extend(triangles_in_world(part, i as u32));
        }
        caster.build();
        caster
    }

    /// Prepares the phantoms of `scene`. Tessellated spheres are hit as exact spheres, from outside
    /// only; level ground is an unbounded plane, and phantoms that lie in it (the ground's own
    /// mesh) are left out: of two coplanar surfaces either could be the nearest.
    #[must_use]
    pub fn from_phantoms(scene: &Scene) -> Self {
        let mut caster = Self {
            ground: scene.ground_height.map(|height| Ground {
                height,
                albedo: None,
            }),
            ..Self::default()
        };
        for (i, part) in scene.phantom_parts.iter().enumerate() {
            caster.add_finish(part);
            let triangles: Vec<Triangle> = triangles_in_world(part, i as u32).collect();
            if let Some(ground) = &mut caster.ground
                && lie_at(&triangles, ground.height)
            {
                ground.albedo = ground.albedo.or(part.albedo.map(|a| a.as_dvec3()));
            } else if let Some(sphere) = as_sphere(&triangles) {
                caster.spheres.push(sphere);
            } else {
                caster.triangles.extend(triangles);
            }
        }
        caster.build();
        caster
    }

    fn add_finish(&mut self, part: &Part) {
        self.finishes.push(Finish {
            name: part.name.clone(),
            mirror: part.mirror,
            albedo: part.albedo.map(|albedo| albedo.as_dvec3()),
        });
    }

    fn build(&mut self) {
        let triangles = self.triangles.iter().map(Triangle::bounds);
        let bounds: Vec<(DVec3, DVec3)> = triangles
            .chain(self.spheres.iter().map(Sphere::bounds))
            .collect();
        let largest = bounds
            .iter()
            .map(|(low, high)| low.abs().max(high.abs()).max_element())
            .fold(0.0, f64::max);
        self.part_bounds = self.part_boxes(largest * MARGIN);
        let boxes = bounds.iter().map(|b| widened(*b, largest * MARGIN));
        self.bvh = Bvh::from_iter(BvhBuildStrategy::Binned, boxes.enumerate());
    }

    /// Boxes around the triangles of each part and around the spheres; none if there are many.
    fn part_boxes(&self, margin: f64) -> Vec<(DVec3, DVec3)> {
        let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let mut parts = vec![nothing; self.finishes.len()];
        for triangle in &self.triangles {
            let (low, high) = triangle.bounds();
            if let Some(part) = parts.get_mut(triangle.surface as usize) {
                *part = (part.0.min(low), part.1.max(high));
            }
        }
        parts.retain(|(low, high)| low.cmple(*high).all());
        parts.extend(self.spheres.iter().map(Sphere::bounds));
        if parts.len() > FEW_PARTS {
            return Vec::new();
        }
        let widened = |(low, high): (DVec3, DVec3)| (low - 2.0 * margin, high + 2.0 * margin);
        parts.into_iter().map(widened).collect()
    }

    /// The name of a surface that was hit, for messages.
    #[must_use]
    pub fn name(&self, surface: u32) -> &str {
        if surface == GROUND {
            return "ground";
        }
        let part = self.finishes.get(surface as usize);
        part.map_or("", |part| &part.name)
    }

    /// The stated diffuse reflectance of a surface that was hit.
    #[must_use]
    pub fn albedo(&self, surface: u32) -> Option<DVec3> {
        if surface == GROUND {
            return self.ground?.albedo;
        }
        self.finishes.get(surface as usize)?.albedo
    }

    /// Returns the first surface that the ray from `origin` along `direction` hits. The
    /// direction may have any length but zero.
    #[must_use]
    pub fn nearest(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let ray = Ray::new(origin, direction)?;
        let ground = self.ground_hit(origin, direction);
        let limit = ground.map_or(f64::INFINITY, |hit| hit.distance * ray.length);
        let nearest: Cell<Option<(f64, u32)>> = Cell::new(None);
        self.bvh.find_best(
            rounded_up(limit),
            |node, _| ray.entry(node),
            |leaf, _| {
                let distance = self.distance_to(leaf, &ray)?;
                // Of equally distant surfaces the first: the result is the same for every tree.
                let is_nearer = match nearest.get() {
                    Some((best, at)) => distance < best || (distance == best && leaf < at),
                    None => distance < limit,
                };
                if is_nearer {
                    nearest.set(Some((distance, leaf)));
                }
                Some(rounded_up(distance))
            },
        );
        match nearest.get() {
            Some((distance, leaf)) => self.hit(leaf, distance, &ray),
            None => ground,
        }
    }

    /// Whether the ray hits anything nearer than `farthest` lengths of its direction.
    #[must_use]
    pub fn is_blocked(&self, origin: DVec3, direction: DVec3, farthest: f64) -> bool {
        let Some(ray) = Ray::new(origin, direction) else {
            return false;
        };
        let ground = self.ground_hit(origin, direction);
        if ground.is_some_and(|hit| hit.distance < farthest) {
            return true;
        }
        let limit = farthest * ray.length;
        // Few boxes tell of most rays that they meet nothing, faster than the tree does.
        let mut boxes = self.part_bounds.iter();
        if !self.part_bounds.is_empty() && !boxes.any(|b| ray.meets(b, limit)) {
            return false;
        }
        let blocked = self.bvh.find_best(
            rounded_up(limit),
            |node, _| ray.entry(node),
            |leaf, _| {
                let distance = self.distance_to(leaf, &ray)?;
                // Ends the traversal: nothing costs less.
                (distance < limit).then_some(f32::MIN)
            },
        );
        blocked.is_some()
    }

    fn ground_hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let height = self.ground?.height;
        let distance = (height - origin.z) / direction.z;
        let normal = DVec3::Z * (origin.z - height).signum();
        (distance > 0.0 && distance.is_finite()).then(|| Hit {
            distance,
            point: origin + distance * direction,
            normal,
            shading_normal: normal,
            surface: GROUND,
            mirror: false,
        })
    }

    /// Metres along the ray to the surface of a leaf.
    fn distance_to(&self, leaf: u32, ray: &Ray) -> Option<f64> {
        let leaf = leaf as usize;
        match self.triangles.get(leaf) {
            Some(triangle) => Some(triangle.crossing(ray.origin, ray.direction)?.distance),
            None => {
                let sphere = self.spheres.get(leaf - self.triangles.len())?;
                sphere_hit(sphere.centre, sphere.radius, ray.origin, ray.direction)
            }
        }
    }

    fn hit(&self, leaf: u32, distance: f64, ray: &Ray) -> Option<Hit> {
        let leaf = leaf as usize;
        let point = ray.origin + distance * ray.direction;
        let (surface, (normal, shading_normal)) = match self.triangles.get(leaf) {
            Some(t) => {
                let crossing = t.crossing(ray.origin, ray.direction)?;
                (t.surface, t.normals(&crossing, ray.direction))
            }
            None => {
                let sphere = self.spheres.get(leaf - self.triangles.len())?;
                let normal = (point - sphere.centre) / sphere.radius;
                (sphere.surface, (normal, normal))
            }
        };
        Some(Hit {
            distance: distance / ray.length,
            point,
            normal,
            shading_normal,
            surface,
            mirror: self.finishes.get(surface as usize)?.mirror,
        })
    }
}

/// Whether all triangles lie in the plane z = `height`, to within a millimetre.
fn lie_at(triangles: &[Triangle], height: f64) -> bool {
    let mut corners = triangles.iter().flat_map(Triangle::corners);
    !triangles.is_empty() && corners.all(|p| (p.z - height).abs() < 1e-3)
}

/// Boxes are widened by this share of the largest coordinate, so that no ray slips between
/// two that touch.
const MARGIN: f64 = 1e-6;
/// Number of parts up to which each has a box that is looked at before the tree.
const FEW_PARTS: usize = 12;

fn widened((low, high): (DVec3, DVec3), margin: f64) -> Aabb {
    let vector = |v: DVec3| {
        let [x, y, z] = v.as_vec3().to_array();
        parry3d::math::Vector::new(x, y, z)
    };
    Aabb::new(vector(low - margin), vector(high + margin))
}

/// The next larger value of single precision: costs of the traversal are bounds.
fn rounded_up(distance: f64) -> f32 {
    (distance as f32).next_up()
}

struct Ray {
    origin: DVec3,
    /// Unit vector.
    direction: DVec3,
    /// Reciprocals of the direction's components.
    inverse: DVec3,
    /// Length of the direction as it was given.
    length: f64,
}

impl Ray {
    /// `None` for a direction without length, and for numbers that are not finite.
    fn new(origin: DVec3, direction: DVec3) -> Option<Self> {
        let (direction, length) = (direction.try_normalize()?, direction.length());
        // A component of exactly zero would make 0 · ∞ where the origin lies on a slab.
        let safe = |x: f64| {
            if x.abs() < 1e-200 {
                1e-200_f64.copysign(x)
            } else {
                x
            }
        };
        (origin.is_finite() && length.is_finite()).then(|| Self {
            origin,
            direction,
            inverse: direction.map(safe).recip(),
            length,
        })
    }

    /// Whether the ray meets a box within `limit` metres.
    fn meets(&self, (low, high): &(DVec3, DVec3), limit: f64) -> bool {
        let (a, b) = (
            (*low - self.origin) * self.inverse,
            (*high - self.origin) * self.inverse,
        );
        let near = a.min(b).max_element().max(0.0);
        near <= limit && near <= a.max(b).min_element() * (1.0 + 8.0 * f64::EPSILON)
    }

    /// Metres to where the ray enters a node's box, rounded down; `f32::MAX` where it misses
    /// the box (slab test, Kay and Kajiya 1986).
    fn entry(&self, node: &BvhNode) -> f32 {
        let (low, high) = (node.mins(), node.maxs());
        let wide = |x: f32, y: f32, z: f32| DVec3::new(x.into(), y.into(), z.into());
        let a = (wide(low.x, low.y, low.z) - self.origin) * self.inverse;
        let b = (wide(high.x, high.y, high.z) - self.origin) * self.inverse;
        let near = a.min(b).max_element().max(0.0);
        // Widened by rounding (Ize 2013).
        let far = a.max(b).min_element() * (1.0 + 8.0 * f64::EPSILON);
        if near <= far {
            (near as f32).next_down()
        } else {
            f32::MAX
        }
    }
}

#[cfg(test)]
mod tests;
