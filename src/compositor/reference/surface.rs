//! The visible surface of a pixel, and the lights that reach it.

use super::super::mesh_buffers::is_ground;
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_lighting::DomeLight;
use penumbra_scene::{Hit, Part, RayCaster, Scene};
use std::hash::{DefaultHasher, Hash, Hasher};

/// Offset of a shadow ray's start from its surface, metres: above the rounding of `f32` at arm's
/// length, below the size of any tested detail.
const LIFT: f32 = 1e-4;

/// The kind of surface that a pixel shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Seen {
    /// No surface of the scene.
    Camera,
    /// A real surface.
    Phantom,
    /// A virtual surface.
    Virtual,
}

/// A scene, prepared for ray casting.
pub struct Reference {
    phantoms: RayCaster,
    phantom_casters: RayCaster,
    virtual_parts: RayCaster,
    parts: (Vec<Part>, Vec<Part>),
    pub(super) has_ground: bool,
    rays_per_light: u32,
}

/// The surface behind a pixel.
pub(super) struct Surface {
    pub seen: Seen,
    part: usize,
    pub point: Vec3,
    pub normal: DVec3,
    pub diffuse: DVec3,
    pub emissive: DVec3,
    pub mirror: bool,
    /// Diffuse reflectance of a real surface; white if unknown.
    pub albedo: DVec3,
}

/// Fractions of a light's disc, 0..=1, that a surface sees past the casters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Visibility {
    pub past_phantoms: f64,
    pub past_virtual: f64,
    pub past_both: f64,
}

impl Visibility {
    const FULL: Self = Self {
        past_phantoms: 1.0,
        past_virtual: 1.0,
        past_both: 1.0,
    };
}

impl Reference {
    /// Prepares a scene. As in the compositor, the ground receives shadows and casts none.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let solid: Vec<Part> = scene
            .phantom_parts
            .iter()
            .filter(|p| !is_ground(p, scene))
            .cloned()
            .collect();
        Self {
            phantoms: RayCaster::from_parts(&scene.phantom_parts),
            phantom_casters: RayCaster::from_parts(&solid),
            virtual_parts: RayCaster::from_parts(&scene.virtual_parts),
            parts: (scene.phantom_parts.clone(), scene.virtual_parts.clone()),
            has_ground: scene.ground_height.is_some(),
            rays_per_light: 1,
        }
    }

    /// Sets the number of rays to each light, distributed over its disc; 1, the default, goes to
    /// its centre, as for hard shadows.
    #[must_use]
    pub fn with_rays(self, rays_per_light: u32) -> Self {
        Self {
            rays_per_light,
            ..self
        }
    }

    pub(super) fn surface(
        &self,
        (x, y): (u32, u32),
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        with_virtual: bool,
    ) -> Option<Surface> {
        let eye = world_from_camera.translation;
        let ray = camera.unproject(DVec2::new(f64::from(x), f64::from(y)));
        let direction = world_from_camera.rotation * ray;
        let real_hit = self.phantoms.nearest(eye, direction);
        let virtual_hit = self
            .virtual_parts
            .nearest(eye, direction)
            .filter(|_| with_virtual);
        let nearer = match (&real_hit, &virtual_hit) {
            (Some(real), Some(virtual_hit)) => virtual_hit.distance <= real.distance,
            (None, Some(_)) => true,
            _ => false,
        };
        if nearer {
            virtual_hit.map(|hit| described(Seen::Virtual, hit, &self.parts.1))
        } else {
            real_hit.map(|hit| described(Seen::Phantom, hit, &self.parts.0))
        }
    }

    /// Returns the visibility of each light; lights behind the surface count as visible, which
    /// makes no difference.
    pub(super) fn visibility(&self, surface: &Surface, lights: &[DomeLight]) -> Vec<Visibility> {
        let normal = surface.normal.as_vec3();
        lights
            .iter()
            .map(|light| {
                if normal.dot(light.towards(surface.point)) <= 0.0 {
                    Visibility::FULL
                } else {
                    self.visibility_of(surface.point + normal * LIFT, light)
                }
            })
            .collect()
    }

    /// Whether nothing blocks the path from a surface to a point `distance` metres along `to`.
    pub(super) fn sees(&self, surface: &Surface, to: Vec3, distance: f32) -> bool {
        let from = surface.point + surface.normal.as_vec3() * LIFT;
        let (from, to) = (from.as_dvec3(), to.as_dvec3());
        let free = |rays: &RayCaster| !rays.is_blocked(from, to, distance.into());
        free(&self.phantom_casters) && free(&self.virtual_parts)
    }

    fn visibility_of(&self, from: Vec3, light: &DomeLight) -> Visibility {
        let farthest = if light.place.is_far() {
            f64::INFINITY
        } else {
            1.0
        };
        let (mut phantoms, mut virtuals, mut both) = (0, 0, 0);
        for k in 0..self.rays_per_light {
            let towards = point_of_disc(light, from, k, self.rays_per_light).as_dvec3();
            let free = |rays: &RayCaster| !rays.is_blocked(from.as_dvec3(), towards, farthest);
            let (open_real, open_virtual) =
                (free(&self.phantom_casters), free(&self.virtual_parts));
            phantoms += u32::from(open_real);
            virtuals += u32::from(open_virtual);
            both += u32::from(open_real && open_virtual);
        }
        let share = |count: u32| f64::from(count) / f64::from(self.rays_per_light);
        Visibility {
            past_phantoms: share(phantoms),
            past_virtual: share(virtuals),
            past_both: share(both),
        }
    }
}

/// The `k`-th of `count` vectors from a point that are distributed evenly over a light's disc (Vogel
/// 1979), in units of its distance from its reference.
fn point_of_disc(light: &DomeLight, from: Vec3, k: u32, count: u32) -> Vec3 {
    let centre = light.towards(from);
    if count == 1 {
        return centre;
    }
    let (right, up) = light.direction.any_orthonormal_pair();
    let radius = light.angular_radius.tan() * ((k as f32 + 0.5) / count as f32).sqrt();
    let (sin, cos) = (2.399_963_2 * k as f32).sin_cos();
    centre + (right * cos + up * sin) * radius
}

fn described(seen: Seen, hit: Hit, parts: &[Part]) -> Surface {
    let mut surface = Surface {
        seen,
        part: hit.surface as usize,
        point: hit.point.as_vec3(),
        normal: hit.shading_normal,
        diffuse: DVec3::ZERO,
        emissive: DVec3::ZERO,
        mirror: false,
        albedo: DVec3::ONE,
    };
    if let Some(part) = parts.get(hit.surface as usize) {
        let m = &part.material;
        let metallic = if m.phong.is_some() { 0.0 } else { m.metallic };
        surface.diffuse = m.base_colour.truncate().as_dvec3() * f64::from(1.0 - metallic);
        surface.emissive = m.emissive.as_dvec3();
        surface.mirror = part.mirror;
        surface.albedo = part.albedo.unwrap_or(Vec3::ONE).as_dvec3();
    }
    surface
}

pub(super) fn footprint(
    surface: &Surface,
    visibility: &[Visibility],
    lamps: impl Iterator<Item = bool>,
) -> u64 {
    let mut hasher = DefaultHasher::new();
    (surface.seen, surface.part).hash(&mut hasher);
    for light in visibility {
        let shares = [light.past_phantoms, light.past_virtual, light.past_both];
        shares.map(f64::to_bits).hash(&mut hasher);
    }
    lamps.for_each(|seen| seen.hash(&mut hasher));
    hasher.finish()
}
