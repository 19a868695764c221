//! The region around the virtual objects.

use super::ground_map::GroundMap;
use crate::mesh::{Part, Vertex};
use glam::{DVec3, Vec2, Vec3};

/// Bounding box of a part; world, metres.
pub(super) fn bounds(part: &Part) -> [Vec3; 2] {
    let in_world = |v: &Vertex| part.world_from_part.transform_point3(v.position.as_dvec3());
    let corners = part.mesh.vertices.iter().map(in_world);
    let empty = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    let all = corners.fold(empty, |[low, high], p| [low.min(p), high.max(p)]);
    all.map(|p| p.as_vec3())
}

fn union(a: [Vec3; 2], b: [Vec3; 2]) -> [Vec3; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// The box around the virtual objects within which their indirect light counts; world, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Region {
    pub low: Vec3,
    pub high: Vec3,
    /// Height of the ground.
    pub floor: f32,
    /// Where places on the ground lie in its grid.
    pub on_ground: GroundMap,
    /// Bounding box of the objects.
    objects: [Vec3; 2],
    /// The box in which phantoms receive indirect light.
    pub beside_objects: [Vec3; 2],
}

/// How far light between the objects and what is around them reaches, in heights of the objects.
const NEAR: f32 = 1.5;
/// How far the objects' shadows reach, in their heights: those of a sun 22° high.
const SHADOWS: f32 = 2.5;
/// How far phantoms receive indirect light, as a share of the first: a larger box would make their grid coarser.
const BESIDE: f32 = 0.75;
/// How far the finer part of the ground reaches beyond the objects, as a share of the same.
const CONTACT: f32 = 0.15;
/// Share of the region's size at its walls over which indirect light fades.
const WALLS: f32 = 0.08;

impl Region {
    /// Extends the objects' bounding box to every side by the larger of their width and the length of their
    /// shadows. What stands near them of the phantoms `lit` by virtual lights counts like the
    /// objects; without objects, all of them. `None` without either.
    pub fn around<'a>(
        parts: &[Part],
        mut lit: impl Iterator<Item = &'a Part>,
        ground: Option<f64>,
    ) -> Option<Self> {
        let floor_below = |low: Vec3| ground.map_or(low.z, |g| g as f32);
        let objects = parts.iter().map(bounds).reduce(union);
        let objects = objects.or_else(|| lit.by_ref().map(bounds).reduce(union))?;
        let width = (objects[1] - objects[0]).truncate().max_element();
        let height = objects[1].z - floor_below(objects[0]);
        let reach = width.max(NEAR * height);
        let shadows = reach.max(SHADOWS * height);
        let [near_low, near_high] = [objects[0] - reach, objects[1] + reach];
        let near = lit
            .map(bounds)
            .map(|[low, high]| [low.max(near_low), high.min(near_high)])
            .filter(|[low, high]| low.cmple(*high).all());
        let [low, high] = near.fold(objects, union);
        let floor = floor_below(low);
        let usable = reach.is_finite() && reach > 0.0;
        usable.then(|| {
            let above = 0.3 * reach;
            let beside_objects = [
                objects[0].lerp(low - reach, BESIDE).with_z(floor),
                objects[1].lerp(high + Vec3::new(reach, reach, above), BESIDE),
            ];
            let low = Vec3::new(low.x - shadows, low.y - shadows, floor);
            let high = high + Vec3::new(shadows, shadows, above);
            let share = |p: Vec3| (p - low).truncate() / (high - low).truncate();
            let near = CONTACT * reach;
            Self {
                objects,
                low,
                high,
                floor,
                beside_objects,
                on_ground: GroundMap::new(share(objects[0] - near), share(objects[1] + near)),
            }
        })
    }

    /// The point of the ground at a place in its grid, 0 to 1.
    pub fn ground_at(&self, at: Vec2) -> Vec3 {
        let size = (self.high - self.low).truncate();
        let flat = self.low.truncate() + self.on_ground.in_region(at) * size;
        flat.extend(self.floor)
    }

    /// The point of the region at a place in the grid of the air, 0 to 1: above that on the ground.
    pub fn in_air(&self, at: Vec3) -> Vec3 {
        let flat = self.ground_at(at.truncate());
        flat.with_z(self.low.z + at.z * (self.high.z - self.low.z))
    }

    /// Distance of a ray's origin from its surface, metres.
    pub fn offset(&self) -> f32 {
        1e-4 * (self.high - self.low).max_element()
    }

    /// Weight of a point in the box about the objects: 1 about the objects, falling to 0 at the walls.
    pub fn window_beside_objects(&self, p: Vec3) -> f32 {
        let [low, high] = self.beside_objects;
        let below = (p - low) / (self.objects[0] - low).max(Vec3::splat(1e-6));
        let above = (high - p) / (high - self.objects[1]).max(Vec3::splat(1e-6));
        let walls = [below.x, below.y, above.x, above.y, above.z];
        walls
            .map(|w| (3.0 * w).clamp(0.0, 1.0))
            .into_iter()
            .product()
    }

    /// Weight of a point: 1 inside, falling to 0 at the walls, so that no edge is visible.
    pub fn window(&self, p: Vec3) -> f32 {
        let size = self.high - self.low;
        let to_wall = (p - self.low).min(self.high - p) / size;
        let walls = [to_wall.x, to_wall.y, (self.high.z - p.z) / size.z];
        walls
            .map(|w| (w / WALLS).clamp(0.0, 1.0))
            .into_iter()
            .product()
    }
}
