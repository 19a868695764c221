//! The distances of lamps, from the shadows of real objects in the scene camera's picture.
//!
//! The environment camera knows the direction u of a lamp, not its distance 1/κ. Seen from real
//! objects beside that camera, the lamp lies in another direction if it is near, and their shadows
//! fall elsewhere. A point p of a known surface has the radiance I(p) = ρ(p)/π E(p; κ), where E
//! adds the light of all lamps, as far as phantoms do not block it, to that of the rest of the
//! environment. The reflectance ρ is unknown, but its traces are not where the shadows are, so the
//! right κ leaves the least differences
//!
//! ```text
//!   d(p, q) = ln I(p) − ln I(q) − (ln E(p; κ) − ln E(q; κ))
//! ```
//!
//! between neighbouring points of a surface, at several distances from each other, measured with a
//! loss that texture and objects without a phantom cannot dominate (Geman and McClure 1985). A
//! lamp is near if that explains the picture better than an infinite distance does, significantly
//! over independent parts of the picture.

mod agreement;
mod faces;

pub use agreement::SurfaceAgreement;

use super::adaptive::CompactSource;
use super::light::Harmonics;
use super::place::LampDistance;
use super::sources::LUMINANCE;
use faces::Faces;
use glam::{DVec3, Vec3};

/// A point of a real surface that the scene camera sees.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// World, metres.
    pub position: DVec3,
    /// Unit normal, world.
    pub normal: Vec3,
    /// Natural logarithms of its linear values in the picture: red, green, blue, luminance.
    pub log_values: [f32; 4],
    /// Which surface it belongs to.
    pub surface: u32,
}

/// What the scene camera sees of real surfaces: a regular grid over its picture, row by row.
#[derive(Clone, Debug, Default)]
pub struct SeenSurfaces {
    /// Points in a row.
    pub width: usize,
    /// `None` where no known surface is seen, or not clearly.
    pub points: Vec<Option<SurfacePoint>>,
}

/// Tests whether anything real stands within a share (third argument) of a ray's direction from its
/// origin (world, metres).
pub type Blocked<'a> = dyn Fn(DVec3, DVec3, f64) -> bool + 'a;

/// Spacing of the searched reciprocals, 1/m, in the first and in the second step.
const STEPS: [f32; 2] = [0.2, 0.05];
/// Largest reciprocal, 1/m: no lamp is nearer than 0.2 m.
const NEAREST: f32 = 5.0;
/// Least reciprocal distance, 1/m, from the last result that is searched once more.
const AGAIN: f32 = 0.4;
/// Distances of compared points, in points of the grid.
const OFFSETS: [usize; 3] = [1, 3, 6];
/// Side of the parts of the picture that count as independent, points of the grid.
const BLOCK: usize = 8;
/// Limits of the loss's scale: of differences by noise, and by texture.
const SCALE: (f32, f32) = (0.05, 0.25);
/// Student's t from which an improvement is significant.
const SIGNIFICANT: f32 = 3.0;
/// The same for more light from a clipped lamp, which has more than its pixels show.
const LIKELY: f32 = 2.0;
/// The same if the shading of phantoms tells it: three faces that agree.
const LIKELY_BY_FACES: f32 = 1.7;
/// Least cosine between the normals of compared points.
const SAME_NORMAL: f32 = 0.9;
/// Largest angular radius of a lamp, radians, whose shadows tell a distance.
const LARGEST: f32 = 0.15;

/// The largest factor on a clipped lamp's light, octaves.
const LAST_OCTAVE: f32 = 11.0;
/// Spacing of the searched factors, octaves, in the first and in the second step.
const OCTAVES: [f32; 2] = [1.0 / 3.0, 1.0 / 12.0];

/// The channel of luminance.
const LUMINANCE_OF: usize = 3;

/// Losses in the parts of the picture.
type Losses = Vec<f32>;

/// The best factor of a search.
struct FoundFactor {
    octaves: f32,
    /// Student's t by which it is better than no factor.
    better: f32,
    /// Whether an octave more or less is significantly worse.
    is_certain: bool,
}

impl FoundFactor {
    /// `looked`: octaves, the first 0, and the losses there.
    fn of(looked: &[(f32, Losses)]) -> Self {
        let octaves = best(looked, 0.0);
        let losses = |wanted: f32| {
            let apart = |(octaves, _): &&(f32, Losses)| (octaves - wanted).abs();
            let nearest = looked.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
            nearest.map_or(&[][..], |(_, losses)| losses.as_slice())
        };
        let least = losses(octaves);
        let worse = |by: f32| improvement(losses(octaves + by), least);
        Self {
            octaves,
            better: improvement(losses(0.0), least),
            is_certain: worse(-1.0).min(worse(1.0)) > LIKELY,
        }
    }

    /// The factor if it is better with this Student's t, else 1. At the end of the range only a bound is
    /// known.
    fn judged(&self, significant: f32) -> f32 {
        let is_better = self.better > significant && self.octaves < LAST_OCTAVE;
        if is_better { self.octaves.exp2() } else { 1.0 }
    }
}

/// The search for the distances of lamps in one picture.
pub struct DistanceSearch<'a> {
    surfaces: &'a SeenSurfaces,
    observer: DVec3,
    blocked: &'a Blocked<'a>,
    /// Irradiance of each point by everything but the lamps: red, green, blue, luminance.
    rest: Vec<[f32; 4]>,
    /// What each lamp's irradiance is multiplied by at each point, at its current distance.
    by_lamp: Vec<Vec<f32>>,
    lamps: Vec<CompactSource>,
    scale: f32,
    faces: Faces,
}

impl<'a> DistanceSearch<'a> {
    /// Prepares the search: `lamps`, strongest first, with the distances that are known so far,
    /// seen from `observer` (world, metres); `irradiance` is that of the rest of the environment.
    #[must_use]
    pub fn new(
        surfaces: &'a SeenSurfaces,
        lamps: &[CompactSource],
        irradiance: &Harmonics,
        observer: DVec3,
        blocked: &'a Blocked<'a>,
    ) -> Self {
        let rest = |p: &Option<SurfacePoint>| {
            let light = p.map_or(Vec3::ZERO, |p| irradiance.irradiance(p.normal));
            values(light.max(Vec3::splat(1e-6)))
        };
        let mut search = Self {
            surfaces,
            observer,
            blocked,
            rest: surfaces.points.iter().map(rest).collect(),
            by_lamp: Vec::new(),
            lamps: lamps.to_vec(),
            scale: SCALE.1,
            faces: Faces::of(surfaces),
        };
        let by_lamp = lamps
            .iter()
            .map(|lamp| search.form(lamp, lamp.distance.inverse));
        search.by_lamp = by_lamp.collect();
        search.scale = search.texture_scale();
        search
    }

    /// Finds the distance of lamp number `lamp`, anywhere or near the one that is known, and uses it
    /// from now on. `None` if the lamp is too large for its shadows to tell.
    pub fn find(&mut self, lamp: usize, known: Option<f32>) -> Option<LampDistance> {
        self.find_within([STEPS[0], NEAREST], lamp, known)
    }

    /// Finds the distance of lamp number `lamp` once more after those of others have changed: near the
    /// last result as far as that was uncertain, anywhere if the lamp seemed to be far.
    pub fn find_again(&mut self, lamp: usize) -> Option<LampDistance> {
        let last = self.lamps.get(lamp)?.distance;
        let range = if last.inverse > 0.0 {
            let reach = AGAIN.max(2.0 * last.sigma);
            let low = (last.inverse - reach).max(STEPS[0]);
            [low, (last.inverse + reach).min(NEAREST)]
        } else {
            [STEPS[0], NEAREST]
        };
        self.find_within(range, lamp, None)
    }

    fn find_within(
        &mut self,
        range: [f32; 2],
        lamp: usize,
        known: Option<f32>,
    ) -> Option<LampDistance> {
        let source = *self.lamps.get(lamp)?;
        if source.angular_radius > LARGEST {
            return None;
        }
        let far = self.losses(lamp, &self.form(&source, 0.0));
        let mut looked: Vec<(f32, Losses)> = vec![(0.0, far)];
        let (around, reach) = if let Some(known) = known {
            looked.push((known, self.losses(lamp, &self.by_lamp[lamp])));
            (known, 2.0 * STEPS[1])
        } else {
            self.look(lamp, range, STEPS[0], &mut looked);
            (best(&looked, 0.0), STEPS[0])
        };
        let low = (around - reach).max(STEPS[1]);
        self.look(lamp, [low, around + reach], STEPS[1], &mut looked);
        let found = judged(&looked, known);
        self.lamps[lamp].distance = found;
        self.by_lamp[lamp] = self.form(&self.lamps[lamp], found.inverse);
        Some(found)
    }

    /// Finds the factor, RGB, on the light of lamp number `lamp` with which the depth of the shadows
    /// agrees best, and uses it from now on; 1 if no other is significantly better. `known` is the
    /// factor that is in the light already: the result times `known` is at least 1. At `first`, the
    /// colour follows the best match, later only what is significantly better.
    pub fn find_factor(&mut self, lamp: usize, known: Vec3, first: bool) -> Vec3 {
        if self.by_lamp.get(lamp).is_none() {
            return Vec3::ONE;
        }
        // Once a lamp is known to be too dark, its factor follows what is seen.
        let is_corrected = known.max_element() > 1.0;
        let significant = if is_corrected { 1.0 } else { LIKELY };
        let range = if is_corrected {
            [-1.0, 1.0]
        } else {
            [0.0, LAST_OCTAVE]
        };
        let (all, by_faces) = self.best_factor(lamp, range, significant);
        let mut found = Vec3::splat(all);
        if is_corrected || all != 1.0 {
            // The colour of clipped pixels is that of the camera's white.
            let significant = if first { f32::MIN } else { 1.0 };
            for channel in 0..3 {
                let start = (Vec3::splat(all), [-1.0, 1.0]);
                let best = self.search_factor(channel, lamp, start, by_faces);
                found[channel] *= best.judged(significant);
            }
        }
        let found = found.max(known.recip());
        self.lamps[lamp].irradiance *= found;
        self.scale = self.texture_scale();
        found
    }

    /// Returns the best factor within a range of octaves on the light of a lamp, 1 if it is not better
    /// with a Student's t of `significant`; and whether the faces of phantoms tell it, because shadows
    /// do not.
    fn best_factor(&self, lamp: usize, range: [f32; 2], significant: f32) -> (f32, bool) {
        let search =
            |with_faces| self.search_factor(LUMINANCE_OF, lamp, (Vec3::ONE, range), with_faces);
        let by_shadows = search(false);
        if by_shadows.better > significant || by_shadows.is_certain {
            return (by_shadows.judged(significant), false);
        }
        (search(true).judged(significant.min(LIKELY_BY_FACES)), true)
    }

    /// Finds the best factor within a range of octaves on the light of a lamp in a channel, in addition to
    /// `start`, by shadows alone or by faces, too.
    fn search_factor(
        &self,
        channel: usize,
        lamp: usize,
        (start, [low, high]): (Vec3, [f32; 2]),
        with_faces: bool,
    ) -> FoundFactor {
        let light = self.lamps[lamp].irradiance * start;
        let losses = |octaves: f32| {
            let other = (self.by_lamp[lamp].as_slice(), light * octaves.exp2());
            let log = self.log_irradiance(channel, Some((lamp, other)));
            let mut losses = self.losses_of(channel, &log);
            if with_faces {
                losses.extend(self.faces.losses(self.surfaces, channel, &log));
            }
            (octaves, losses)
        };
        let steps = ((high - low) / OCTAVES[0]).round() as i32;
        let coarse = (0..=steps).map(|k| low + OCTAVES[0] * k as f32);
        let mut looked = vec![losses(0.0)];
        looked.extend(coarse.filter(|octaves| *octaves != 0.0).map(losses));
        let around = best(&looked, 0.0);
        let fine = [-3, -2, -1, 1, 2, 3].map(|k| around + OCTAVES[1] * k as f32);
        looked.extend(fine.map(losses));
        FoundFactor::of(&looked)
    }

    /// Adds the losses for the reciprocals of a range, `step` apart.
    fn look(&self, lamp: usize, [low, high]: [f32; 2], step: f32, looked: &mut Vec<(f32, Losses)>) {
        let steps = ((high - low) / step).round() as i32;
        for inverse in (0..=steps).map(|k| low + step * k as f32) {
            if looked
                .iter()
                .all(|(known, _)| (known - inverse).abs() > 0.01)
            {
                let form = self.form(&self.lamps[lamp], inverse);
                looked.push((inverse, self.losses(lamp, &form)));
            }
        }
    }

    /// What the irradiance of a lamp at a distance of 1/`inverse` is multiplied by at each point.
    fn form(&self, lamp: &CompactSource, inverse: f32) -> Vec<f32> {
        let samples = samples(lamp.angular_radius);
        let (right, up) = lamp.direction.any_orthonormal_pair();
        let radius = lamp.angular_radius.tan();
        let offsets: Vec<Vec3> = (0..samples)
            .map(|k| disc(k, samples) * radius)
            .map(|at| right * at.x + up * at.y)
            .collect();
        let inverse = f64::from(inverse);
        let at = |point: &Option<SurfacePoint>| {
            let Some(p) = point else { return 0.0 };
            let shift = (self.observer - p.position) * inverse;
            let to = lamp.direction.as_dvec3() + shift;
            let cosine = to.dot(p.normal.as_dvec3());
            if cosine <= 0.0 {
                return 0.0;
            }
            let origin = p.position + 1e-3 * p.normal.as_dvec3();
            let farthest = if inverse > 0.0 { inverse.recip() } else { 1e9 };
            let seen = |offset: &&Vec3| !(self.blocked)(origin, to + offset.as_dvec3(), farthest);
            let share = offsets.iter().filter(seen).count() as f32 / samples as f32;
            let length = to.length().max(0.05);
            share * (cosine / length.powi(3)) as f32
        };
        self.surfaces.points.iter().map(at).collect()
    }

    /// The losses of luminance with another form of lamp number `lamp`.
    fn losses(&self, lamp: usize, form: &[f32]) -> Losses {
        let light = self.lamps[lamp].irradiance;
        self.channel_losses(LUMINANCE_OF, lamp, (form, light))
    }

    /// The losses in a channel with another form and irradiance of a lamp.
    fn channel_losses(&self, channel: usize, lamp: usize, other: (&[f32], Vec3)) -> Losses {
        self.losses_of(channel, &self.log_irradiance(channel, Some((lamp, other))))
    }

    /// The losses in a channel with these logarithms of the irradiance of all points.
    fn losses_of(&self, channel: usize, log: &[f32]) -> Losses {
        let mut losses = vec![0.0; self.block_count()];
        self.compare(channel, log, |block, difference| {
            let square = (difference / self.scale).powi(2);
            losses[block] += square / (1.0 + square);
        });
        losses
    }

    /// Logarithms of the irradiance of all points in a channel, with another form and irradiance of a
    /// lamp.
    fn log_irradiance(&self, channel: usize, other: Option<(usize, (&[f32], Vec3))>) -> Vec<f32> {
        let mut sum: Vec<f32> = self.rest.iter().map(|rest| rest[channel]).collect();
        for (k, (own, lamp)) in self.by_lamp.iter().zip(&self.lamps).enumerate() {
            let (form, light) = match other {
                Some((lamp, other)) if lamp == k => other,
                _ => (own.as_slice(), lamp.irradiance),
            };
            let light = values(light)[channel].max(0.0);
            let each = sum.iter_mut().zip(form);
            each.for_each(|(sum, form)| *sum += light * form);
        }
        sum.iter().map(|sum| sum.max(1e-9).ln()).collect()
    }

    /// Calls `each` with the block and the difference d of each pair of points that are compared.
    fn compare(&self, channel: usize, log: &[f32], mut each: impl FnMut(usize, f32)) {
        self.pairs(&OFFSETS, |i, k, p, q| {
            let seen = p.log_values[channel] - q.log_values[channel];
            each(self.block(i), seen - (log[i] - log[k]));
        });
    }

    /// Calls `each` with the numbers of every two points of one surface, these distances apart in the
    /// grid, and the points.
    fn pairs(
        &self,
        offsets: &[usize],
        mut each: impl FnMut(usize, usize, &SurfacePoint, &SurfacePoint),
    ) {
        let (width, points) = (self.surfaces.width, &self.surfaces.points);
        for (i, point) in points.iter().enumerate() {
            let Some(p) = point else { continue };
            for offset in offsets {
                let in_row = i % width + offset < width;
                let beside = [in_row.then_some(i + offset), Some(i + offset * width)];
                for k in beside.into_iter().flatten() {
                    let Some(Some(q)) = points.get(k) else {
                        continue;
                    };
                    if q.surface == p.surface && q.normal.dot(p.normal) > SAME_NORMAL {
                        each(i, k, p, q);
                    }
                }
            }
        }
    }

    fn block(&self, point: usize) -> usize {
        let (x, y) = (point % self.surfaces.width, point / self.surfaces.width);
        (y / BLOCK) * self.surfaces.width.div_ceil(BLOCK) + x / BLOCK
    }

    fn block_count(&self) -> usize {
        self.surfaces.points.len().checked_sub(1).map_or(0, |last| {
            (last / self.surfaces.width / BLOCK + 1) * self.surfaces.width.div_ceil(BLOCK)
        })
    }

    /// Robust scale of the differences (1.5 MAD): a chequered floor needs a wider loss than a table.
    fn texture_scale(&self) -> f32 {
        let mut all = Vec::new();
        self.compare(
            LUMINANCE_OF,
            &self.log_irradiance(LUMINANCE_OF, None),
            |_, d| all.push(d.abs()),
        );
        if all.is_empty() {
            return SCALE.1;
        }
        let middle = all.len() / 2;
        let (_, median, _) = all.select_nth_unstable_by(middle, f32::total_cmp);
        (1.5 * *median).clamp(SCALE.0, SCALE.1)
    }
}

/// Red, green, blue and luminance of linear light.
fn values(light: Vec3) -> [f32; 4] {
    [light.x, light.y, light.z, light.dot(LUMINANCE)]
}

/// Rays to a lamp of an angular radius.
fn samples(radius: f32) -> usize {
    match radius {
        r if r < 0.02 => 1,
        r if r < 0.06 => 4,
        _ => 8,
    }
}

/// Evenly distributed points of the unit disc (Vogel 1979).
fn disc(k: usize, count: usize) -> glam::Vec2 {
    if count == 1 {
        return glam::Vec2::ZERO;
    }
    let radius = ((k as f32 + 0.5) / count as f32).sqrt();
    glam::Vec2::from_angle(2.399_963_2 * k as f32) * radius
}

/// The value with the least loss; `otherwise` without any.
fn best(looked: &[(f32, Losses)], otherwise: f32) -> f32 {
    let total = |losses: &Losses| losses.iter().sum::<f32>();
    let least = looked
        .iter()
        .min_by(|a, b| total(&a.1).total_cmp(&total(&b.1)));
    least.map_or(otherwise, |(value, _)| *value)
}

/// Student's t of the improvement from one set of losses to another over the blocks in which they
/// differ.
fn improvement(from: &[f32], to: &[f32]) -> f32 {
    let differences = from.iter().zip(to).map(|(a, b)| a - b);
    let (mut sum, mut squares) = (0.0, 0.0);
    for d in differences {
        sum += d;
        squares += d * d;
    }
    sum / squares.max(1e-12).sqrt()
}

/// The best reciprocal, with its standard deviation, if it is significantly better than 0; of a
/// lamp whose reciprocal is `known`, that one unless another is better.
fn judged(looked: &[(f32, Losses)], known: Option<f32>) -> LampDistance {
    let mut inverse = best(looked, 0.0);
    let losses = |wanted: f32| {
        let found = looked.iter().find(|(inverse, _)| *inverse == wanted);
        found.map_or(&[][..], |(_, losses)| losses.as_slice())
    };
    if let Some(known) = known {
        let needed = if inverse == 0.0 { SIGNIFICANT } else { 1.0 };
        if improvement(losses(known), losses(inverse)) < needed {
            inverse = known;
        }
    }
    // As far as a reciprocal is less than one standard deviation worse, it may be the right one.
    let least = losses(inverse);
    let alike = looked.iter().filter(|(_, l)| improvement(l, least) < 1.0);
    let sigma = alike
        .map(|(i, _)| (i - inverse).abs())
        .fold(STEPS[1], f32::max);
    let is_near = improvement(losses(0.0), least) > SIGNIFICANT && inverse > 2.0 * sigma;
    LampDistance {
        inverse: match known {
            Some(known) if known == inverse => known,
            None if !is_near => 0.0,
            _ => between_steps(looked, inverse),
        },
        sigma,
    }
}

/// The minimum of the parabola through the losses of the best reciprocal and its neighbours.
fn between_steps(looked: &[(f32, Losses)], best: f32) -> f32 {
    let total = |wanted: f32| {
        let found = looked.iter().find(|(i, _)| (i - wanted).abs() < 0.01)?;
        Some(found.1.iter().sum::<f32>())
    };
    let (before, after) = (total(best - STEPS[1]), total(best + STEPS[1]));
    let (Some(before), Some(least), Some(after)) = (before, total(best), after) else {
        return best;
    };
    let curvature = before + after - 2.0 * least;
    let shift = if curvature > 0.0 {
        0.5 * (before - after) / curvature
    } else {
        0.0
    };
    best + STEPS[1] * shift.clamp(-0.5, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_numerics::Random;

    /// Boxes, each seen from above and from two sides, on a ground, in the light of a lamp overhead
    /// and of the sky; the sides of some are `painted` half as bright.
    pub fn overhead(boxes: usize, painted: usize) -> (SeenSurfaces, CompactSource) {
        let lamp = CompactSource {
            id: 0,
            direction: Vec3::Z,
            irradiance: Vec3::splat(2.0),
            angular_radius: 0.01,
            distance: LampDistance::FAR,
            position: None,
            clipped: 0.0,
            lights: 1,
        };
        let mut random = Random::new(5);
        let mut point = |surface: u32, normal: Vec3, albedo: f32| {
            let lit = sky().irradiance(normal).x + 2.0 * normal.z.max(0.0);
            let noise = 0.02 * random.normal() as f32;
            Some(SurfacePoint {
                position: DVec3::ZERO,
                normal,
                log_values: [(lit * albedo).ln() + noise; 4],
                surface,
            })
        };
        let mut points = Vec::new();
        for k in 0..=boxes as u32 {
            let dark = if k > 0 && k as usize <= painted {
                0.5
            } else {
                1.0
            };
            let sides = [
                (Vec3::Z, 0.4),
                (Vec3::X, 0.4 * dark),
                (Vec3::NEG_Y, 0.4 * dark),
            ];
            // Surface 0 is the ground.
            for (normal, albedo) in sides.into_iter().take(if k == 0 { 1 } else { 3 }) {
                points.extend((0..40).map(|_| point(k, normal, albedo)));
                // Nothing beside it.
                points.extend([None; 8]);
            }
        }
        (SeenSurfaces { width: 8, points }, lamp)
    }

    /// A ground of 90 by 60 points, 1 cm apart, in the light of `lamps` (position, power) and of a
    /// uniform sky, with a ball on it that blocks light, and texture.
    struct Table {
        lamps: Vec<(DVec3, f32)>,
        balls: Vec<(DVec3, f64)>,
        texture: f32,
    }

    const WIDTH: usize = 90;
    const OBSERVER: DVec3 = DVec3::new(-0.25, 0.1, 0.05);

    fn blocked(balls: &[(DVec3, f64)], origin: DVec3, to: DVec3, farthest: f64) -> bool {
        let direction = to.normalize();
        balls.iter().any(|(centre, radius)| {
            let along = (*centre - origin).dot(direction);
            let apart = (*centre - origin - along * direction).length();
            along > 0.0 && along < farthest * to.length() && apart < *radius
        })
    }

    impl Table {
        fn irradiance(&self, p: DVec3) -> f32 {
            let by = |(lamp, power): &(DVec3, f32)| {
                let to = *lamp - p;
                let open = !blocked(&self.balls, p, to, 1.0);
                power * f32::from(u8::from(open)) * (to.z / to.length().powi(3)) as f32
            };
            0.6 + self.lamps.iter().map(by).sum::<f32>()
        }

        fn seen(&self) -> SeenSurfaces {
            let mut random = Random::new(7);
            let point = |i: usize| {
                let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
                let position = DVec3::new(0.01 * x - 0.45, 0.01 * y - 0.3, 0.0);
                let grain = (40.0 * position.x).sin() as f32 * self.texture;
                let noise = 0.01 * random.normal() as f32;
                let log = self.irradiance(position).ln() + grain + noise;
                Some(SurfacePoint {
                    position,
                    normal: Vec3::Z,
                    log_values: [log; 4],
                    surface: 0,
                })
            };
            SeenSurfaces {
                width: WIDTH,
                points: (0..WIDTH * 60).map(point).collect(),
            }
        }

        fn sources(&self) -> Vec<CompactSource> {
            let each = self.lamps.iter().zip(0..);
            each.map(|((lamp, power), id)| {
                let to = *lamp - OBSERVER;
                CompactSource {
                    id,
                    direction: to.normalize().as_vec3(),
                    irradiance: Vec3::splat(*power / to.length_squared() as f32),
                    angular_radius: 0.01,
                    distance: LampDistance::FAR,
                    position: None,
                    clipped: 0.0,
                    lights: 1,
                }
            })
            .collect()
        }
    }

    pub fn sky() -> Harmonics {
        let mut sky = Harmonics::default();
        sky.coefficients[0] = Vec3::splat(0.6);
        sky
    }

    fn found(table: &Table, known: &[(DVec3, f64)]) -> Vec<LampDistance> {
        let (seen, sources) = (table.seen(), table.sources());
        let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(known, o, to, farthest);
        let mut search = DistanceSearch::new(&seen, &sources, &sky(), OBSERVER, &blocked);
        let all = 0..sources.len();
        for k in all.clone() {
            search.find(k, None);
        }
        all.filter_map(|k| search.find_again(k)).collect()
    }

    const BALLS: [(DVec3, f64); 2] = [
        (DVec3::new(0.1, 0.05, 0.06), 0.05),
        (DVec3::new(-0.1, -0.1, 0.04), 0.04),
    ];

    #[test]
    fn the_distance_of_near_lamps_is_found_and_far_ones_stay_far() {
        for (texture, tolerance) in [(0.0, 0.06), (0.1, 0.08)] {
            let table = Table {
                lamps: vec![
                    (DVec3::new(0.3, -0.2, 0.5), 0.3),
                    (DVec3::new(-0.2, 0.4, 0.8), 0.5),
                    (DVec3::new(-300.0, 100.0, 400.0), 1e5),
                ],
                balls: BALLS.to_vec(),
                texture,
            };
            let found = found(&table, &BALLS);
            for ((lamp, _), found) in table.lamps.iter().zip(&found) {
                let expected = lamp.distance(OBSERVER).recip() as f32;
                let error = (found.inverse - expected).abs();
                assert!(error < tolerance, "{lamp}: {found:?} for {expected}");
            }
        }
    }

    #[test]
    fn lamps_that_hide_each_others_distances_are_found_together() {
        // Until the others have a place, the nearest seems to be elsewhere, and to be far.
        let lamps = vec![
            (DVec3::new(-0.45, -0.2, 0.4), 0.3),
            (DVec3::new(0.1, -0.95, 0.75), 0.9),
            (DVec3::new(0.46, 0.0, 0.5), 0.5),
        ];
        let table = Table {
            lamps,
            balls: BALLS.to_vec(),
            texture: 0.05,
        };
        for ((lamp, _), found) in table.lamps.iter().zip(found(&table, &BALLS)) {
            let expected = lamp.distance(OBSERVER).recip() as f32;
            let error = (found.inverse - expected).abs() / expected;
            assert!(error < 0.05, "{lamp}: {found:?} for {expected}");
        }
    }

    #[test]
    fn without_known_shadows_the_fall_off_of_light_tells_and_foreign_shadows_do_not() {
        let lamps = vec![(DVec3::new(0.3, -0.2, 0.5), 0.3)];
        let mut table = Table {
            lamps,
            balls: BALLS.to_vec(),
            texture: 0.1,
        };
        let expected = table.lamps[0].0.distance(OBSERVER).recip() as f32;
        let by_fall_off = found(&table, &[])[0].inverse;
        assert!(
            (by_fall_off - expected).abs() < 0.15,
            "{by_fall_off} for {expected}"
        );
        table.lamps[0] = (DVec3::new(300.0, -200.0, 500.0), 2e5);
        table.balls.push((DVec3::new(0.25, -0.15, 0.05), 0.05));
        assert_eq!(found(&table, &BALLS)[0].inverse, 0.0);
    }

    #[test]
    fn the_depth_of_shadows_tells_how_bright_a_clipped_lamp_is() {
        let table = Table {
            lamps: vec![(DVec3::new(0.3, -0.2, 0.5), 0.3)],
            balls: BALLS.to_vec(),
            texture: 0.1,
        };
        let (seen, mut sources) = (table.seen(), table.sources());
        let lost = Vec3::new(0.5, 0.4, 0.3);
        sources[0].irradiance *= lost;
        let blocked = |o: DVec3, to: DVec3, farthest: f64| blocked(&BALLS, o, to, farthest);
        let mut search = DistanceSearch::new(&seen, &sources, &sky(), OBSERVER, &blocked);
        search.find(0, None);
        let mut factor = Vec3::ONE;
        for _ in 0..3 {
            factor *= search.find_factor(0, factor, true);
        }
        let error = (factor * lost - 1.0).abs().max_element();
        assert!(error < 0.08, "{factor} for {}", lost.recip());
    }
}
