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
mod energy;
mod faces;
mod openness;
mod search;
mod unseen;

pub use agreement::SurfaceAgreement;
pub use energy::Colour;
pub use openness::Occluders;
pub use unseen::{Hiding, UnseenLamp};

use super::adaptive::CompactSource;
use super::light::Harmonics;
use super::place::LampDistance;
use super::sources::LUMINANCE;
use faces::Faces;
use glam::{DVec3, Vec3};
use openness::openness;

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

impl SurfacePoint {
    /// Whether a point is of the same surface, on the same side of it.
    fn is_beside(&self, other: &Self) -> bool {
        self.surface == other.surface && self.normal.dot(other.normal) > SAME_NORMAL
    }
}

/// What the scene camera sees of real surfaces: a regular grid over its picture, row by row.
#[derive(Clone, Debug, Default)]
pub struct SeenSurfaces {
    /// Points in a row.
    pub width: usize,
    /// `None` where no known surface is seen, or not clearly.
    pub points: Vec<Option<SurfacePoint>>,
}

/// A lamp as the environment camera sees it.
#[derive(Clone, Debug)]
pub struct SeenLamp {
    /// What is known of it.
    pub source: CompactSource,
    /// Unit vectors from the observer to parts of it with equal energy, world; at least one.
    pub parts: Vec<Vec3>,
    /// Whether it clips and its energy was not estimated yet: its distance is searched with any.
    pub is_energy_unknown: bool,
}

impl SeenLamp {
    /// Returns the number of parts that describe a lamp of an angular radius, radians.
    #[must_use]
    pub fn part_count(radius: f32) -> usize {
        match radius {
            r if r < 0.02 => 1,
            r if r < 0.06 => 4,
            _ => 8,
        }
    }
}

/// Tests whether anything real stands within a share (third argument) of a ray's direction from its
/// origin (world, metres).
pub type Blocked<'a> = dyn Fn(DVec3, DVec3, f64) -> bool + Sync + 'a;

/// Distances of compared points, in points of the grid.
const OFFSETS: [usize; 3] = [1, 3, 6];
/// Side of the parts of the picture that count as independent, points of the grid.
const BLOCK: usize = 8;
/// Limits of the loss's scale: of differences by noise, and by texture.
const SCALE: (f32, f32) = (0.05, 0.25);
/// Least cosine between the normals of compared points.
const SAME_NORMAL: f32 = 0.9;

/// Places within the part of the picture that a point stands for, steps of the grid along rows and columns.
const WITHIN: [(f64, f64); 4] = [(-0.1, -0.3), (0.3, -0.1), (0.1, 0.3), (-0.3, 0.1)];

/// Angular radius, radians, from which the shadows of a lamp are soft.
const WIDE: f32 = 0.1;

/// The channel of luminance.
const LUMINANCE_OF: usize = 3;

/// Losses in the parts of the picture.
type Losses = Vec<f32>;

/// The search for the distances of lamps in one picture.
pub struct DistanceSearch<'a> {
    surfaces: &'a SeenSurfaces,
    observer: DVec3,
    blocked: &'a Blocked<'a>,
    /// Irradiance of each point by everything but the lamps: red, green, blue, luminance.
    rest: Vec<[f32; 4]>,
    /// What each lamp's irradiance is multiplied by at each point, at its current distance.
    by_lamp: Vec<Vec<f32>>,
    lamps: Vec<SeenLamp>,
    /// By how many octaves each lamp whose energy is unknown is taken to be brighter.
    assumed: Vec<f32>,
    scale: f32,
    faces: Faces,
    pairs: Vec<Pair>,
    /// Whether sharp edges of shadows are as soft as the parts of the picture are large that points stand for.
    smooths: bool,
}

/// Two points that are compared.
struct Pair {
    points: [u32; 2],
    /// The part of the picture that they count for.
    block: u32,
    /// What the logarithms of their values differ by in the picture: red, green, blue, luminance.
    seen: [f32; 4],
}

impl<'a> DistanceSearch<'a> {
    /// Prepares the search: `lamps`, strongest first, with the distances that are known so far,
    /// seen from `observer` (world, metres); `irradiance` is that of the rest of the environment, and
    /// `occluders` tell what hides a part of it, if that is known.
    #[must_use]
    pub fn new(
        surfaces: &'a SeenSurfaces,
        lamps: &[SeenLamp],
        (irradiance, occluders): (&Harmonics, Option<&Occluders<'_>>),
        observer: DVec3,
        blocked: &'a Blocked<'a>,
    ) -> Self {
        let seen = occluders.map(|occluders| openness(surfaces, irradiance, occluders));
        let rest = |(i, p): (usize, &Option<SurfacePoint>)| {
            let light = p.map_or(Vec3::ZERO, |p| irradiance.irradiance(p.normal));
            let seen = seen
                .as_ref()
                .map_or(light, |seen| light * seen[i].open + seen[i].reflected);
            values(seen.max(Vec3::splat(1e-6)))
        };
        let mut search = Self {
            surfaces,
            observer,
            blocked,
            rest: surfaces.points.iter().enumerate().map(rest).collect(),
            by_lamp: Vec::new(),
            lamps: lamps.to_vec(),
            assumed: vec![0.0; lamps.len()],
            scale: SCALE.1,
            faces: Faces::of(surfaces),
            pairs: Vec::new(),
            smooths: false,
        };
        search.pairs = search.compared();
        let by_lamp = lamps
            .iter()
            .map(|lamp| search.form(lamp, lamp.source.distance.inverse));
        search.by_lamp = by_lamp.collect();
        search.scale = search.texture_scale();
        search
    }

    /// What the irradiance of a lamp at a distance of 1/`inverse` is multiplied by at each point.
    fn form(&self, lamp: &SeenLamp, inverse: f32) -> Vec<f32> {
        let points = &self.surfaces.points;
        let by_parts = |point: &Option<SurfacePoint>, is_seen: &dyn Fn(DVec3, DVec3) -> bool| {
            point.map_or(0.0, |p| self.by_parts(lamp, inverse, &p, is_seen))
        };
        let farthest = if inverse > 0.0 {
            f64::from(inverse).recip()
        } else {
            1e9
        };
        let is_seen = |origin, to| !(self.blocked)(origin, to, farthest);
        if lamp.source.angular_radius < WIDE {
            let form = points.iter().map(|p| by_parts(p, &is_seen)).collect();
            if self.smooths && lamp.parts.len() == 1 {
                return self.with_smooth_edges(form, |p| by_parts(&Some(p), &is_seen));
            }
            return form;
        }
        // Where shadows are soft, every second point tells what is between.
        let is_traced =
            |i: usize| (i % self.surfaces.width + i / self.surfaces.width).is_multiple_of(2);
        let mut form: Vec<f32> = points.iter().map(|p| by_parts(p, &|_, _| true)).collect();
        let traced = |(i, (p, open)): (usize, (&Option<SurfacePoint>, &f32))| {
            let is_traced = is_traced(i) && *open > 0.0;
            is_traced.then(|| by_parts(p, &is_seen) / open)
        };
        let shares: Vec<Option<f32>> = points.iter().zip(&form).enumerate().map(traced).collect();
        for i in 0..form.len() {
            if form[i] > 0.0 {
                let beside = || self.share_beside(&shares, i);
                let share = shares[i].or_else(beside);
                form[i] =
                    share.map_or_else(|| by_parts(&points[i], &is_seen), |share| share * form[i]);
            }
        }
        form
    }

    /// The same light, at the sharp edges of shadows its mean over what a point of the grid stands for.
    fn with_smooth_edges(&self, form: Vec<f32>, light: impl Fn(SurfacePoint) -> f32) -> Vec<f32> {
        let points = &self.surfaces.points;
        let smooth = |(i, here): (usize, &f32)| {
            let Some(p) = points[i] else { return *here };
            let beside = self.beside(i).map(|k| {
                let k = k.filter(|k| *k < points.len())?;
                points[k].filter(|q| q.is_beside(&p)).map(|q| (q, form[k]))
            });
            let is_edge = |there: f32| (there > 0.0) != (*here > 0.0);
            if !beside.iter().flatten().any(|(_, there)| is_edge(*there)) {
                return *here;
            }
            // A step of the grid along rows and columns.
            let step = |before: usize, after: usize| {
                let to =
                    |k: usize| beside[k].map(|(q, _): (SurfacePoint, f32)| q.position - p.position);
                let back = || to(before).map(|to| -to);
                to(after).or_else(back).unwrap_or_default()
            };
            let (right, down) = (step(0, 1), step(2, 3));
            let sum: f32 = WITHIN
                .iter()
                .map(|(x, y)| {
                    let position = p.position + right * *x + down * *y;
                    light(SurfacePoint { position, ..p })
                })
                .sum();
            sum / WITHIN.len() as f32
        };
        form.iter().enumerate().map(smooth).collect()
    }

    /// The same at one point, with those parts of the lamp that it sees, in directions from an origin.
    fn by_parts(
        &self,
        lamp: &SeenLamp,
        inverse: f32,
        point: &SurfacePoint,
        is_seen: impl Fn(DVec3, DVec3) -> bool,
    ) -> f32 {
        let seen_from = self.observer + lamp.source.viewpoint.as_dvec3();
        let shift = (seen_from - point.position) * f64::from(inverse);
        let normal = point.normal.as_dvec3();
        let origin = point.position + 1e-3 * normal;
        let by_part = |part: &Vec3| {
            let to = part.as_dvec3() + shift;
            let cosine = to.dot(normal);
            if cosine <= 0.0 || !is_seen(origin, to) {
                return 0.0;
            }
            cosine / to.length().max(0.05).powi(3)
        };
        let sum: f64 = lamp.parts.iter().map(by_part).sum();
        (sum / lamp.parts.len() as f64) as f32
    }

    /// The numbers of the points beside one in the grid; the last may be beyond its end.
    fn beside(&self, i: usize) -> [Option<usize>; 4] {
        let width = self.surfaces.width;
        [
            (!i.is_multiple_of(width)).then(|| i - 1),
            (i % width + 1 < width).then_some(i + 1),
            i.checked_sub(width),
            Some(i + width),
        ]
    }

    /// The mean of the shares of a lamp that are seen from the points beside one on the same surface.
    fn share_beside(&self, shares: &[Option<f32>], i: usize) -> Option<f32> {
        let points = &self.surfaces.points;
        let p = points[i]?;
        let (mut sum, mut count) = (0.0, 0);
        for k in self.beside(i).into_iter().flatten() {
            let (Some(Some(q)), Some(Some(share))) = (points.get(k), shares.get(k)) else {
                continue;
            };
            if q.is_beside(&p) {
                sum += share;
                count += 1;
            }
        }
        (count > 0).then(|| sum / count as f32)
    }

    /// The losses in a channel with these logarithms of the irradiance of all points.
    fn losses_of(&self, channel: usize, log: &[f32]) -> Losses {
        self.losses_of_every(1, channel, log)
    }

    /// The same, of every so many pairs.
    fn losses_of_every(&self, every: usize, channel: usize, log: &[f32]) -> Losses {
        let mut losses = vec![0.0; self.block_count()];
        let pairs = self.pairs.iter().step_by(every);
        self.compare(pairs, channel, log, |block, difference| {
            let square = (difference / self.scale).powi(2);
            losses[block] += square / (1.0 + square);
        });
        losses
    }

    /// Logarithms of the irradiance of all points in a channel, with another form and irradiance of a
    /// lamp.
    fn log_irradiance(&self, channel: usize, other: Option<(usize, (&[f32], Vec3))>) -> Vec<f32> {
        let mut sum = self.irradiance_without(channel, other.map(|(lamp, _)| lamp));
        if let Some((_, (form, light))) = other {
            add(&mut sum, form, values(light)[channel]);
        }
        sum.iter_mut().for_each(|sum| *sum = sum.max(1e-9).ln());
        sum
    }

    /// The irradiance of all points in a channel, without a lamp.
    fn irradiance_without(&self, channel: usize, without: Option<usize>) -> Vec<f32> {
        let mut sum: Vec<f32> = self.rest.iter().map(|rest| rest[channel]).collect();
        self.add_lamps(&mut sum, channel, |k| without != Some(k));
        sum
    }

    /// Adds the irradiance of all points by some lamps in a channel.
    fn add_lamps(&self, sum: &mut [f32], channel: usize, is_one: impl Fn(usize) -> bool) {
        for (k, form) in self.by_lamp.iter().enumerate().filter(|(k, _)| is_one(*k)) {
            add(sum, form, values(self.light(k))[channel]);
        }
    }

    /// The irradiance by a lamp, RGB, that is assumed.
    fn light(&self, lamp: usize) -> Vec3 {
        self.lamps[lamp].source.irradiance * self.assumed[lamp].exp2()
    }

    /// Calls `each` with the block and the difference d of each pair of points.
    fn compare<'p>(
        &self,
        pairs: impl IntoIterator<Item = &'p Pair>,
        channel: usize,
        log: &[f32],
        mut each: impl FnMut(usize, f32),
    ) {
        for pair in pairs {
            let [i, k] = pair.points.map(|point| point as usize);
            each(pair.block as usize, pair.seen[channel] - (log[i] - log[k]));
        }
    }

    /// The pairs of points that are compared.
    fn compared(&self) -> Vec<Pair> {
        let mut pairs = Vec::with_capacity(2 * OFFSETS.len() * self.surfaces.points.len());
        self.every_two(&OFFSETS, |i, k, p, q| {
            pairs.push(Pair {
                points: [i as u32, k as u32],
                block: self.block(i) as u32,
                seen: std::array::from_fn(|c| p.log_values[c] - q.log_values[c]),
            });
        });
        pairs
    }

    /// Calls `each` with the numbers of every two points of one surface, these distances apart in the
    /// grid, and the points.
    fn every_two(
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
                    if q.is_beside(p) {
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
            &self.pairs,
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

/// Adds a lamp's light, `light` times its form, to each sum.
fn add(sums: &mut [f32], form: &[f32], light: f32) {
    let light = light.max(0.0);
    let each = sums.iter_mut().zip(form);
    each.for_each(|(sum, form)| *sum += light * form);
}

/// Red, green, blue and luminance of linear light.
fn values(light: Vec3) -> [f32; 4] {
    [light.x, light.y, light.z, light.dot(LUMINANCE)]
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

#[cfg(test)]
mod tests;
