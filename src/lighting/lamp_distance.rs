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

use super::adaptive::CompactSource;
use super::light::Harmonics;
use super::sources::LUMINANCE;
use glam::{DVec3, Vec3};

/// A point of a real surface that the scene camera sees.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// World, metres.
    pub position: DVec3,
    /// Unit normal, world.
    pub normal: Vec3,
    /// Natural logarithm of the linear luminance in the picture.
    pub log_luminance: f32,
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

/// A lamp's distance, as far as a picture tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampDistance {
    /// The reciprocal of the distance from the observer, 1/m; 0 if the lamp may be far.
    pub inverse: f32,
    /// Standard deviation of the reciprocal, 1/m.
    pub sigma: f32,
}

/// Spacing of the searched reciprocals, 1/m, in the first and in the second step.
const STEPS: [f32; 2] = [0.2, 0.05];
/// Largest reciprocal, 1/m: no lamp is nearer than 0.2 m.
const NEAREST: f32 = 5.0;
/// Distances of compared points, in points of the grid.
const OFFSETS: [usize; 3] = [1, 3, 6];
/// Side of the parts of the picture that count as independent, points of the grid.
const BLOCK: usize = 8;
/// Limits of the loss's scale: of differences by noise, and by texture.
const SCALE: (f32, f32) = (0.05, 0.25);
/// Student's t from which an improvement is significant.
const SIGNIFICANT: f32 = 3.0;
/// Least cosine between the normals of compared points.
const SAME_NORMAL: f32 = 0.9;
/// Largest angular radius of a lamp, radians, whose shadows tell a distance.
const LARGEST: f32 = 0.25;

/// Losses in the parts of the picture.
type Losses = Vec<f32>;

/// The search for the distances of lamps in one picture.
pub struct DistanceSearch<'a> {
    surfaces: &'a SeenSurfaces,
    observer: DVec3,
    blocked: &'a Blocked<'a>,
    /// Luminance of the irradiance of each point by everything but the lamps.
    rest: Vec<f32>,
    /// The same by each lamp, at its current distance.
    by_lamp: Vec<Vec<f32>>,
    lamps: Vec<CompactSource>,
    scale: f32,
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
            p.map_or(0.0, |p| {
                irradiance.irradiance(p.normal).dot(LUMINANCE).max(1e-6)
            })
        };
        let mut search = Self {
            surfaces,
            observer,
            blocked,
            rest: surfaces.points.iter().map(rest).collect(),
            by_lamp: Vec::new(),
            lamps: lamps.to_vec(),
            scale: SCALE.1,
        };
        let by_lamp = lamps
            .iter()
            .map(|lamp| search.irradiance(lamp, lamp.inverse_distance));
        search.by_lamp = by_lamp.collect();
        search.scale = search.texture_scale();
        search
    }

    /// Finds the distance of lamp number `lamp`, `anywhere` or near the one that is known, and uses
    /// it from now on. `None` if the lamp is too large for its shadows to tell.
    pub fn find(&mut self, lamp: usize, anywhere: bool) -> Option<LampDistance> {
        let source = *self.lamps.get(lamp)?;
        if source.angular_radius > LARGEST {
            return None;
        }
        let far = self.losses(lamp, &self.irradiance(&source, 0.0));
        let mut looked: Vec<(f32, Losses)> = vec![(0.0, far)];
        let around = if anywhere {
            self.look(lamp, 0.0, STEPS[0], NEAREST, &mut looked);
            best(&looked)
        } else {
            source.inverse_distance
        };
        let low = (around - STEPS[0]).max(STEPS[1]);
        self.look(
            lamp,
            low - STEPS[1],
            STEPS[1],
            around + STEPS[0],
            &mut looked,
        );
        let found = judged(&looked);
        self.lamps[lamp].inverse_distance = found.inverse;
        self.by_lamp[lamp] = self.irradiance(&self.lamps[lamp], found.inverse);
        Some(found)
    }

    /// Adds the losses for the reciprocals after `from` up to `to`, `step` apart.
    fn look(&self, lamp: usize, from: f32, step: f32, to: f32, looked: &mut Vec<(f32, Losses)>) {
        let mut inverse = from + step;
        while inverse <= to + 0.5 * step {
            if looked
                .iter()
                .all(|(known, _)| (known - inverse).abs() > 0.01)
            {
                let light = self.irradiance(&self.lamps[lamp], inverse);
                looked.push((inverse, self.losses(lamp, &light)));
            }
            inverse += step;
        }
    }

    /// Luminance of each point's irradiance by a lamp at a distance of 1/`inverse`.
    fn irradiance(&self, lamp: &CompactSource, inverse: f32) -> Vec<f32> {
        let samples = samples(lamp.angular_radius);
        let flux = lamp.irradiance.dot(LUMINANCE).max(0.0);
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
            flux * share * (cosine / length.powi(3)) as f32
        };
        self.surfaces.points.iter().map(at).collect()
    }

    /// The losses with other light from lamp number `lamp`.
    fn losses(&self, lamp: usize, light: &[f32]) -> Losses {
        let log = self.log_irradiance(Some((lamp, light)));
        let mut losses = vec![0.0; self.block_count()];
        self.compare(&log, |block, difference| {
            let square = (difference / self.scale).powi(2);
            losses[block] += square / (1.0 + square);
        });
        losses
    }

    /// Logarithms of the irradiance of all points, with other light from a lamp.
    fn log_irradiance(&self, other: Option<(usize, &[f32])>) -> Vec<f32> {
        let mut sum = self.rest.clone();
        for (k, own) in self.by_lamp.iter().enumerate() {
            let light = match other {
                Some((lamp, light)) if lamp == k => light,
                _ => own,
            };
            sum.iter_mut()
                .zip(light)
                .for_each(|(sum, light)| *sum += light);
        }
        sum.iter().map(|sum| sum.max(1e-9).ln()).collect()
    }

    /// Calls `each` with the block and the difference d of each pair of points that are compared.
    fn compare(&self, log: &[f32], mut each: impl FnMut(usize, f32)) {
        let (width, points) = (self.surfaces.width, &self.surfaces.points);
        for (i, point) in points.iter().enumerate() {
            let Some(p) = point else { continue };
            for offset in OFFSETS {
                let in_row = i % width + offset < width;
                let beside = [in_row.then_some(i + offset), Some(i + offset * width)];
                for k in beside.into_iter().flatten() {
                    let Some(Some(q)) = points.get(k) else {
                        continue;
                    };
                    if q.surface == p.surface && q.normal.dot(p.normal) > SAME_NORMAL {
                        let seen = p.log_luminance - q.log_luminance;
                        each(self.block(i), seen - (log[i] - log[k]));
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
        self.compare(&self.log_irradiance(None), |_, d| all.push(d.abs()));
        if all.is_empty() {
            return SCALE.1;
        }
        let middle = all.len() / 2;
        let (_, median, _) = all.select_nth_unstable_by(middle, f32::total_cmp);
        (1.5 * *median).clamp(SCALE.0, SCALE.1)
    }
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

/// The reciprocal with the least loss.
fn best(looked: &[(f32, Losses)]) -> f32 {
    let total = |losses: &Losses| losses.iter().sum::<f32>();
    let least = looked
        .iter()
        .min_by(|a, b| total(&a.1).total_cmp(&total(&b.1)));
    least.map_or(0.0, |(inverse, _)| *inverse)
}

/// Student's t of the improvement from one set of losses to another over the blocks in which they
/// differ.
fn improvement(from: &Losses, to: &Losses) -> f32 {
    let differences = from.iter().zip(to).map(|(a, b)| a - b);
    let (mut sum, mut squares) = (0.0, 0.0);
    for d in differences {
        sum += d;
        squares += d * d;
    }
    sum / squares.max(1e-12).sqrt()
}

/// The best reciprocal if it is significantly better than 0, with its standard deviation.
fn judged(looked: &[(f32, Losses)]) -> LampDistance {
    let inverse = best(looked);
    let of = |wanted: f32| looked.iter().find(|(inverse, _)| *inverse == wanted);
    let (Some((_, far)), Some((_, least))) = (of(0.0), of(inverse)) else {
        return LampDistance {
            inverse: 0.0,
            sigma: f32::INFINITY,
        };
    };
    // As far as a reciprocal is less than one standard deviation worse, it may be the right one.
    let alike = looked
        .iter()
        .filter(|(_, losses)| improvement(losses, least) < 1.0);
    let spread = alike
        .map(|(i, _)| (i - inverse).abs())
        .fold(STEPS[1], f32::max);
    let is_near = improvement(far, least) > SIGNIFICANT && inverse > 2.0 * spread;
    LampDistance {
        inverse: if is_near { inverse } else { 0.0 },
        sigma: spread,
    }
}
