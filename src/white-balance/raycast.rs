//! Which real surface a ray meets first: the ground and the phantom objects.

use glam::DVec3;
use penumbra_scene::{Part, Scene};

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceHit {
    /// From the ray's origin, in lengths of its direction.
    pub distance: f64,
    /// In the world, metres.
    pub point: DVec3,
    /// Unit normal, towards the origin of the ray.
    pub normal: DVec3,
    /// Tells surfaces apart; equal for hits on one object.
    pub surface: u32,
    /// The surface mirrors, so that it looks different from everywhere.
    pub mirror: bool,
}

/// [`SurfaceHit::surface`] of the ground.
pub const GROUND: u32 = u32::MAX;

/// Rays that see only a ground plane z = `height`.
pub fn ground_only(height: f64) -> impl Fn(DVec3, DVec3) -> Option<SurfaceHit> {
    move |origin, direction| ground_hit(height, origin, direction)
}

/// Where a ray meets the plane z = `height`.
#[must_use]
pub fn ground_hit(height: f64, origin: DVec3, direction: DVec3) -> Option<SurfaceHit> {
    let distance = (height - origin.z) / direction.z;
    (distance > 0.0 && distance.is_finite()).then(|| SurfaceHit {
        distance,
        point: origin + distance * direction,
        normal: DVec3::Z * (origin.z - height).signum(),
        surface: GROUND,
        mirror: false,
    })
}

/// Distance to a sphere's near side, for a unit direction from outside.
#[must_use]
pub fn sphere_hit(centre: DVec3, radius: f64, origin: DVec3, direction: DVec3) -> Option<f64> {
    let to_centre = centre - origin;
    let along = to_centre.dot(direction);
    let miss = to_centre.length_squared() - along * along;
    let distance = along - (radius * radius - miss).sqrt();
    (distance > 0.0).then_some(distance)
}

/// The phantoms of a scene, ready for rays.
#[derive(Clone, Debug, Default)]
pub struct PhantomCaster {
    parts: Vec<CastPart>,
    ground_height: Option<f64>,
    ground_albedo: Option<DVec3>,
}

#[derive(Clone, Debug)]
struct CastPart {
    centre: DVec3,
    radius: f64,
    triangles: Vec<[DVec3; 3]>,
    /// All corners lie on a sphere: it is met exactly, and faster than its triangles.
    ball: bool,
    mirror: bool,
    albedo: Option<DVec3>,
}

impl PhantomCaster {
    /// Takes the phantoms and the ground as they stand now.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let parts = scene.phantom_parts.iter().map(CastPart::new);
        // The ground is in the list as a mesh too; two surfaces in one plane would take
        // turns in being nearest.
        let is_ground = |part: &CastPart| scene.ground_height.is_some_and(|h| part.lies_at(h));
        let (grounds, parts): (Vec<_>, Vec<_>) = parts.partition(is_ground);
        Self {
            parts,
            ground_height: scene.ground_height,
            ground_albedo: grounds.iter().find_map(|part| part.albedo),
        }
    }

    /// The stated diffuse reflectance of a surface that was hit.
    #[must_use]
    pub fn albedo(&self, surface: u32) -> Option<DVec3> {
        if surface == GROUND {
            return self.ground_albedo;
        }
        self.parts.get(surface as usize)?.albedo
    }

    /// The nearest surface along a ray.
    #[must_use]
    pub fn cast(&self, origin: DVec3, direction: DVec3) -> Option<SurfaceHit> {
        let ground = self
            .ground_height
            .and_then(|height| ground_hit(height, origin, direction));
        let hits = self.parts.iter().enumerate();
        let hits = hits.filter_map(|(i, part)| part.hit(i as u32, origin, direction));
        hits.chain(ground)
            .min_by(|a, b| a.distance.total_cmp(&b.distance))
    }
}

impl CastPart {
    fn new(part: &Part) -> Self {
        let place = |&index: &u32| {
            let vertex = part.mesh.vertices.get(index as usize)?;
            Some(
                part.world_from_part
                    .transform_point3(vertex.position.as_dvec3()),
            )
        };
        let corners = part.mesh.indices.chunks_exact(3);
        let triangles: Vec<[DVec3; 3]> = corners
            .filter_map(|c| Some([place(&c[0])?, place(&c[1])?, place(&c[2])?]))
            .collect();
        let points = || triangles.iter().flatten();
        let (low, high) = points()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                (low.min(*p), high.max(*p))
            });
        let centre = 0.5 * (low + high);
        let radius = points().map(|p| p.distance(centre)).fold(0.0, f64::max);
        let on_sphere = |p: &DVec3| p.distance(centre) > 0.99 * radius;
        Self {
            centre,
            radius,
            ball: triangles.len() > MIN_BALL_TRIANGLES && points().all(on_sphere),
            triangles,
            mirror: part.mirror,
            albedo: part.albedo.map(|albedo| albedo.as_dvec3()),
        }
    }

    fn lies_at(&self, height: f64) -> bool {
        let mut points = self.triangles.iter().flatten();
        points.all(|p| (p.z - height).abs() < 1e-3)
    }

    /// The ray's line misses the ball around the part, or leaves it behind.
    fn out_of_reach(&self, origin: DVec3, direction: DVec3) -> bool {
        let to_centre = self.centre - origin;
        let reach = self.radius * self.radius;
        let miss = to_centre.cross(direction).length_squared() / direction.length_squared();
        let behind = to_centre.dot(direction) < 0.0 && to_centre.length_squared() >= reach;
        self.triangles.is_empty() || miss > reach || behind
    }

    fn hit(&self, surface: u32, origin: DVec3, direction: DVec3) -> Option<SurfaceHit> {
        if self.out_of_reach(origin, direction) {
            return None;
        }
        if self.ball {
            return self.ball_hit(surface, origin, direction);
        }
        let hits = self.triangles.iter();
        let hits = hits.filter_map(|t| Some((triangle_hit(t, origin, direction)?, t)));
        let (distance, [a, b, c]) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Some(SurfaceHit {
            distance,
            point: origin + distance * direction,
            normal: -normal * normal.dot(direction).signum(),
            surface,
            mirror: self.mirror,
        })
    }
}

impl CastPart {
    fn ball_hit(&self, surface: u32, origin: DVec3, direction: DVec3) -> Option<SurfaceHit> {
        let length = direction.length();
        let distance = sphere_hit(self.centre, self.radius, origin, direction / length)? / length;
        let point = origin + distance * direction;
        Some(SurfaceHit {
            distance,
            point,
            normal: (point - self.centre) / self.radius,
            surface,
            mirror: self.mirror,
        })
    }
}

/// Coarser meshes than this are no spheres, even with all corners on one (a cube).
const MIN_BALL_TRIANGLES: usize = 200;

/// Distance to a triangle from either side (Möller & Trumbore 1997).
fn triangle_hit([a, b, c]: &[DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(e2);
    let determinant = e1.dot(p);
    let t = origin - a;
    let u = t.dot(p) / determinant;
    let q = t.cross(e1);
    let v = direction.dot(q) / determinant;
    let distance = e2.dot(q) / determinant;
    // Comparisons with the NaN of a degenerate triangle are false.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 1e-9).then_some(distance)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

    use super::*;
    use glam::{DMat4, Vec2, Vec3, Vec4};
    use penumbra_scene::{Material, Mesh, Vertex};
    use std::sync::Arc;

    /// A square of side 2 about the origin, in z = 0, moved by `world_from_part`.
    fn square(world_from_part: DMat4, mirror: bool) -> Part {
        let corner = |x: f32, y: f32| Vertex {
            position: Vec3::new(x, y, 0.0),
            normal: Vec3::Z,
            uv: Vec2::ZERO,
            tangent: Vec4::ZERO,
        };
        let vertices = vec![
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ];
        Part {
            name: "square".into(),
            mesh: Arc::new(Mesh {
                vertices,
                indices: vec![0, 1, 2, 0, 2, 3, 0, 9, 1],
            }),
            material: Arc::new(Material::default()),
            world_from_part,
            mirror,
            albedo: None,
        }
    }

    #[test]
    fn the_nearest_surface_wins() {
        let mut ground = square(DMat4::from_scale(DVec3::splat(9.0)), false);
        ground.albedo = Some(Vec3::new(0.5, 0.25, 0.125));
        let scene = Scene {
            virtual_parts: Vec::new(),
            phantom_parts: vec![
                square(DMat4::from_translation(DVec3::new(0.0, 0.0, 1.0)), false),
                square(DMat4::from_translation(DVec3::new(0.0, 0.0, 2.0)), true),
                ground,
            ],
            ground_height: Some(0.0),
            ..Scene::default()
        };
        let caster = PhantomCaster::new(&scene);
        let from_above = caster
            .cast(DVec3::new(0.3, 0.2, 5.0), DVec3::NEG_Z)
            .unwrap();
        assert_eq!((from_above.surface, from_above.mirror), (1, true));
        assert!((from_above.distance - 3.0).abs() < 1e-12);
        assert_eq!(from_above.normal, DVec3::Z);
        let from_between = caster.cast(DVec3::new(0.3, 0.2, 1.5), DVec3::Z).unwrap();
        assert_eq!(from_between.surface, 1);
        assert_eq!(from_between.normal, DVec3::NEG_Z);
        let beside = caster
            .cast(DVec3::new(1.3, 0.2, 5.0), DVec3::NEG_Z)
            .unwrap();
        assert_eq!((beside.surface, beside.point.z), (GROUND, 0.0));
        assert_eq!(caster.cast(DVec3::new(1.3, 0.2, 5.0), DVec3::Z), None);
        assert_eq!(caster.cast(DVec3::new(0.0, 0.0, 5.0), DVec3::X), None);
        assert_eq!(caster.albedo(GROUND), Some(DVec3::new(0.5, 0.25, 0.125)));
        assert_eq!(caster.albedo(0), None);
        assert_eq!(caster.albedo(7), None);
    }

    #[test]
    fn a_meshed_ball_is_met_as_a_sphere() {
        let mut ball = square(DMat4::from_translation(DVec3::new(0.0, 0.0, 3.0)), true);
        ball.mesh = Arc::new(penumbra_scene::primitives::sphere(0.5, 48, 24));
        let scene = Scene {
            phantom_parts: vec![ball],
            ..Scene::default()
        };
        let caster = PhantomCaster::new(&scene);
        let origin = DVec3::new(0.25, 0.0, 0.0);
        let hit = caster.cast(origin, DVec3::Z).unwrap();
        let height = 3.0 - (0.25f64 - 0.0625).sqrt();
        assert!((hit.point.z - height).abs() < 1e-6 && hit.mirror);
        assert!((hit.normal.x - 0.5).abs() < 1e-6);
        // A ray that starts on its surface leaves it.
        assert_eq!(caster.cast(hit.point, hit.normal), None);
    }

    #[test]
    fn a_sphere_is_met_on_its_near_side() {
        let hit = sphere_hit(DVec3::new(0.0, 0.0, 5.0), 1.0, DVec3::ZERO, DVec3::Z);
        assert_eq!(hit, Some(4.0));
        assert_eq!(
            sphere_hit(DVec3::new(0.0, 2.0, 5.0), 1.0, DVec3::ZERO, DVec3::Z),
            None
        );
        assert_eq!(
            sphere_hit(DVec3::new(0.0, 0.0, -5.0), 1.0, DVec3::ZERO, DVec3::Z),
            None
        );
    }
}
