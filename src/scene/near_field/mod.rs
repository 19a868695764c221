//! Light that virtual objects throw onto the real scene, and light from the ground that
//! they keep away from real things beside them.
//!
//! What moves is only the light: which virtual surface a real point sees, and which part of
//! the dome a virtual surface sees, is found once by ray casting. For every new state of the
//! light the surfels' radiosity follows by sums over these lists (progressive radiosity,
//! Cohen et al. 1988, on point samples; one bounce more each time), and from it the change
//! of irradiance on the ground (a grid) and in the air around the objects (a volume of
//! ambient cubes, McTaggart 2004).

mod receivers;
mod sides;
mod surfels;

use super::{Hit, Part, RayCaster, Scene};
use glam::Vec3;
use penumbra_lighting::Lighting;
use penumbra_lighting::glints::Whole;
use receivers::{GroundGrid, Volume};
use sides::Sides;
use std::f32::consts::PI;
use surfels::Surfels;

/// Texels a side of the ground's grid.
pub const GROUND_SIDE: u32 = 64;
/// Probes of the volume along x, y, z.
pub const VOLUME_SIZE: [u32; 3] = [12, 12, 8];
/// Directions in which visibility is known; one bit each.
const DIRECTIONS: usize = 128;
/// Bounces after which light from close by changes no more to be seen.
const BOUNCES: usize = 3;

/// Light from close by at one state of the light far away, scene camera units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NearLight {
    /// Counts up with every change; 0 = nothing is known yet.
    pub generation: u64,
    /// Lower corner of the region, world, metres.
    pub low: Vec3,
    /// Upper corner.
    pub high: Vec3,
    /// What virtual objects change.
    pub change: Irradiance,
    /// What phantoms throw on what is beside them, were there nothing virtual.
    pub real: Irradiance,
    /// What they throw in the light that virtual objects leave them.
    pub real_now: Irradiance,
}

/// Irradiance around the virtual objects, linear RGB.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// On the ground, row by row from the lower corner: `GROUND_SIDE`² values.
    pub ground: Vec<Vec3>,
    /// In the air, for surfaces that face +X −X +Y −Y +Z −Z: six volumes of `VOLUME_SIZE`
    /// values, x fastest.
    pub volume: [Vec<Vec3>; 6],
}

/// Radiance of the phantoms but for the ground, in the order of the scene: for each of
/// them that of the sides that face +X −X +Y −Y +Z −Z.
pub type PhantomRadiance = [[Vec3; 6]];

/// Everything that does not depend on the light.
pub struct NearField {
    surfels: Surfels,
    sides: Sides,
    ground: GroundGrid,
    volume: Volume,
    directions: Directions,
    light: NearLight,
    /// Generation of the lighting that it was found under.
    lit_by: Option<u64>,
    has_ground: bool,
}

/// The box around the virtual objects in which they matter.
#[derive(Clone, Copy, Debug)]
struct Region {
    low: Vec3,
    high: Vec3,
    /// World height of the ground.
    floor: f32,
}

impl Region {
    /// As far as the objects are wide, or half again as they are high, to every side.
    fn around(parts: &[Part], ground: Option<f64>) -> Option<Self> {
        let corners = parts.iter().flat_map(|part| {
            let place =
                |v: &super::Vertex| part.world_from_part.transform_point3(v.position.as_dvec3());
            part.mesh.vertices.iter().map(place)
        });
        let empty = (glam::DVec3::INFINITY, glam::DVec3::NEG_INFINITY);
        let (low, high) = corners.fold(empty, |(l, h), p| (l.min(p), h.max(p)));
        let (low, high) = (low.as_vec3(), high.as_vec3());
        let floor = ground.map_or(low.z, |g| g as f32);
        let size = high - low;
        let reach = size.truncate().max_element().max(1.5 * (high.z - floor));
        let usable = reach.is_finite() && reach > 0.0;
        usable.then(|| Self {
            low: Vec3::new(low.x - reach, low.y - reach, floor),
            high: Vec3::new(high.x + reach, high.y + reach, high.z + 0.3 * reach),
            floor,
        })
    }

    /// Rays begin this far off their surface, metres.
    fn off(&self) -> f32 {
        1e-4 * (self.high - self.low).max_element()
    }

    /// 1 inside, fading to 0 at the outer walls, so that no edge shows.
    fn window(&self, p: Vec3) -> f32 {
        let size = self.high - self.low;
        let to_wall = (p - self.low).min(self.high - p) / size;
        let walls = [to_wall.x, to_wall.y, (self.high.z - p.z) / size.z];
        walls
            .map(|w| (w / 0.15).clamp(0.0, 1.0))
            .into_iter()
            .product()
    }
}

/// Evenly spread directions and what comes from them.
struct Directions {
    all: Vec<Vec3>,
    /// Irradiance of all dome lights nearest to each direction, facing it.
    light: Vec<Vec3>,
}

impl Directions {
    fn new() -> Self {
        let all = spread(DIRECTIONS);
        Self {
            light: vec![Vec3::ZERO; all.len()],
            all,
        }
    }

    /// Solid angle that each stands for.
    fn solid_angle() -> f32 {
        4.0 * PI / DIRECTIONS as f32
    }

    fn nearest(&self, d: Vec3) -> usize {
        let dots = self.all.iter().map(|a| a.dot(d)).enumerate();
        dots.max_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(0, |(i, _)| i)
    }

    fn take(&mut self, lighting: &Lighting) {
        self.light.fill(Vec3::ZERO);
        for light in &lighting.lights {
            let i = self.nearest(light.direction);
            self.light[i] += light.irradiance;
        }
    }

    /// Irradiance on a surface facing `n` by what it sees.
    fn irradiance(&self, n: Vec3, seen: u128) -> Vec3 {
        let each = self.all.iter().zip(&self.light).enumerate();
        each.filter(|(i, _)| seen >> i & 1 == 1)
            .map(|(_, (d, light))| *light * n.dot(*d).max(0.0))
            .sum()
    }
}

/// The six directions of an ambient cube.
pub const AXES: [Vec3; 6] = [
    Vec3::X,
    Vec3::NEG_X,
    Vec3::Y,
    Vec3::NEG_Y,
    Vec3::Z,
    Vec3::NEG_Z,
];

/// Directions spread evenly over the sphere (a Fibonacci spiral).
fn spread(count: usize) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    let each = (0..count).map(|i| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * cos, r * sin, z)
    });
    each.collect()
}

/// Number of the direction of [`AXES`] that a normal is nearest to.
#[must_use]
pub fn side_of(n: Vec3) -> u32 {
    let axis = n.abs().max_position() as u32;
    2 * axis + u32::from(n[axis as usize] < 0.0)
}

/// The virtual casters and the phantoms but for the ground, for rays.
struct Obstacles {
    rays: RayCaster,
    real: RayCaster,
    virtual_parts: u32,
    floor: Option<f32>,
}

/// A point of a surface that a ray hits: world, metres, and its unit normal.
#[derive(Clone, Copy)]
struct SurfacePoint {
    point: Vec3,
    normal: Vec3,
}

/// What a ray meets.
enum Met {
    Virtual(SurfacePoint),
    /// Phantom side: six a phantom.
    Phantom(u32),
    Ground(Vec3),
    Sky,
}

impl Obstacles {
    fn new(scene: &Scene, casters: &[Part]) -> Self {
        let real: Vec<Part> = solid_phantoms(scene).cloned().collect();
        let parts: Vec<Part> = casters.iter().chain(&real).cloned().collect();
        Self {
            real: RayCaster::from_parts(&real),
            rays: RayCaster::from_parts(&parts),
            virtual_parts: casters.len() as u32,
            floor: scene.ground_height.map(|h| h as f32),
        }
    }

    fn meet(&self, origin: Vec3, direction: Vec3) -> Met {
        let hit = nearest(&self.rays, origin, direction);
        self.first(hit, self.virtual_parts, origin, direction)
    }

    /// What a ray meets where nothing is virtual.
    fn meet_real(&self, origin: Vec3, direction: Vec3) -> Met {
        let hit = nearest(&self.real, origin, direction);
        self.first(hit, 0, origin, direction)
    }

    /// The nearer of a hit, whose part is virtual below `virtual_parts`, and the floor.
    fn first(&self, hit: Option<Hit>, virtual_parts: u32, origin: Vec3, direction: Vec3) -> Met {
        let to_floor = self.floor.map(|f| (f - origin.z) / direction.z);
        let to_floor = to_floor.filter(|t| *t > 0.0 && direction.z < 0.0);
        match (hit, to_floor) {
            (Some(hit), t) if t.is_none_or(|t| hit.distance < f64::from(t)) => {
                let normal = hit.shading_normal.as_vec3();
                match hit.surface.checked_sub(virtual_parts) {
                    Some(part) => Met::Phantom(6 * part + side_of(normal)),
                    None => Met::Virtual(SurfacePoint {
                        point: hit.point.as_vec3(),
                        normal,
                    }),
                }
            }
            (_, Some(t)) => Met::Ground(origin + direction * t),
            _ => Met::Sky,
        }
    }

    /// The phantom side that a virtual object hides from `origin`.
    fn behind(&self, origin: Vec3, direction: Vec3) -> Option<u32> {
        let hit = nearest(&self.real, origin, direction)?;
        Some(6 * hit.surface + side_of(hit.shading_normal.as_vec3()))
    }
}

fn nearest(rays: &RayCaster, origin: Vec3, direction: Vec3) -> Option<Hit> {
    rays.nearest(origin.as_dvec3(), direction.as_dvec3())
}

/// The phantoms but for the ground.
pub fn solid_phantoms(scene: &Scene) -> impl Iterator<Item = &Part> {
    scene.phantom_parts.iter().filter(|p| p.name != "ground")
}

impl NearField {
    /// Casts all rays; `casters` are the scene's virtual parts as they cast shadows. `None`
    /// where nothing is virtual.
    #[must_use]
    pub fn new(scene: &Scene, casters: &[Part]) -> Option<Self> {
        let region = Region::around(casters, scene.ground_height)?;
        let obstacles = Obstacles::new(scene, casters);
        let directions = Directions::new();
        let surfels = Surfels::new(casters, &obstacles, &directions, &region);
        let phantoms: Vec<Part> = solid_phantoms(scene).cloned().collect();
        let sides = Sides::new(&phantoms, &surfels, &obstacles, &directions, &region);
        let ground = GroundGrid::new(&obstacles, &surfels, &directions, &region);
        let volume = Volume::new(&obstacles, &surfels, &directions, &region);
        let light = NearLight {
            low: region.low,
            high: region.high,
            ..NearLight::default()
        };
        Some(Self {
            surfels,
            sides,
            ground,
            volume,
            directions,
            light,
            lit_by: None,
            has_ground: scene.ground_height.is_some(),
        })
    }

    /// Goes on counting where that of the scene before has left off: the light of a changed scene
    /// is another one under the same lighting, too.
    pub fn follow(&mut self, before: &Self) {
        self.light.generation = before.light.generation;
    }

    /// Whether the light of `lighting` is not found yet.
    #[must_use]
    pub fn is_outdated(&self, lighting: &Lighting) -> bool {
        self.lit_by != Some(lighting.generation)
    }

    /// Finds the light from close by under `lighting` with `BOUNCES` bounces at once, for what
    /// takes the place of another in the middle of a film.
    pub fn settle(&mut self, lighting: &Lighting, phantoms: &PhantomRadiance) {
        for _ in 0..BOUNCES {
            self.lit_by = None;
            self.update(lighting, phantoms);
        }
    }

    /// Finds the light from close by under `lighting`; does nothing where it is the one of
    /// before.
    pub fn update(&mut self, lighting: &Lighting, phantoms: &PhantomRadiance) {
        if !self.is_outdated(lighting) {
            return;
        }
        self.lit_by = Some(lighting.generation);
        self.light.generation += 1;
        self.directions.take(lighting);
        let floor = if self.has_ground {
            lighting.ground_radiance
        } else {
            Vec3::ZERO
        };
        let light = Light {
            radiance: Whole::new(&lighting.radiance),
            floor,
            phantoms,
        };
        self.ground.shade(&self.directions);
        self.sides
            .shade(&self.surfels, &self.ground, &self.directions, &light);
        self.surfels
            .shade(&self.directions, &self.ground, &self.sides, &light);
        self.ground
            .lit(&self.surfels, &self.sides, &light, &mut self.light);
        self.volume.lit(
            &self.surfels,
            &self.ground,
            &self.sides,
            &self.directions,
            &light,
            &mut self.light,
        );
    }

    /// The change under the light of the last update.
    #[must_use]
    pub const fn light(&self) -> &NearLight {
        &self.light
    }
}

/// The light far away.
struct Light<'a> {
    radiance: Whole<'a>,
    /// Radiance of the ground; black where there is none.
    floor: Vec3,
    phantoms: &'a PhantomRadiance,
}

impl Light<'_> {
    /// Radiance of a phantom's side.
    fn of_phantom(&self, side: u32) -> Vec3 {
        let sides = self.phantoms.get(side as usize / 6);
        sides.map_or(Vec3::ZERO, |sides| sides[side as usize % 6])
    }

    /// Radiance that comes from the sky, blurred by about as wide a lobe.
    fn from(&self, direction: Vec3, width: f32) -> Vec3 {
        self.radiance.blurred(direction, width)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use crate::{Material, casters, primitives};
    use glam::DMat4;
    use penumbra_interface::MonotonicTime;
    use penumbra_lighting::{CubeMap, Harmonics, Lighting};
    use std::sync::Arc;

    fn field(size: f32) -> NearField {
        let part = Part {
            name: "box".into(),
            mesh: Arc::new(primitives::cuboid(Vec3::splat(size))),
            material: Arc::new(Material::default()),
            world_from_part: DMat4::IDENTITY,
            mirror: false,
            albedo: None,
        };
        let scene = Scene {
            virtual_parts: vec![part],
            ground_height: Some(0.0),
            ..Scene::default()
        };
        NearField::new(&scene, &casters(&scene)).unwrap()
    }

    fn lighting(generation: u64) -> Lighting {
        Lighting {
            captured_at: MonotonicTime::from_nanos(0),
            generation,
            radiance: Arc::new(CubeMap {
                size: 1,
                levels: vec![vec![[1.0; 3]; 6]],
                ..CubeMap::default()
            }),
            irradiance: Harmonics::default(),
            lights: Vec::new(),
            ground_radiance: Vec3::ZERO,
            faces: None,
        }
    }

    /// Whoever keeps the light by its number must take the changed scene's in place of it.
    #[test]
    fn a_changed_scene_has_another_light_under_the_same_lighting() {
        let none: &PhantomRadiance = &[];
        let mut before = field(0.1);
        before.update(&lighting(5), none);
        before.update(&lighting(5), none);
        assert_eq!(before.light().generation, 1);
        before.update(&lighting(6), none);
        assert_eq!(before.light().generation, 2);
        let mut after = field(0.2);
        after.follow(&before);
        after.update(&lighting(6), none);
        assert_eq!(after.light().generation, 3);
        assert!(after.light().high.x > before.light().high.x);
    }
}
