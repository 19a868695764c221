//! Phantoms' surfaces, divided into tiles: a virtual shadow covers only some of a side.

use super::directions::side_of;
use super::obstacles::SurfacePoint;
use super::region::bounds;
use crate::mesh::Part;
use glam::{Vec2, Vec3};

/// Number of tiles along each edge of a side.
const ACROSS: u32 = 4;
/// Number of tiles of each of a phantom's six sides.
pub(super) const TILES: u32 = ACROSS * ACROSS;

/// By phantom, the box whose six sides are divided; world, metres.
pub(super) struct Tiles(Vec<[Vec3; 2]>);

impl Tiles {
    /// Divides the surfaces of `phantoms` that lie in the box `near`.
    pub fn new(phantoms: &[Part], near: [Vec3; 2]) -> Self {
        let within = |part: &Part| {
            let [low, high] = bounds(part);
            [low.max(near[0]), high.min(near[1])]
        };
        Self(phantoms.iter().map(within).collect())
    }

    /// Index of the tile at a point: ([`TILES`] × (6 × phantom + side) + tile of the side). Points beyond
    /// the box belong to the tiles at its edge.
    pub fn tile(&self, phantom: u32, at: SurfacePoint) -> u32 {
        let side = side_of(at.normal);
        let [low, high] = self.0[phantom as usize];
        let flat = |v: Vec3| match side / 2 {
            0 => Vec2::new(v.y, v.z),
            1 => Vec2::new(v.x, v.z),
            _ => Vec2::new(v.x, v.y),
        };
        let size = flat(high - low).max(Vec2::splat(f32::MIN_POSITIVE));
        let place = flat(at.point - low) / size * ACROSS as f32;
        let [x, y] = place.to_array().map(|v| (v as u32).min(ACROSS - 1));
        TILES * (6 * phantom + side) + y * ACROSS + x
    }
}
