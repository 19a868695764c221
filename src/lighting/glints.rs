//! Compact sources as glossy surfaces mirror them.
//!
//! A lobe that is replaced by a round one ([`super::lobes`]) keeps its energy and its middle, but
//! not its shape, and a small source shows nothing but the lobe's shape. So sources that are
//! small for a level's lobe are left out of that level, and surfaces mirror them by the BRDF
//! itself, as they do virtual lamps: exactly, at any slant.
//!
//! ```text
//!   L_o = A · Σ_k t_k ∫ (L − Σ_s w_sk L_s) k_k  +  Σ_s (Σ_k t_k w_sk) · Φ_s f(v, l_s) (n·l_s)
//! ```
//!
//! with t_k the mixture of levels that stands for the lobe, w_sk the share of source s that level
//! k leaves out, and Φ_s its irradiance on a surface that faces it. A source's own extent widens
//! f. Between both ways nothing jumps: w goes from 1 to 0 as the source's radius ρ grows from
//! the lobe's width to two and a half times it, and with the share of all light that it is.

use super::cube::{CubeGrid, sample};
use super::light::CubeMap;
use super::lobes::{Family, nearest_level, own_width, phong_exponent, widths};
use super::sources::LUMINANCE;
use glam::Vec3;
use std::f32::consts::PI;

/// At most so many sources, the strongest.
pub const MOST_GLINTS: usize = 8;
/// Levels that a source's weights are kept for: those of a map of 512 texels a side.
pub const MOST_LEVELS: usize = 8;
/// By its radius over the lobe's width a source is left out wholly, and not at all.
const SMALL: (f32, f32) = (1.0, 2.5);
/// By its share of all light a source counts not at all, and wholly.
const SHARE: (f32, f32) = (0.005, 0.02);

/// A compact source for the BRDF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glint {
    /// Unit vector to its centre of energy, world.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it, RGB.
    pub flux: Vec3,
    /// Of the even disc with the same second moment, radians.
    pub radius: f32,
    /// Share of it that each level of the map leaves out.
    pub weights: [f32; MOST_LEVELS],
}

/// A source among the texels of a map.
#[derive(Clone, Debug)]
pub struct Excess {
    /// What is known of it as a whole.
    pub glint: Glint,
    /// Its texels, and the radiance that it adds to each.
    pub parts: Vec<(u32, Vec3)>,
}

/// What of `full` is not in `without`, by the source of `towards` (unit vectors) that is nearest;
/// `widths` are those of the map's lobes from level 1 on.
#[must_use]
pub fn excesses(
    grid: &CubeGrid,
    full: &[Vec3],
    without: &[Vec3],
    towards: &[Vec3],
    widths: &[f32],
) -> Vec<Excess> {
    let towards = &towards[..towards.len().min(MOST_GLINTS)];
    let mut parts = vec![Vec::new(); towards.len()];
    let mut total = 0.0;
    for (i, (l, rest)) in full.iter().zip(without).enumerate() {
        total += l.dot(LUMINANCE) * grid.solid_angles[i];
        let above = (*l - *rest).max(Vec3::ZERO);
        if above.max_element() > 1e-3 * l.max_element() {
            let along = |k: &usize| towards[*k].dot(grid.directions[i]);
            let nearest = (0..towards.len()).max_by(|a, b| along(a).total_cmp(&along(b)));
            if let Some(k) = nearest {
                parts[k].push((i as u32, above));
            }
        }
    }
    let described = |parts| described(grid, parts, total, widths);
    parts.into_iter().filter_map(described).collect()
}

fn described(
    grid: &CubeGrid,
    parts: Vec<(u32, Vec3)>,
    total: f32,
    widths: &[f32],
) -> Option<Excess> {
    let each = || {
        parts.iter().map(|(i, l)| {
            let flux = *l * grid.solid_angles[*i as usize];
            (grid.directions[*i as usize], flux, flux.dot(LUMINANCE))
        })
    };
    let flux: Vec3 = each().map(|(_, flux, _)| flux).sum();
    let bright = flux.dot(LUMINANCE);
    let direction = each()
        .map(|(d, _, f)| d * f)
        .sum::<Vec3>()
        .try_normalize()?;
    // |d − mean|² has the mean ρ²/2 over an even disc of radius ρ.
    let spread: f32 = each()
        .map(|(d, _, f)| d.distance_squared(direction) * f)
        .sum();
    let radius = (2.0 * spread / bright).sqrt();
    let counts = smoothstep(SHARE, bright / total.max(f32::MIN_POSITIVE));
    let mut weights = [0.0; MOST_LEVELS];
    for (weight, w) in weights[1..].iter_mut().zip(widths) {
        *weight = counts * (1.0 - smoothstep(SMALL, radius / w));
    }
    let glint = Glint {
        direction,
        flux,
        radius,
        weights,
    };
    (counts > 0.0 && radius.is_finite()).then_some(Excess { glint, parts })
}

impl Glint {
    /// Share of it that the mixture of levels leaves out which stands for a lobe.
    #[must_use]
    pub fn weight(&self, level: f32) -> f32 {
        let each = self.weights.iter().enumerate();
        each.map(|(k, w)| w * (1.0 - (level - k as f32).abs()).max(0.0))
            .sum()
    }
}

/// Radiance that a surface with unit normal `n` mirrors towards `v` of sources that `level` leaves
/// out: for a specular colour or an F0 of 1, and what an F90 of 1 adds. Twin of `lib/glints.wgsl`.
#[must_use]
pub fn mirrored(
    glints: &[Glint],
    (family, parameter, level): (Family, f32, f32),
    n: Vec3,
    v: Vec3,
) -> [Vec3; 2] {
    let mut sums = [Vec3::ZERO; 2];
    for glint in glints {
        let l = glint.direction;
        let n_dot_l = n.dot(l).max(0.0);
        let light = glint.flux * (n_dot_l * glint.weight(level));
        let v_dot_h = v.dot((l + v).normalize()).max(0.0);
        let fresnel = match family {
            Family::Ggx => (1.0 - v_dot_h).powi(5),
            Family::Phong => 0.0,
        };
        let lobe = towards(family, parameter, glint.radius, [n, v, l]);
        sums[0] += light * (lobe * (1.0 - fresnel));
        sums[1] += light * (lobe * fresnel);
    }
    sums
}

/// BRDF, without its Fresnel factor, towards a disc of some radius. The lobe is widened so that
/// its peak is the mean over the disc:
///
/// ```text
///   GGX, whose half vectors fill an ellipse a = ρ/2 by b = ρ/(2 v·h):   α² → √((α² + a²)(α² + b²))
///   Phong:                                                             1/e → 1/e + ρ²/4
/// ```
fn towards(family: Family, parameter: f32, radius: f32, [n, v, l]: [Vec3; 3]) -> f32 {
    let (n_dot_l, n_dot_v) = (n.dot(l).max(0.0), n.dot(v).max(1e-3));
    match family {
        Family::Phong => {
            let own = phong_exponent(parameter);
            let e = own / (1.0 + own * radius * radius * 0.25);
            let along = (n * (2.0 * n.dot(v)) - v).dot(l).max(0.0);
            (e + 2.0) / (2.0 * PI) * along.powf(e)
        }
        Family::Ggx => {
            let h = (l + v).normalize();
            let own = own_width(family, parameter).powi(2);
            let along = radius * radius * 0.25;
            let across = along / v.dot(h).max(0.1).powi(2);
            let a2 = ((own + along) * (own + across)).sqrt();
            let n_dot_h = n.dot(h).max(0.0);
            let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;
            let root = |x: f32| (x * x * (1.0 - a2) + a2).sqrt();
            let masking = 0.5 / (n_dot_l * root(n_dot_v) + n_dot_v * root(n_dot_l));
            a2 / (PI * d * d) * masking
        }
    }
}

/// A map's levels with the sources that they leave out, blurred by each level's own lobe: for
/// light that needs no highlight's shape.
#[derive(Clone, Copy, Debug)]
pub struct Whole<'a> {
    map: &'a CubeMap,
    /// GGX's lobe of each level: its width, and one over its integral.
    lobes: [(f32, f32); MOST_LEVELS],
}

impl<'a> Whole<'a> {
    /// Of a map.
    #[must_use]
    pub fn new(map: &'a CubeMap) -> Self {
        let mut lobes = [(0.0, 0.0); MOST_LEVELS];
        if !map.glints.is_empty() {
            let widths = widths(map.size, map.levels.len());
            for (lobe, w) in lobes[1..].iter_mut().zip(widths) {
                *lobe = (w, 1.0 / Family::Ggx.moments(w).0 as f32);
            }
        }
        Self { map, lobes }
    }

    /// Radiance from a direction, blurred by about as wide a lobe.
    #[must_use]
    pub fn blurred(&self, direction: Vec3, width: f32) -> Vec3 {
        let level = nearest_level(self.map, width);
        let (w, norm) = self.lobes.get(level).copied().unwrap_or_default();
        let of = |g: &Glint| {
            let lobe = Family::Ggx.round(w, direction.dot(g.direction)) * norm;
            g.flux * (g.weight(level as f32) * lobe)
        };
        let sources = self.map.glints.iter().filter(|_| norm > 0.0).map(of);
        sample(self.map, level, direction) + sources.sum::<Vec3>()
    }
}

fn smoothstep((low, high): (f32, f32), x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::super::prefilter::{Prefilter, level_count};
    use super::*;

    const SIZE: u32 = 64;

    /// An even sky with a disc in it; the disc's direction.
    fn sky(radius: f32) -> (CubeGrid, Vec<Vec3>, Vec<Vec3>, Vec3) {
        let grid = CubeGrid::new(SIZE);
        let towards = Vec3::new(0.4, -0.3, 0.8).normalize();
        let without = vec![Vec3::splat(0.1); grid.directions.len()];
        let lit = |d: &Vec3| d.dot(towards) > radius.cos();
        let each = grid.directions.iter();
        let full = each
            .map(|d| Vec3::splat(if lit(d) { 50.0 } else { 0.1 }))
            .collect();
        (grid, full, without, towards)
    }

    fn found(radius: f32) -> (CubeMap, Vec<Excess>) {
        let (grid, full, without, towards) = sky(radius);
        let widths = widths(SIZE, level_count(SIZE));
        let sources = excesses(&grid, &full, &without, &[towards], &widths);
        (Prefilter::new(SIZE).apply_without(&full, &sources), sources)
    }

    #[test]
    fn a_disc_is_known_by_its_flux_direction_and_radius() {
        for radius in [0.05_f32, 0.1, 0.2] {
            let (_, sources) = found(radius);
            let glint = sources[0].glint;
            let flux = 49.9 * 2.0 * PI * (1.0 - radius.cos());
            assert!(
                (glint.flux.x / flux - 1.0).abs() < 0.15,
                "{radius}: {glint:?}"
            );
            assert!(
                (glint.radius / radius - 1.0).abs() < 0.15,
                "{radius}: {glint:?}"
            );
            assert!(glint.direction.dot(sky(radius).3) > 0.9999);
        }
    }

    #[test]
    fn what_levels_leave_out_is_what_sources_have() {
        let (map, sources) = found(0.1);
        let all = Prefilter::new(SIZE).apply(&sky(0.1).1);
        let mean = super::super::prefilter::level_mean;
        for level in 1..map.levels.len() {
            let gone = mean(&all, level).x - mean(&map, level).x;
            let glint = sources[0].glint;
            let said = glint.flux.x * glint.weights[level] / (4.0 * PI);
            assert!(
                (gone / said.max(0.01) - 1.0).abs() < 0.1 || said == 0.0,
                "{level}: {gone} {said}"
            );
        }
        assert_eq!(map.levels[0], all.levels[0]);
    }

    #[test]
    fn with_its_sources_a_level_is_whole_again() {
        let (map, sources) = found(0.06);
        let all = Prefilter::new(SIZE).apply(&sky(0.06).1);
        let (there, beside) = (sources[0].glint.direction, Vec3::new(-0.2, 0.6, 0.7));
        for width in [0.3, 0.5, 1.0] {
            for d in [
                there,
                (there + beside * 0.3).normalize(),
                beside.normalize(),
            ] {
                let ours = Whole::new(&map).blurred(d, width).x;
                let truth = Whole::new(&all).blurred(d, width).x;
                assert!(
                    (ours / truth - 1.0).abs() < 0.1,
                    "{width} {d}: {ours} {truth}"
                );
            }
        }
    }

    #[test]
    fn wide_sources_fade_without_a_jump() {
        let weight = |radius: f32| found(radius).1.first().map_or(0.0, |s| s.glint.weights[2]);
        let all: Vec<f32> = (1..24).map(|i| weight(0.02 * i as f32)).collect();
        assert_eq!((all[3], all[22]), (1.0, 0.0), "{all:?}");
        let largest = all[3..].windows(2).map(|w| (w[1] - w[0]).abs());
        assert!(largest.fold(0.0, f32::max) < 0.25, "{all:?}");
    }

    #[test]
    fn weak_sources_stay_in_the_map() {
        let (grid, full, without, towards) = sky(0.05);
        let dimmed = |share: f32| -> Vec<Vec3> {
            let pairs = full.iter().zip(&without);
            pairs.map(|(a, b)| b.lerp(*a, share)).collect()
        };
        let widths = widths(SIZE, level_count(SIZE));
        let found = |share| excesses(&grid, &dimmed(share), &without, &[towards], &widths);
        assert!(found(0.005).is_empty());
        let (weak, strong) = (
            found(0.035)[0].glint.weights[4],
            found(1.0)[0].glint.weights[4],
        );
        assert!(weak > 0.0 && weak < 1.0 && strong == 1.0, "{weak} {strong}");
    }

    #[test]
    fn a_sky_without_sources_has_none() {
        let (grid, _, without, towards) = sky(0.1);
        let widths = widths(SIZE, level_count(SIZE));
        assert!(excesses(&grid, &without, &without, &[towards], &widths).is_empty());
        assert!(excesses(&grid, &without, &without, &[], &widths).is_empty());
    }
}
