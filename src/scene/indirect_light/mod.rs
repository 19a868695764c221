//! Indirect light: light that virtual objects reflect onto the real scene and onto each other,
//! light of the ground and of phantoms that virtual objects block, and light of virtual lights that
//! real surfaces pass on.
//!
//! Visibility between surfaces is found once, by ray casting: it does not depend on the light. For
//! every new state of the light the surfels' radiosity follows by sums over these lists
//! (progressive radiosity, Cohen et al. 1988, on point samples; one more bounce each time), and
//! from it the change of irradiance on the ground (a grid) and on phantoms (points on them, in a
//! grid), the light between virtual surfaces (likewise), and where these move, that of phantoms in
//! the air around them (a volume of ambient cubes, McTaggart 2004).

mod blend;
mod compact_sources;
mod directions;
mod ground;
mod ground_map;
mod lamplight;
mod obstacles;
mod real_surfaces;
mod receivers;
mod region;
mod result;
mod sampling;
mod shares;
mod sides;
mod surface;
mod surface_grid;
mod surfel_index;
mod surfels;
mod tiles;
mod volume;

pub use blend::IndirectLightBlender;
pub use directions::{AXES, side_of};
pub use ground_map::GroundMap;
pub use obstacles::solid_phantoms;
pub use result::{
    GROUND_SIDE, GroundBrightness, IndirectLight, Irradiance, NearbyRadiance, OnReal,
    PhantomRadiance, RealSurfaces, VOLUME_SIZE,
};
pub use surface_grid::{GRID_SIDE, SurfaceGrid, SurfaceIrradiance};
pub use surfel_index::SurfelIndex;

use crate::lamps::PlacedLamp;
use crate::mesh::Part;
use crate::scene::Scene;
use directions::Directions;
use glam::Vec3;
use ground::GroundGrid;
use obstacles::Obstacles;
use penumbra_lighting::Lighting;
use penumbra_lighting::compact_source_specular::CompleteMap;
use real_surfaces::RealPoints;
use receivers::Receivers;
use region::Region;
use shares::{DistantLight, GroundShares, TileShares};
use sides::Sides;
use surfels::Surfels;
use volume::Volume;

/// Number of bounces after which indirect light no longer changes visibly.
const BOUNCES: usize = 5;

/// Visibility around the virtual objects, and the indirect light of the last update.
pub struct IndirectLightSolver {
    surfels: Surfels,
    sides: Sides,
    ground: GroundGrid,
    ground_shares: GroundShares,
    volume: Volume,
    on_real: RealPoints,
    receivers: Receivers,
    obstacles: Obstacles,
    directions: Directions,
    light: IndirectLight,
    /// Generation of the lighting of the last update.
    lit_by: Option<u64>,
    has_ground: bool,
}

impl IndirectLightSolver {
    /// Casts all rays. `casters` are the scene's virtual parts as they cast shadows. `None` without
    /// virtual parts, unless virtual lights light phantoms.
    #[must_use]
    pub fn new(scene: &Scene, casters: &[Part]) -> Option<Self> {
        let lit = !scene.lamps.is_empty();
        let phantoms: Vec<Part> = solid_phantoms(scene).cloned().collect();
        let lit_phantoms = phantoms.iter().filter(|_| lit);
        let region = Region::around(casters, lit_phantoms, scene.ground_height)?;
        let obstacles = Obstacles::new(scene, casters, [region.low, region.high]);
        let directions = Directions::new();
        let moves = !scene.motions.parts.is_empty();
        let surfels = Surfels::new(casters, &obstacles, &directions, &region, moves);
        let sides = Sides::new(
            &phantoms,
            (lit, moves),
            &surfels,
            &obstacles,
            &directions,
            &region,
        );
        let ground = GroundGrid::new(&obstacles, &surfels, &directions, &region, moves);
        let volume = Volume::new(&obstacles, &directions, &region);
        let on_real = RealPoints::new(&scene.phantom_parts, &surfels, &obstacles, &region, moves);
        // Where something moves, a new solver is made every half second, and frames wait for it: too
        // often for the light between virtual surfaces.
        let still = casters.iter().filter(|_| !moves);
        let receivers = Receivers::new(still, &surfels, &obstacles, &region);
        let mut light = IndirectLight {
            low: region.low,
            high: region.high,
            on_ground: region.on_ground,
            ..IndirectLight::default()
        };
        if !moves {
            light.nearby.surfels = surfels.index();
        }
        Some(Self {
            surfels,
            sides,
            ground_shares: ground.unchanged(),
            ground,
            volume,
            on_real,
            receivers,
            obstacles,
            directions,
            light,
            lit_by: None,
            has_ground: scene.ground_height.is_some(),
        })
    }

    /// Continues the generations of the `before` scene's solver: the light of a changed scene differs
    /// under the same lighting, too.
    pub fn follow(&mut self, before: &Self) {
        self.light.generation = before.light.generation;
    }

    /// Whether the last update was for another generation of `lighting`.
    #[must_use]
    pub fn is_outdated(&self, lighting: &Lighting) -> bool {
        self.lit_by != Some(lighting.generation)
    }

    /// Computes the indirect light under `lighting` and the virtual lights `lamps`: the first time with all
    /// bounces, later with one more. Does nothing if it is up to date.
    pub fn update(&mut self, lighting: &Lighting, real: RealSurfaces<'_>, lamps: &[PlacedLamp]) {
        if !self.is_outdated(lighting) {
            return;
        }
        let bounces = if self.lit_by.is_none() { BOUNCES } else { 1 };
        self.lit_by = Some(lighting.generation);
        self.light.generation += 1;
        self.directions.set_light(lighting);
        let floor = lighting.ground_radiance * f32::from(u8::from(self.has_ground));
        self.ground.look(floor, real.ground);
        let shares = &mut self.ground_shares;
        self.ground
            .update(&self.directions, lamps, &self.obstacles, shares);
        let light = DistantLight {
            radiance: CompleteMap::new(&lighting.radiance),
            mean_ground: floor,
            below: lighting.irradiance.irradiance(Vec3::NEG_Z) / std::f32::consts::PI,
            ground: &self.ground.radiance,
            phantoms: real.phantoms,
        };
        self.sides.light_up(lamps, &self.obstacles);
        self.surfels.light_up(lamps, &self.obstacles);
        let (directions, obstacles) = (&self.directions, &self.obstacles);
        for _ in 0..bounces {
            let surfels = &mut self.surfels;
            self.sides
                .update(surfels, shares, directions, &light, obstacles);
            surfels.update(directions, shares, &self.sides.shares, &light, obstacles);
            let out = (&mut *shares, &mut self.light);
            self.ground.gather(surfels, &self.sides.shares, &light, out);
        }
        let real_now = &mut self.light.real_now;
        self.volume
            .gather(&self.sides.shares, &self.directions, &light, real_now);
        self.on_real.gather(
            &self.surfels,
            shares,
            &self.sides.shares,
            &light,
            &mut self.light,
        );
        self.receivers.gather(
            &self.surfels,
            shares,
            &self.sides.shares,
            &light,
            &mut self.light.on_virtual,
        );
        let nearby = &mut self.light.nearby;
        write_nearby(&self.surfels, &self.sides.shares, &light, nearby);
    }

    /// The indirect light of the last update.
    #[must_use]
    pub const fn light(&self) -> &IndirectLight {
        &self.light
    }
}

fn write_nearby(
    surfels: &Surfels,
    sides: &TileShares,
    light: &DistantLight<'_>,
    nearby: &mut NearbyRadiance,
) {
    if !nearby.surfels.is_empty() {
        surfels.write(nearby);
    }
    let sides = |part: usize| std::array::from_fn(|i| sides.of_side((6 * part + i) as u32, light));
    nearby.phantoms.clear();
    nearby.phantoms.extend((0..light.phantoms.len()).map(sides));
}

#[cfg(test)]
mod tests;
