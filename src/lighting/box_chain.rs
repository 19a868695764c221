//! The chain of box-filtered maps of DiVerdi et al. (2003, section 3.2), for comparison.
//!
//! Their map is OpenGL's sphere map, the mirrored sphere as the camera sees it: a direction at the
//! angle θ from the camera's lies at sin(θ/2) of the radius, so all texels inside cover equal solid
//! angles. Each smaller map holds means of 2×2 texels, including those outside the sphere, where
//! the camera sees past it. A material takes its reflections from the one level whose texels are as
//! large as its lobe, whatever the angle of view. Here each level is resampled to a cube map with
//! the resolution of its own interpolation.

use super::cube::{CubeGrid, tangent_frame, texel_of};
use super::light::{CubeMap, Filtering};
use super::lobes::{Family, own_width, solid_angle};
use super::prefilter::level_count;
use glam::{Vec2, Vec3};

/// Samples along a texel's side, to average as a camera's pixels do.
const SAMPLES: u32 = 4;

/// Texels across the sphere for a cube of `size` texels along a side.
const fn across(size: u32) -> u32 {
    size / 2
}

/// Computes the chain of `texels` (`6 * size²`) as seen by a camera in the direction
/// `towards_camera` from a mirrored sphere.
#[must_use]
pub fn box_chain(size: u32, texels: &[Vec3], towards_camera: Vec3) -> CubeMap {
    let view = View::new(towards_camera);
    let mut sphere = view.sphere(size, texels);
    let mut side = across(size);
    let mut levels = vec![view.cube(&CubeGrid::new(size), side, &sphere)];
    for level in 1..level_count(size) {
        sphere = halved(side, &sphere);
        side /= 2;
        levels.push(view.cube(&CubeGrid::new(size >> level), side, &sphere));
    }
    let phong = levels[1..].to_vec();
    CubeMap {
        compact_sources: Vec::new(),
        size,
        levels,
        phong,
        filtering: Filtering::Box,
        ..CubeMap::default()
    }
}

/// Returns the level for a lobe: the one whose texels, 16 · 4^k / T² steradians with T texels
/// across the sphere, are as large as the lobe at n·v = 1.
#[must_use]
pub fn box_level(family: Family, parameter: f32, size: u32, levels: usize) -> f32 {
    let lobe = solid_angle(family, own_width(family, parameter));
    let texel = 16.0 / (across(size) * across(size)) as f32;
    let level = (0.5 * (lobe / texel).log2()).round();
    level.clamp(0.0, levels.saturating_sub(1) as f32)
}

/// The camera's axes at the sphere.
struct View {
    right: Vec3,
    up: Vec3,
    towards: Vec3,
}

impl View {
    fn new(towards: Vec3) -> Self {
        let (right, up) = tangent_frame(towards);
        Self { right, up, towards }
    }

    /// Renders the sphere, rows of `across(size)` texels.
    fn sphere(&self, size: u32, texels: &[Vec3]) -> Vec<Vec3> {
        let side = across(size);
        let past = texels[texel_of(size, -self.towards)];
        let seen = |p: Vec2| match self.direction(p) {
            Some(d) => texels[texel_of(size, d)],
            None => past,
        };
        let step = 2.0 / (side * SAMPLES) as f32;
        let mean = |i: u32| {
            let corner = Vec2::new((i % side) as f32, (i / side) as f32) * SAMPLES as f32;
            let samples = (0..SAMPLES * SAMPLES).map(|k| {
                let inside = Vec2::new((k % SAMPLES) as f32, (k / SAMPLES) as f32);
                seen((corner + inside + 0.5) * step - 1.0)
            });
            samples.sum::<Vec3>() / (SAMPLES * SAMPLES) as f32
        };
        (0..side * side).map(mean).collect()
    }

    /// Returns the direction mirrored at a point of the sphere's picture, −1..=1 along each axis;
    /// `None` outside the sphere.
    fn direction(&self, p: Vec2) -> Option<Vec3> {
        let r2 = p.length_squared();
        // cosθ = 1 − 2 sin²(θ/2).
        let sin_over_r = 2.0 * (1.0 - r2).max(0.0).sqrt();
        let across = (self.right * p.x + self.up * p.y) * sin_over_r;
        (r2 < 1.0).then(|| across + self.towards * (1.0 - 2.0 * r2))
    }

    fn point(&self, d: Vec3) -> Vec2 {
        let aside = Vec2::new(d.dot(self.right), d.dot(self.up));
        let r = (0.5 * (1.0 - d.dot(self.towards))).max(0.0).sqrt();
        aside.normalize_or(Vec2::X) * r
    }

    /// Resamples a level to a cube map, interpolated between texels.
    fn cube(&self, grid: &CubeGrid, side: u32, sphere: &[Vec3]) -> Vec<[f32; 3]> {
        let texel = |x: f32, y: f32| {
            let last = (side - 1) as f32;
            sphere[(y.clamp(0.0, last) as u32 * side + x.clamp(0.0, last) as u32) as usize]
        };
        let show = |d: &Vec3| {
            let at = (self.point(*d) * 0.5 + 0.5) * side as f32 - 0.5;
            let (low, t) = (at.floor(), at - at.floor());
            let row = |y: f32| texel(low.x, y).lerp(texel(low.x + 1.0, y), t.x);
            row(low.y).lerp(row(low.y + 1.0), t.y).to_array()
        };
        grid.directions.iter().map(show).collect()
    }
}

/// Returns the next smaller picture: means of 2×2 texels.
fn halved(side: u32, sphere: &[Vec3]) -> Vec<Vec3> {
    let half = side / 2;
    let mean = |i: u32| {
        let first = (2 * (i / half) * side + 2 * (i % half)) as usize;
        let row = side as usize;
        (sphere[first] + sphere[first + 1] + sphere[first + row] + sphere[first + row + 1]) / 4.0
    };
    (0..half * half).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sphere_mapping_is_invertible() {
        let view = View::new(Vec3::new(0.3, -0.5, 0.6).normalize());
        for d in CubeGrid::new(8).directions {
            let back = view.direction(view.point(d)).unwrap_or(Vec3::ZERO);
            assert!(back.distance(d) < 2e-3, "{d} {back}");
        }
        assert!(view.direction(Vec2::ONE).is_none());
    }

    #[test]
    fn constant_is_preserved_and_wide_lobes_use_small_maps() {
        let map = box_chain(32, &vec![Vec3::new(0.2, 1.0, 3.0); 6 * 32 * 32], Vec3::Y);
        let texels = map.levels.iter().flatten();
        assert!(texels.clone().count() > 6 * 32 * 32);
        for t in texels {
            assert!((Vec3::from(*t) - Vec3::new(0.2, 1.0, 3.0)).length() < 1e-5);
        }
        let levels = [10_000.0, 1000.0, 100.0, 20.0, 5.0, 1.0].map(|e| {
            box_level(
                Family::Phong,
                super::super::lobes::phong_parameter(e),
                128,
                6,
            )
        });
        assert_eq!(levels, [0.0, 0.0, 2.0, 3.0, 4.0, 5.0]);
    }
}
