//! Specular reflection of compact sources.
//!
//! Replacing a lobe by a round one ([`super::lobes`]) preserves its energy and its centre, but not
//! its shape, and the reflection of a small source shows exactly the lobe's shape. So sources that
//! are small compared with a level's lobe are left out of that level, and surfaces reflect them by
//! the BRDF itself, like virtual lights: exactly, at any viewing angle.
//!
//! ```text
//!   L_o = A · Σ_k t_k ∫ (L − Σ_s w_sk L_s) k_k  +  Σ_s (Σ_k t_k w_sk) · Φ_s f(v, l_s) (n·l_s)
//! ```
//!
//! where t_k is the mixture of levels that represents the lobe, w_sk the share of source s that
//! level k leaves out, and Φ_s its irradiance on a surface that faces it. The source's own extent
//! widens f; a lobe much narrower than it shows the disc itself. The transition between both methods is continuous: w goes from 1 to 0 as the source's
//! radius ρ grows from the lobe's width to two and a half times it, and with its share of all
//! light. Near sources are left out of all levels, because each point mirrors them elsewhere.

use super::cube::{CubeGrid, sample};
use super::light::{CompactSourceSpecular, CubeMap, MAX_COMPACT_SOURCES, MAX_LEVELS};
use super::lobes::{Family, own_width, phong_exponent, widths};
use super::place::{LightPlace, Seen};
use super::sources::LUMINANCE;
use glam::Vec3;
use penumbra_numerics::smoothstep;
use std::f32::consts::PI;

/// Ratio of a source's radius to a level's width at which it is left out entirely, and not at all.
const SMALL: (f32, f32) = (1.0, 2.5);
/// The same for lamps, which are round: a long lobe looks them up in narrower levels than its own width.
const SMALL_LAMP: (f32, f32) = (2.0, 5.0);
/// Radius up to which a source is such a lamp, and from which on it is not, radians: windows are larger.
const LAMP: (f32, f32) = (0.1, 0.2);
/// Share of all light at which a source is ignored, and fully counted.
const SHARE: (f32, f32) = (0.005, 0.02);

/// Reciprocal of the distance, 1/m, from which a source is left out of all levels, the map itself
/// included.
const NEAR: f32 = 0.4;
/// Narrowest lobe, as GGX's α; see `lib/gloss.wgsl`.
const MIRROR: f32 = 0.01;
/// Share of a disc's radius over which its reflection in a mirror fades at the edge.
const EDGE: f32 = 0.25;
/// Ratio of the width of a lobe about the mirror direction to a disc's radius below which the
/// reflection is the disc, and above which the disc widens the lobe.
const SHARP: (f32, f32) = (0.25, 0.75);

/// A source among the texels of a map.
#[derive(Clone, Debug)]
pub struct Excess {
    /// Its direction, flux, radius and weights.
    pub source: CompactSourceSpecular,
    /// Its texels, and the radiance that it adds to each.
    pub parts: Vec<(u32, Vec3)>,
}

/// Returns the difference of `full` and `without`, assigned to the nearest of `sources` (unit vectors
/// towards them, and their places); `widths` are those of the map's lobes from level 1 on.
#[must_use]
pub fn excesses(
    grid: &CubeGrid,
    full: &[Vec3],
    without: &[Vec3],
    sources: &[(Seen, LightPlace)],
    widths: &[f32],
) -> Vec<Excess> {
    let sources = &sources[..sources.len().min(MAX_COMPACT_SOURCES)];
    let mut parts = vec![Vec::new(); sources.len()];
    let mut total = 0.0;
    for (i, (l, rest)) in full.iter().zip(without).enumerate() {
        total += l.dot(LUMINANCE) * grid.solid_angles[i];
        let above = (*l - *rest).max(Vec3::ZERO);
        if above.max_element() > 1e-3 * l.max_element() {
            let direction = grid.directions[i];
            if let Some(k) = owner(sources.iter().map(|(seen, _)| *seen), direction) {
                parts[k].push((i as u32, above));
            }
        }
    }
    let each = parts.into_iter().zip(sources);
    each.filter_map(|(parts, (_, place))| describe(grid, parts, total, (widths, *place)))
        .collect()
}

/// The source to which the light from a direction belongs: the one whose outline is nearest.
pub(super) fn owner(sources: impl Iterator<Item = Seen>, direction: Vec3) -> Option<usize> {
    let apart = |s: Seen| direction.distance(s.direction) - s.angular_radius;
    let all = sources.map(apart).enumerate();
    all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
}

fn describe(
    grid: &CubeGrid,
    parts: Vec<(u32, Vec3)>,
    total: f32,
    (widths, place): (&[f32], LightPlace),
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
    // |d − mean|² has the mean ρ²/2 over a uniform disc of radius ρ.
    let spread: f32 = each()
        .map(|(d, _, f)| d.distance_squared(direction) * f)
        .sum();
    let radius = (2.0 * spread / bright).sqrt();
    let counts = smoothstep(SHARE.0, SHARE.1, bright / total.max(f32::MIN_POSITIVE));
    // A near source moves against what is far as the point does that mirrors it.
    let near = smoothstep(0.0, NEAR, place.inverse_distance);
    let mut weights = [counts * near; MAX_LEVELS];
    for (weight, w) in weights[1..].iter_mut().zip(widths) {
        let small = |(all, none)| 1.0 - smoothstep(all, none, radius / w);
        let lamp = 1.0 - smoothstep(LAMP.0, LAMP.1, radius);
        let small = small(SMALL).max(lamp * small(SMALL_LAMP));
        *weight = counts * small.max(near);
    }
    let source = CompactSourceSpecular {
        direction,
        flux,
        radius,
        weights,
        place,
    };
    (counts > 0.0 && radius.is_finite()).then_some(Excess { source, parts })
}

/// Returns the radiance reflected towards `v` by a surface with unit normal `n` from the sources
/// that `level` leaves out: for a specular colour or an F0 of 1, and the addition of an F90 of 1.
/// Twin of `lib/compact_source_specular.wgsl`.
#[must_use]
pub fn reflected(
    sources: &[CompactSourceSpecular],
    (family, parameter, level): (Family, f32, f32),
    n: Vec3,
    v: Vec3,
) -> [Vec3; 2] {
    let mut sums = [Vec3::ZERO; 2];
    for source in sources {
        let l = source.direction;
        let n_dot_l = n.dot(l).max(0.0);
        let light = source.flux * (n_dot_l * source.weight(level));
        let v_dot_h = v.dot((l + v).normalize()).max(0.0);
        let fresnel = match family {
            Family::Ggx => (1.0 - v_dot_h).powi(5),
            Family::Phong => 0.0,
        };
        let lobe = towards(family, parameter, source.radius, [n, v, l]);
        sums[0] += light * (lobe * (1.0 - fresnel));
        sums[1] += light * (lobe * fresnel);
    }
    sums
}

/// Returns the BRDF, without its Fresnel factor, towards a disc of a given radius. The lobe is
/// widened so that its peak is the mean over the disc:
///
/// ```text
///   GGX, whose half vectors fill an ellipse a = ρ/2 by b = ρ/(2 v·h):   α² → √((α² + a²)(α² + b²))
///   Phong:                                                             e → (1 − exp(−e ρ²/2)) / (ρ²/2)
/// ```
fn towards(family: Family, parameter: f32, radius: f32, [n, v, l]: [Vec3; 3]) -> f32 {
    let (n_dot_l, n_dot_v) = (n.dot(l).max(0.0), n.dot(v).max(1e-3));
    match family {
        Family::Phong => {
            let own = phong_exponent(parameter);
            let half = 0.5 * radius * radius;
            // Smaller discs do not widen the lobe.
            let e = if own * half > 1e-3 {
                -(-own * half).exp_m1() / half
            } else {
                own
            };
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
            let wide = a2 / (PI * d * d) * masking;
            let lobe = 2.0 * own.sqrt().max(MIRROR);
            let sharp = 1.0 - smoothstep(SHARP.0, SHARP.1, lobe / radius.max(1e-6));
            wide + (mirrored_disc(radius, lobe, [n, v, l]) - wide) * sharp
        }
    }
}

/// Returns the BRDF that shows a disc in a mirror whose lobe about the mirror direction is `lobe`
/// wide: its radiance 1/(π(ρ² + s²/5)), faded from 1 at an angle of ρ − s to 0 at ρ + s.
fn mirrored_disc(radius: f32, lobe: f32, [n, v, l]: [Vec3; 3]) -> f32 {
    let edge = lobe.max(EDGE * radius);
    let apart = (n * (2.0 * n.dot(v)) - v).distance(l);
    let shown = 1.0 - smoothstep(radius - edge, radius + edge, apart);
    shown / (PI * (radius * radius + 0.2 * edge * edge) * n.dot(l).max(1e-3))
}

/// A map's levels together with the sources that they leave out, blurred by each level's own lobe:
/// for light whose highlights need no exact shape.
#[derive(Clone, Copy, Debug)]
pub struct CompleteMap<'a> {
    map: &'a CubeMap,
    /// Of each level from 1 on, GGX's lobe: its width, and the reciprocal of its integral.
    lobes: [(f32, f32); MAX_LEVELS],
    /// Number of levels with lobes.
    count: usize,
}

impl<'a> CompleteMap<'a> {
    /// Prepares the lobes of a map.
    #[must_use]
    pub fn new(map: &'a CubeMap) -> Self {
        let mut lobes = [(0.0, 0.0); MAX_LEVELS];
        let widths = widths(map.size, map.levels.len());
        let count = widths.len().min(MAX_LEVELS);
        for (lobe, w) in lobes.iter_mut().zip(widths) {
            *lobe = (w, 1.0 / Family::Ggx.moments(w).0 as f32);
        }
        Self { map, lobes, count }
    }

    /// Returns the radiance that arrives at a `point` (world, metres) from a direction, blurred by a
    /// lobe of approximately this `width`; what the map's level leaves out by a lobe at least as wide
    /// as `least`.
    #[must_use]
    pub fn blurred(&self, point: Vec3, direction: Vec3, width: f32, least: f32) -> Vec3 {
        self.mirrored((point, Vec3::ZERO), direction, width, least)
    }

    /// Returns the same as a surface at `point` with unit normal `n` mirrors it: without sources behind it, where the
    /// map's level leaves them out. With a normal of zero, no source is behind it.
    #[must_use]
    pub fn mirrored(
        &self,
        (point, n): (Vec3, Vec3),
        direction: Vec3,
        width: f32,
        least: f32,
    ) -> Vec3 {
        let level = self.nearest(width);
        // What the map itself leaves out is as sharp as its next level.
        let wide = self.nearest(width.max(least)).max(1);
        let (w, norm) = self.lobes[wide - 1];
        let of = |source: &CompactSourceSpecular| {
            let source = source.seen_from(point);
            if n.dot(source.direction) < 0.0 {
                return Vec3::ZERO;
            }
            let lobe = Family::Ggx.round(w, direction.dot(source.direction)) * norm;
            source.flux * (source.weight(level as f32) * lobe)
        };
        let sources = self.map.compact_sources.iter();
        let sources: Vec3 = sources.filter(|_| self.count > 0).map(of).sum();
        sample(self.map, level, direction) + sources
    }

    /// The level whose lobe is nearest in width; 0 without lobes.
    fn nearest(&self, width: f32) -> usize {
        let off = |k: &usize| (self.lobes[*k].0 / width).log2().abs();
        let best = (0..self.count).min_by(|a, b| off(a).total_cmp(&off(b)));
        best.map_or(0, |k| k + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::prefilter::{Prefilter, level_count};
    use super::*;
    use glam::Quat;

    const SIZE: u32 = 64;

    fn disc(direction: Vec3, angular_radius: f32) -> Seen {
        Seen {
            direction,
            irradiance: Vec3::ONE,
            angular_radius,
        }
    }

    /// Returns a uniform sky with a disc in it, the sky without it, and where the disc is.
    fn sky(radius: f32) -> (CubeGrid, [Vec<Vec3>; 2], [(Seen, LightPlace); 1]) {
        let grid = CubeGrid::new(SIZE);
        let towards = Vec3::new(0.4, -0.3, 0.8).normalize();
        let without = vec![Vec3::splat(0.1); grid.directions.len()];
        let lit = |d: &Vec3| d.dot(towards) > radius.cos();
        let each = grid.directions.iter();
        let full = each
            .map(|d| Vec3::splat(if lit(d) { 50.0 } else { 0.1 }))
            .collect();
        (
            grid,
            [full, without],
            [(disc(towards, radius), LightPlace::FAR)],
        )
    }

    fn all_widths() -> Vec<f32> {
        widths(SIZE, level_count(SIZE)).collect()
    }

    fn found(radius: f32) -> (CubeMap, Vec<Excess>) {
        let (grid, [full, without], disc) = sky(radius);
        let sources = excesses(&grid, &full, &without, &disc, &all_widths());
        (Prefilter::new(SIZE).apply_without(&full, &sources), sources)
    }

    #[test]
    fn lamp_beside_a_window_takes_none_of_its_light() {
        let grid = CubeGrid::new(SIZE);
        let window = disc(Vec3::new(0.4, -0.3, 0.8).normalize(), 0.4);
        let lamp = disc(
            Quat::from_axis_angle(Vec3::Z.cross(window.direction).normalize(), 0.55)
                * window.direction,
            0.07,
        );
        let radiance = |d: &Vec3| {
            let within = |seen: Seen| d.dot(seen.direction) > seen.angular_radius.cos();
            0.1 + 20.0 * f32::from(within(window)) + 50.0 * f32::from(within(lamp))
        };
        let full: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| Vec3::splat(radiance(d)))
            .collect();
        let without = vec![Vec3::splat(0.1); full.len()];
        let sources = [window, lamp].map(|seen| (seen, LightPlace::FAR));
        let found = excesses(&grid, &full, &without, &sources, &all_widths());
        let found = found
            .iter()
            .find(|s| s.source.radius < 0.2)
            .expect("the lamp")
            .source;
        let flux = 50.0 * 2.0 * PI * (1.0 - lamp.angular_radius.cos());
        assert!((found.flux.x / flux - 1.0).abs() < 0.15, "{found:?} {flux}");
        assert!(
            (found.radius / lamp.angular_radius - 1.0).abs() < 0.15,
            "{found:?}"
        );
    }

    #[test]
    fn disc_has_its_flux_direction_and_radius() {
        for radius in [0.05_f32, 0.1, 0.2] {
            let (_, sources) = found(radius);
            let source = sources[0].source;
            let flux = 49.9 * 2.0 * PI * (1.0 - radius.cos());
            assert!(
                (source.flux.x / flux - 1.0).abs() < 0.15,
                "{radius}: {source:?}"
            );
            assert!(
                (source.radius / radius - 1.0).abs() < 0.15,
                "{radius}: {source:?}"
            );
            assert!(source.direction.dot(sky(radius).2[0].0.direction) > 0.9999);
        }
    }

    #[test]
    fn levels_leave_out_the_flux_of_sources() {
        let (map, sources) = found(0.1);
        let all = Prefilter::new(SIZE).apply(&sky(0.1).1[0]);
        let mean = super::super::prefilter::level_mean;
        for level in 1..map.levels.len() {
            let removed = mean(&all, level).x - mean(&map, level).x;
            let source = sources[0].source;
            let expected = source.flux.x * source.weights[level] / (4.0 * PI);
            assert!(
                (removed / expected.max(0.01) - 1.0).abs() < 0.1 || expected == 0.0,
                "{level}: {removed} {expected}"
            );
        }
        assert_eq!(map.levels[0], all.levels[0]);
    }

    #[test]
    fn level_with_its_sources_equals_complete_level() {
        let (map, sources) = found(0.06);
        let all = Prefilter::new(SIZE).apply(&sky(0.06).1[0]);
        let (there, beside) = (sources[0].source.direction, Vec3::new(-0.2, 0.6, 0.7));
        for width in [0.3, 0.5, 1.0] {
            for d in [
                there,
                (there + beside * 0.3).normalize(),
                beside.normalize(),
            ] {
                let ours = CompleteMap::new(&map).blurred(Vec3::ZERO, d, width, 0.0).x;
                let truth = CompleteMap::new(&all).blurred(Vec3::ZERO, d, width, 0.0).x;
                assert!(
                    (ours / truth - 1.0).abs() < 0.1,
                    "{width} {d}: {ours} {truth}"
                );
            }
        }
    }

    #[test]
    fn near_source_is_blurred_where_the_point_sees_it() {
        let (grid, [full, without], [(towards, _)]) = sky(0.1);
        let place = LightPlace {
            reference: Vec3::ZERO,
            inverse_distance: 0.5,
        };
        let found = excesses(&grid, &full, &without, &[(towards, place)], &all_widths());
        let map = Prefilter::new(SIZE).apply_without(&full, &found);
        let complete = CompleteMap::new(&map);
        // By the inverse square law as bright as from the reference, at equal angles to the lamp.
        let point = Vec3::new(0.5, 0.5, 0.0);
        let to_lamp = found[0].source.direction * 2.0 - point;
        let nearer = 4.0 / to_lamp.length_squared();
        let turn = Quat::from_rotation_arc(found[0].source.direction, to_lamp.normalize());
        for d in [
            towards.direction,
            Vec3::new(0.4, -0.1, 0.8).normalize(),
            Vec3::Z,
        ] {
            let lamp = |p, d| complete.blurred(p, d, 0.1, 0.0).x - 0.1;
            let (ours, expected) = (lamp(point, turn * d), nearer * lamp(Vec3::ZERO, d));
            assert!(
                (ours - expected).abs() < 0.02 * expected + 0.01,
                "{d}: {ours} {expected}"
            );
        }
    }

    #[test]
    fn map_without_levels_is_dark() {
        let map = CubeMap::default();
        let found = CompleteMap::new(&map).blurred(Vec3::ZERO, Vec3::X, 0.1, 0.0);
        assert_eq!(found, Vec3::ZERO);
    }

    #[test]
    fn weights_are_continuous_in_source_radius() {
        let weight = |radius: f32| found(radius).1.first().map_or(0.0, |s| s.source.weights[2]);
        let all: Vec<f32> = (1..24).map(|i| weight(0.02 * i as f32)).collect();
        assert_eq!((all[3], all[22]), (1.0, 0.0), "{all:?}");
        let largest = all[3..].windows(2).map(|w| (w[1] - w[0]).abs());
        assert!(largest.fold(0.0, f32::max) < 0.25, "{all:?}");
    }

    #[test]
    fn weak_sources_remain_in_map() {
        let (grid, [full, without], disc) = sky(0.05);
        let dimmed = |share: f32| -> Vec<Vec3> {
            let pairs = full.iter().zip(&without);
            pairs.map(|(a, b)| b.lerp(*a, share)).collect()
        };
        let widths = all_widths();
        let found = |share| excesses(&grid, &dimmed(share), &without, &disc, &widths);
        assert!(found(0.005).is_empty());
        let (weak, strong) = (
            found(0.035)[0].source.weights[4],
            found(1.0)[0].source.weights[4],
        );
        assert!(weak > 0.0 && weak < 1.0 && strong == 1.0, "{weak} {strong}");
    }

    #[test]
    fn uniform_sky_has_no_sources() {
        let (grid, [_, without], disc) = sky(0.1);
        let widths = all_widths();
        assert!(excesses(&grid, &without, &without, &disc, &widths).is_empty());
        assert!(excesses(&grid, &without, &without, &[], &widths).is_empty());
    }
}
