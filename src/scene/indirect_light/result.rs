//! Indirect light around the virtual objects, as the solver returns it.

use super::ground_map::GroundMap;
use super::surface_grid::SurfaceIrradiance;
use super::surfel_index::SurfelIndex;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// Number of texels along a side of the ground grid.
pub const GROUND_SIDE: u32 = 96;
/// Number of probes of the volume along x, y, z.
pub const VOLUME_SIZE: [u32; 3] = [12, 12, 8];

/// Indirect light under one state of the distant light, in scene camera units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IndirectLight {
    /// Incremented with every change; 0 before the first update.
    pub generation: u64,
    /// Lower corner of the region, world, metres.
    pub low: Vec3,
    /// Upper corner of the region, world, metres.
    pub high: Vec3,
    /// Where places on the ground lie in its grid.
    pub on_ground: GroundMap,
    /// Change of irradiance on real surfaces by the virtual objects.
    pub change: OnReal,
    /// Irradiance on real surfaces without virtual objects: by light that phantoms reflect, and on phantoms
    /// by what the ground they see has more or less than its mean.
    pub real: OnReal,
    /// Irradiance by light that phantoms reflect where virtual objects shadow them.
    pub real_now: Irradiance,
    /// Irradiance on virtual surfaces that stand still, by light of all other surfaces, minus the
    /// light of the ground that those hide or darken.
    pub on_virtual: SurfaceIrradiance,
    /// Radiance of the surfaces around virtual ones, for reflections of them.
    pub nearby: NearbyRadiance,
}

/// Radiance of the surfaces close by in the presence of the virtual objects, in scene camera units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NearbyRadiance {
    /// Surfels, which are distributed evenly over virtual surfaces that stand still.
    pub surfels: Arc<SurfelIndex>,
    /// Of each surfel: radiance that is reflected diffusely or emitted.
    pub diffuse: Vec<Vec3>,
    /// The same with specular reflection as if it were diffuse.
    pub total: Vec<Vec3>,
    /// Mean radiance of the sides of phantoms, like [`PhantomRadiance`].
    pub phantoms: Vec<[Vec3; 6]>,
    /// Ratio of the light on the ground to that without virtual objects and virtual lights, like
    /// [`Irradiance::ground`].
    pub ground: Vec<Vec3>,
}

/// Irradiance on real surfaces, linear RGB.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OnReal {
    /// On the ground, row by row from the lower corner: [`GROUND_SIDE`]² values.
    pub ground: Vec<Vec3>,
    /// On phantoms.
    pub surfaces: SurfaceIrradiance,
}

/// Irradiance around the virtual objects, linear RGB.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Irradiance {
    /// On the ground, row by row from the lower corner: [`GROUND_SIDE`]² values.
    pub ground: Vec<Vec3>,
    /// In the air, on surfaces that face +X −X +Y −Y +Z −Z: six volumes of [`VOLUME_SIZE`] values,
    /// x fastest.
    pub volume: [Vec<Vec3>; 6],
}

/// What is known of the real surfaces around the virtual objects, without these.
#[derive(Clone, Copy)]
pub struct RealSurfaces<'a> {
    /// Radiance of phantoms.
    pub phantoms: &'a PhantomRadiance,
    /// Brightness of places on the ground.
    pub ground: &'a GroundBrightness,
}

/// Radiance of places on the ground as a share of its mean, RGB: texture, and shadows of real objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroundBrightness {
    /// Corner of a square with the least x and y; world, metres.
    pub low: Vec2,
    /// Edge of the square, metres.
    pub edge: f32,
    /// Number of cells along the edge.
    pub side: usize,
    /// The cells, row by row; `None` where the ground was never seen.
    pub cells: Vec<Option<Vec3>>,
}

impl GroundBrightness {
    /// Brightness at a place (world, metres); 1 where it is not known.
    #[must_use]
    pub fn at(&self, place: Vec2) -> Vec3 {
        self.known_at(place).unwrap_or(Vec3::ONE)
    }

    /// Brightness at a place, if its cell is known: interpolated between the middles of the known cells
    /// around it.
    #[must_use]
    pub fn known_at(&self, place: Vec2) -> Option<Vec3> {
        let at = (place - self.low) * (self.side as f32 / self.edge);
        if !(at.cmpge(Vec2::ZERO).all() && at.max_element() < self.side as f32) {
            return None;
        }
        let cell = |at: Vec2| {
            let index = at.y as usize * self.side + at.x as usize;
            self.cells.get(index).copied().flatten()
        };
        let own = cell(at)?;
        let last = Vec2::splat(self.side as f32 - 1.0);
        let at = (at - 0.5).clamp(Vec2::ZERO, last);
        let (mut sum, mut known) = (own * f32::EPSILON, f32::EPSILON);
        for corner in [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE] {
            let weights = Vec2::ONE - (corner - at.fract()).abs();
            if let Some(brightness) = cell((at.floor() + corner).min(last)) {
                sum += brightness * weights.element_product();
                known += weights.element_product();
            }
        }
        Some(sum / known)
    }
}

/// Radiance of the phantoms without the ground, in the order of the scene: for each phantom that
/// of the sides that face +X −X +Y −Y +Z −Z.
pub type PhantomRadiance = [[Vec3; 6]];
