//! What the environment hands to the compositor.

use super::glints::Glint;
use glam::Vec3;
use penumbra_interface::MonotonicTime;
use std::sync::Arc;

/// What the levels of a radiance map hold.
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
/// Faces in the order +X −X +Y −Y +Z −Z of *world* axes (Vulkan/WebGPU face orientation:
/// looking up face and (u, v) from a direction follows the cube-map rules of the WebGPU
/// and Vulkan specifications, applied to the world direction as it stands). Level `m`
/// has `size >> m` texels a side; level 0 is the map itself, and the others hold what
/// [`Filtering`] says, for lobes of [`super::lobes::widths`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CubeMap {
    /// Texels a side of level 0, a power of two.
    pub size: u32,
    /// Texels of each level, face-major, rows top to bottom: `6 * (size >> m)²` each; from
    /// level 1 on for GGX.
    pub levels: Vec<Vec<[f32; 3]>>,
    /// Levels from 1 on for Phong, where something is made of it.
    pub phong: Vec<Vec<[f32; 3]>>,
    /// What the levels hold.
    pub filtering: Filtering,
    /// Sources that levels from 1 on leave out, wholly or in part.
    pub glints: Vec<Glint>,
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
        let basis = [
            1.0,
            n.y,
            n.z,
            n.x,
            n.x * n.y,
            n.y * n.z,
            3.0 * n.z * n.z - 1.0,
            n.x * n.z,
            n.x * n.x - n.y * n.y,
        ];
        let sum: Vec3 = self
            .coefficients
            .iter()
            .zip(basis)
            .map(|(c, y)| *c * y)
            .sum();
        sum.max(Vec3::ZERO)
    }
}

/// What a dome light stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// One cell of the sphere; also contained in [`Lighting::irradiance`].
    Cell,
    /// Part of a compact source (sun, lamp, window) taken out of the cells; *not* in
    /// [`Lighting::irradiance`].
    Compact,
}

/// A directional light of the dome (Supan 2006, section V C).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DomeLight {
    /// Unit vector from the scene to the light, world.
    pub direction: Vec3,
    /// Radiance integrated over the light's solid angle, RGB: irradiance on a surface
    /// that faces it.
    pub irradiance: Vec3,
    /// Half angle of a cone with the light's solid angle, radians: how soft its shadow is.
    pub angular_radius: f32,
    /// Cell or compact source.
    pub kind: LightKind,
}

/// All the light at one instant.
#[derive(Clone, Debug)]
pub struct Lighting {
    /// Middle of the exposure of the picture it was read from.
    pub captured_at: MonotonicTime,
    /// Counts up with every change.
    pub generation: u64,
    /// Radiance by direction, prefiltered; the whole sphere, compact sources included.
    pub radiance: Arc<CubeMap>,
    /// Irradiance of the whole sphere *without* the compact sources.
    pub irradiance: Harmonics,
    /// The dome. Index = shadow-map slot, stable in time; a slot whose irradiance is zero
    /// casts nothing. Never longer than the budget.
    pub lights: Vec<DomeLight>,
    /// Mean radiance leaving the ground around the objects (what the lower hemisphere was
    /// filled with).
    pub ground_radiance: Vec3,
    /// What the luminance parameters of shadowing planes are summed from, where they are
    /// wanted.
    pub faces: Option<Arc<super::geodesic::FaceLight>>,
}
