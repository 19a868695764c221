//! Where places on the ground lie in its grid, which is finer about the virtual objects.

use super::result::GROUND_SIDE;
use glam::{Vec2, Vec3};

/// Share of the grid's side that lies on either side of the objects' own part.
const AROUND: f32 = 1.0 / 6.0;
/// Least share of the region on either side of that part.
const LEAST: f32 = 0.02;

/// Size of the first texel beside that part, of the mean of those on its side: they grow evenly from there.
const NEAREST: f32 = 0.5;

/// The part of the region about the virtual objects, on which two thirds of the grid lie each way.
/// Twin of WGSL `ground_uv`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundMap {
    /// Its lower corner, as a share of the region's size.
    low: Vec2,
    /// Its upper corner.
    high: Vec2,
}

impl Default for GroundMap {
    /// The map for the middle of the region.
    fn default() -> Self {
        Self::new(Vec2::splat(AROUND), Vec2::splat(1.0 - AROUND))
    }
}

impl GroundMap {
    /// The map for a part between these corners, as shares of the region's size.
    #[must_use]
    pub fn new(low: Vec2, high: Vec2) -> Self {
        let low = low.clamp(Vec2::splat(LEAST), Vec2::splat(1.0 - 2.0 * LEAST));
        Self {
            low,
            high: high.clamp(low + LEAST, Vec2::splat(1.0 - LEAST)),
        }
    }

    /// The corners, as shares of the region's size: lower, then upper.
    #[must_use]
    pub const fn corners(&self) -> [f32; 4] {
        [self.low.x, self.low.y, self.high.x, self.high.y]
    }

    /// The place in the grid, 0 to 1, of a place that is given as a share of the region's size.
    #[must_use]
    pub fn in_grid(&self, at: Vec2) -> Vec2 {
        let inside = (at - self.low) / (self.high - self.low);
        let before = (self.low - at).max(Vec2::ZERO) / self.low;
        let behind = (at - self.high).max(Vec2::ZERO) / (1.0 - self.high);
        // The texels before it end where it begins.
        let around = 1.0 - texels_to(before) + texels_to(behind);
        AROUND * around + (1.0 - 2.0 * AROUND) * inside.clamp(Vec2::ZERO, Vec2::ONE)
    }

    /// The value of a grid of [`GROUND_SIDE`]² texels there, interpolated; `None` if it is another one.
    #[must_use]
    pub fn value(&self, grid: &[Vec3], at: Vec2) -> Option<Vec3> {
        let side = GROUND_SIDE as usize;
        let last = (side - 1) as f32;
        let at = (self.in_grid(at) * side as f32 - 0.5).clamp(Vec2::ZERO, Vec2::splat(last));
        let low = at.as_uvec2().min(glam::UVec2::splat(GROUND_SIDE - 2));
        let part = at - low.as_vec2();
        let row = |y: usize| {
            let first = (low.y as usize + y) * side + low.x as usize;
            Some(grid.get(first)?.lerp(*grid.get(first + 1)?, part.x))
        };
        Some(row(0)?.lerp(row(1)?, part.y))
    }

    /// The inverse of [`Self::in_grid`].
    #[must_use]
    pub fn in_region(&self, at: Vec2) -> Vec2 {
        let inside = (at - AROUND) / (1.0 - 2.0 * AROUND);
        let before = (AROUND - at).max(Vec2::ZERO) / AROUND;
        let behind = (at - (1.0 - AROUND)).max(Vec2::ZERO) / AROUND;
        let inside = inside.clamp(Vec2::ZERO, Vec2::ONE);
        (1.0 - way_along(before)) * self.low
            + inside * (self.high - self.low)
            + way_along(behind) * (1.0 - self.high)
    }
}

/// The share of the way from the objects' part to the wall after a share of the texels.
fn way_along(texels: Vec2) -> Vec2 {
    texels * (NEAREST + (1.0 - NEAREST) * texels)
}

/// The inverse of [`way_along`].
fn texels_to(way: Vec2) -> Vec2 {
    let root = |way: f32| (NEAREST * NEAREST + 4.0 * (1.0 - NEAREST) * way).sqrt();
    (Vec2::new(root(way.x), root(way.y)) - NEAREST) / (2.0 * (1.0 - NEAREST))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_leads_back_and_the_middle_is_finer() {
        let map = GroundMap::new(Vec2::new(0.3, 0.4), Vec2::new(0.5, 0.8));
        for at in [0.0, 0.1, 0.35, 0.45, 0.6, 0.9, 1.0] {
            let at = Vec2::new(at, 1.0 - at);
            assert!(map.in_region(map.in_grid(at)).distance(at) < 1e-6, "{at}");
        }
        let wide = map.in_grid(Vec2::new(0.5, 0.8)) - map.in_grid(Vec2::new(0.3, 0.4));
        assert!(wide.distance(Vec2::splat(2.0 / 3.0)) < 1e-6, "{wide}");
    }

    #[test]
    fn part_as_large_as_the_region_leaves_a_rim() {
        let map = GroundMap::new(Vec2::ZERO, Vec2::ONE);
        let corner = map.in_grid(Vec2::ONE);
        assert!(corner.distance(Vec2::ONE) < 1e-6 && map.in_grid(Vec2::ZERO) == Vec2::ZERO);
    }
}
