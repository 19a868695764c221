//! The distant light, and what the ground and the sides of phantoms reflect in the presence of
//! virtual objects and virtual lights, as shares of what they reflect without.

use super::region::Region;
use super::result::{GROUND_SIDE, PhantomRadiance};
use super::tiles::TILES;
use glam::{UVec2, Vec3};
use penumbra_lighting::compact_source_specular::CompleteMap;

/// Light from the environment and from real surfaces, without virtual objects.
pub(super) struct DistantLight<'a> {
    pub radiance: CompleteMap<'a>,
    /// Mean radiance of the ground; black where there is none.
    pub mean_ground: Vec3,
    /// Radiance from below that the light of the sky counts already.
    pub below: Vec3,
    /// Radiance of the ground, by texel.
    pub ground: &'a [Vec3],
    pub phantoms: &'a PhantomRadiance,
}

impl DistantLight<'_> {
    /// Radiance of a ground texel; the mean outside the grid.
    pub fn ground_radiance(&self, texel: u32) -> Vec3 {
        (self.ground.get(texel as usize)).map_or(self.mean_ground, |radiance| *radiance)
    }

    /// Radiance of a ground texel in the presence of the virtual objects.
    pub fn ground_now(&self, texel: u32, shares: &GroundShares) -> Vec3 {
        self.ground_radiance(texel) * shares.share(texel)
    }

    /// Radiance of a phantom's tile: that of its side.
    pub fn phantom_radiance(&self, tile: u32) -> Vec3 {
        let side = tile / TILES;
        let sides = self.phantoms.get(side as usize / 6);
        sides.map_or(Vec3::ZERO, |sides| sides[side as usize % 6])
    }

    /// Radiance of the sky that a surface (point, unit normal) mirrors from `direction`, blurred by a lobe of about
    /// `width`, lamps by one of at least `least`.
    pub fn sky_radiance(&self, at: (Vec3, Vec3), direction: Vec3, width: f32, least: f32) -> Vec3 {
        self.radiance.mirrored(at, direction, width, least)
    }
}

/// Ratio of the irradiance on each ground texel, with virtual objects and virtual lights, to that of
/// the unshadowed dome.
pub(super) struct GroundShares(pub Vec<Vec3>);

impl GroundShares {
    /// 1 outside the grid.
    pub fn share(&self, texel: u32) -> Vec3 {
        self.0.get(texel as usize).copied().unwrap_or(Vec3::ONE)
    }
}

/// Index of the ground texel at a point; `u32::MAX` outside the grid.
pub(super) fn ground_texel(region: &Region, p: Vec3) -> u32 {
    let at = (p - region.low).truncate() / (region.high - region.low).truncate();
    if at.min_element() < 0.0 || at.max_element() >= 1.0 {
        return u32::MAX;
    }
    let at = region.on_ground.in_grid(at) * GROUND_SIDE as f32;
    let cell = at.as_uvec2().min(UVec2::splat(GROUND_SIDE - 1));
    cell.y * GROUND_SIDE + cell.x
}

/// Ratio of the irradiance on each tile of the phantoms to that without virtual objects.
pub(super) struct TileShares(pub Vec<Vec3>);

impl TileShares {
    /// 1 for an unknown tile.
    fn share(&self, tile: u32) -> Vec3 {
        self.0.get(tile as usize).copied().unwrap_or(Vec3::ONE)
    }

    /// Radiance of a tile in the presence of the virtual objects.
    pub fn radiance(&self, tile: u32, light: &DistantLight<'_>) -> Vec3 {
        light.phantom_radiance(tile) * self.share(tile)
    }

    /// Mean radiance of a phantom's side in the presence of the virtual objects.
    pub fn of_side(&self, side: u32, light: &DistantLight<'_>) -> Vec3 {
        let tiles = (TILES * side..TILES * (side + 1)).map(|tile| self.radiance(tile, light));
        tiles.sum::<Vec3>() / TILES as f32
    }
}
