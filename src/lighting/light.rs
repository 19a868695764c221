//! The estimated light, as the compositor receives it.

use super::place::{LEAST_DISTANCE, LightPlace};
use glam::Vec3;
use penumbra_interface::MonotonicTime;
use std::f32::consts::PI;
use std::sync::Arc;

/// The content of a radiance map's levels.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Filtering {
    /// `"prefiltered"`: integrals over the materials' own lobes.
    #[default]
    Prefiltered,
    /// `"box"`: the paper's chain of box-filtered maps, for comparison.
    Box,
}

/// A cube map of linear RGB radiance with a chain of filtered levels.
///
/// Faces in the order +X −X +Y −Y +Z −Z of *world* axes (Vulkan/WebGPU face orientation: face and
/// (u, v) of a direction follow the cube-map rules of the WebGPU and Vulkan specifications, applied
/// to the world direction itself). Level `m` has `size >> m` texels along a side; level 0 is the
/// map itself, and the others are filtered as [`Filtering`] defines, for lobes of
/// [`super::lobes::widths`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CubeMap {
    /// Texels along a side of level 0, a power of two.
    pub size: u32,
    /// Texels of each level, face-major, rows top to bottom: `6 * (size >> m)²` each; from
    /// level 1 on for GGX.
    pub levels: Vec<Vec<[f32; 3]>>,
    /// Levels from 1 on for Phong's lobes, if they are requested.
    pub phong: Vec<Vec<[f32; 3]>>,
    /// The content of the levels.
    pub filtering: Filtering,
    /// Sources that levels from 1 on leave out, entirely or in part.
    pub compact_sources: Vec<CompactSourceSpecular>,
    /// From where it was seen, world, metres, if that is known.
    pub seen_from: Option<Vec3>,
}

/// Maximum number of sources, the strongest.
pub const MAX_COMPACT_SOURCES: usize = 8;
/// Maximum number of levels with weights: those of a map of 512 texels along a side.
pub const MAX_LEVELS: usize = 8;
/// A compact source for the BRDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompactSourceSpecular {
    /// Unit vector to its centre of energy, world.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it, RGB.
    pub flux: Vec3,
    /// Radius of the uniform disc with the same second moment, radians.
    pub radius: f32,
    /// Share of it that each level of the map leaves out.
    pub weights: [f32; MAX_LEVELS],
    /// How far it is.
    pub place: LightPlace,
}

impl CompactSourceSpecular {
    /// Returns it as it is seen from `point`, world, metres.
    #[must_use]
    pub fn seen_from(&self, point: Vec3) -> Self {
        let v = self.place.towards(self.direction, point);
        let length = v.length().max(LEAST_DISTANCE);
        Self {
            direction: v / length,
            flux: self.flux / (length * length),
            radius: self.radius / length,
            ..*self
        }
    }

    /// Returns the share of it that is left out by the mixture of levels that represents a lobe.
    #[must_use]
    pub fn weight(&self, level: f32) -> f32 {
        let each = self.weights.iter().enumerate();
        each.map(|(k, w)| w * (1.0 - (level - k as f32).abs()).max(0.0))
            .sum()
    }
}

/// Real spherical harmonics to degree 2 of *irradiance* (already convolved with the
/// cosine lobe, Ramamoorthi & Hanrahan 2001): `E(n) = Σ coefficient · Y(n)`, where Y are
/// the plain polynomials `1, y, z, x, xy, yz, 3z²−1, xz, x²−y²` of the unit normal; all
/// constants are folded into the coefficients. A constant radiance L gives E = πL.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Harmonics {
    /// RGB coefficients in the order above.
    pub coefficients: [Vec3; 9],
}

impl Harmonics {
    /// Irradiance on a surface with unit normal `n`, clamped at zero.
    #[must_use]
    pub fn irradiance(&self, n: Vec3) -> Vec3 {
        self.sum(n, [1.0; 3])
    }

    /// The radiance that comes from a direction (unit vector), as far as degree 2 tells it, clamped at zero:
    /// without the cosine lobe's factors on each degree.
    #[must_use]
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        self.sum(direction, [1.0 / PI, 1.5 / PI, 4.0 / PI])
    }

    /// Sum in a direction, with a factor on each degree.
    fn sum(&self, n: Vec3, [zero, one, two]: [f32; 3]) -> Vec3 {
        let basis = [
            zero,
            one * n.y,
            one * n.z,
            one * n.x,
            two * n.x * n.y,
            two * n.y * n.z,
            two * (3.0 * n.z * n.z - 1.0),
            two * n.x * n.z,
            two * (n.x * n.x - n.y * n.y),
        ];
        let terms = self.coefficients.iter().zip(basis);
        terms.map(|(c, y)| *c * y).sum::<Vec3>().max(Vec3::ZERO)
    }
}

/// What a dome light represents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// One cell of the sphere; also contained in [`Lighting::irradiance`].
    Cell,
    /// Part of a compact source (sun, lamp, window) taken out of the cells; *not* in
    /// [`Lighting::irradiance`].
    Compact,
}

/// A light of the dome (Supan 2006, section V C): infinitely far, or, if its place is known, near.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DomeLight {
    /// Unit vector to the light, world; to a near one from the reference of its place.
    pub direction: Vec3,
    /// Radiance integrated over the light's solid angle, RGB: irradiance on a surface
    /// that faces it; of a near light at the reference of its place.
    pub irradiance: Vec3,
    /// Half angle of a cone with the light's solid angle, radians: determines the softness of its
    /// shadow.
    pub angular_radius: f32,
    /// Cell or compact source.
    pub kind: LightKind,
    /// How far it is.
    pub place: LightPlace,
}

/// All the light at one instant.
#[derive(Clone, Debug)]
pub struct Lighting {
    /// Middle of the exposure of the picture from which it was estimated.
    pub captured_at: MonotonicTime,
    /// Incremented with every change.
    pub generation: u64,
    /// Radiance by direction, prefiltered; the entire sphere, compact sources included.
    pub radiance: Arc<CubeMap>,
    /// Irradiance of the entire sphere *without* the compact sources.
    pub irradiance: Harmonics,
    /// The dome. Index = shadow-map slot, stable in time; a slot with zero irradiance casts no
    /// shadow. Never longer than the budget.
    pub lights: Vec<DomeLight>,
    /// Mean radiance leaving the ground around the objects (the fill of the lower hemisphere).
    pub ground_radiance: Vec3,
    /// Input of the luminance parameters of shadowing planes, if requested.
    pub faces: Option<Arc<super::geodesic::FaceLight>>,
}
