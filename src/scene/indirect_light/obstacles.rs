//! Virtual casters, phantoms and the ground as obstacles of rays.

use super::tiles::Tiles;
use crate::mesh::Part;
use crate::raycast::{Hit, RayCaster};
use crate::scene::Scene;
use glam::Vec3;

/// A surface counts as nearer than the ground from this share of the distance to the ground: a
/// phantom that lies in the ground is the ground, in spite of rounding.
const NEARER: f64 = 1.0 - 1e-5;

/// Virtual casters, phantoms and the ground.
pub(super) struct Obstacles {
    /// Virtual casters, then the phantoms without the ground.
    all: RayCaster,
    /// The phantoms without the ground.
    real: RayCaster,
    virtual_parts: u32,
    /// Of the phantoms without the ground.
    pub tiles: Tiles,
    /// Height of the ground, metres.
    pub floor: Option<f32>,
}

/// A point of a surface: world, metres, and its unit normal.
#[derive(Clone, Copy)]
pub(super) struct SurfacePoint {
    pub point: Vec3,
    pub normal: Vec3,
}

/// What a ray hits first.
pub(super) enum FirstHit {
    Virtual(SurfacePoint),
    /// Index of a tile of a phantom's surface, see [`Tiles`].
    Phantom(u32),
    Ground(Vec3),
    Sky,
}

/// What blocks the way of light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sight {
    /// Nothing.
    Open,
    /// Virtual objects alone.
    BehindVirtual,
    /// The ground or a phantom, or the surface faces away.
    Hidden,
}

impl Obstacles {
    /// `near`: the box in which phantoms' surfaces are divided; world, metres.
    pub fn new(scene: &Scene, casters: &[Part], near: [Vec3; 2]) -> Self {
        let real: Vec<Part> = solid_phantoms(scene).cloned().collect();
        let parts: Vec<Part> = casters.iter().chain(&real).cloned().collect();
        Self {
            real: RayCaster::from_parts(&real),
            all: RayCaster::from_parts(&parts),
            virtual_parts: casters.len() as u32,
            tiles: Tiles::new(&real, near),
            floor: scene.ground_height.map(|h| h as f32),
        }
    }

    /// Returns what a ray hits first.
    pub fn first_hit(&self, origin: Vec3, direction: Vec3) -> FirstHit {
        let hit = nearest(&self.all, origin, direction);
        self.nearer_of(hit, self.virtual_parts, origin, direction)
    }

    /// Returns what a ray hits first where there are no virtual objects.
    pub fn first_real_hit(&self, origin: Vec3, direction: Vec3) -> FirstHit {
        let hit = nearest(&self.real, origin, direction);
        self.nearer_of(hit, 0, origin, direction)
    }

    /// The nearer of the ground and `hit`, whose part is virtual if its index is less than
    /// `virtual_parts`.
    fn nearer_of(
        &self,
        hit: Option<Hit>,
        virtual_parts: u32,
        origin: Vec3,
        direction: Vec3,
    ) -> FirstHit {
        let to_floor = self.floor.map(|f| (f - origin.z) / direction.z);
        let to_floor = to_floor.filter(|t| *t > 0.0 && direction.z < 0.0);
        match (hit, to_floor) {
            (Some(hit), t) if t.is_none_or(|t| hit.distance < NEARER * f64::from(t)) => {
                let at = SurfacePoint {
                    point: hit.point.as_vec3(),
                    normal: hit.shading_normal.as_vec3(),
                };
                match hit.surface.checked_sub(virtual_parts) {
                    Some(part) => FirstHit::Phantom(self.tiles.tile(part, at)),
                    None => FirstHit::Virtual(at),
                }
            }
            (_, Some(t)) => FirstHit::Ground(origin + direction * t),
            _ => FirstHit::Sky,
        }
    }

    /// What blocks a ray to the sky.
    pub fn sight_along(&self, origin: Vec3, direction: Vec3) -> Sight {
        if self.floor.is_some() && direction.z < 0.0 {
            return Sight::Hidden;
        }
        self.sight(origin, direction, f64::INFINITY)
    }

    /// What is between two points.
    pub fn sight_of(&self, from: Vec3, to: Vec3) -> Sight {
        if self.is_across_floor(from, to) {
            return Sight::Hidden;
        }
        self.sight(from, to - from, NEARER)
    }

    fn sight(&self, origin: Vec3, way: Vec3, farthest: f64) -> Sight {
        let (origin, way) = (origin.as_dvec3(), way.as_dvec3());
        if !self.all.is_blocked(origin, way, farthest) {
            Sight::Open
        } else if self.real.is_blocked(origin, way, farthest) {
            Sight::Hidden
        } else {
            Sight::BehindVirtual
        }
    }

    fn is_across_floor(&self, from: Vec3, to: Vec3) -> bool {
        let is_below = |p: Vec3| self.floor.is_some_and(|f| p.z < f);
        is_below(from) != is_below(to)
    }

    /// Whether nothing is between two points.
    pub fn is_clear(&self, from: Vec3, to: Vec3) -> bool {
        let way = (to - from).as_dvec3();
        !self.is_across_floor(from, to) && !self.all.is_blocked(from.as_dvec3(), way, NEARER)
    }

    /// Returns the tile of a phantom that a virtual object may hide from `origin`.
    pub fn hidden_tile(&self, origin: Vec3, direction: Vec3) -> Option<u32> {
        let hit = nearest(&self.real, origin, direction)?;
        let at = SurfacePoint {
            point: hit.point.as_vec3(),
            normal: hit.shading_normal.as_vec3(),
        };
        Some(self.tiles.tile(hit.surface, at))
    }
}

fn nearest(rays: &RayCaster, origin: Vec3, direction: Vec3) -> Option<Hit> {
    rays.nearest(origin.as_dvec3(), direction.as_dvec3())
}

/// Returns the phantoms without the ground.
pub fn solid_phantoms(scene: &Scene) -> impl Iterator<Item = &Part> {
    scene.phantom_parts.iter().filter(|p| p.name != "ground")
}
