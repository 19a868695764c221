//! Completes lamps of which something real hides a part from the environment camera.
//!
//! Most lamps are round from every side. Where the edge of a source that ends at unseen pixels lies on a
//! circle, the rest of that circle is as bright as what is seen of it. The circle's plane v·d = 1 is fitted
//! to the directions d of the edge by least squares; its cone has the axis v/|v| and cos r = 1/|v|.

use super::cube::tangent_frame;
use super::resample::PixelDirections;
use super::sources::{LUMINANCE, Source};
use glam::{DVec3, Vec3};
use penumbra_numerics::fixed_size::solve;
use penumbra_numerics::smoothstep;
use std::f32::consts::{PI, TAU};

/// Least number of points on the edge.
const MIN_POINTS: usize = 8;
/// Pixels around an unseen one that may show a part of what hides the lamp.
const MARGIN: i64 = 2;
/// Distance of the edge from the circle (root mean square), relative to its radius, up to which the lamp is
/// completed, and from which it is not.
const MISFIT: (f32, f32) = (0.04, 0.08);
/// The same for the largest angle, radians, over which no edge is seen.
const GAP: (f32, f32) = (4.4, 5.0);
/// Points in the cone.
const POINTS: usize = 256;
/// Fraction of a turn from one of them to the next (golden angle).
const GOLDEN: f32 = 0.381_966;
/// Share of the greatest radiance from which a sample shows the lamp alone.
const CORE: f32 = 0.75;

/// Adds to a source what is hidden of it. `radiance` is that of the picture's pixels.
pub(super) fn complete(source: &mut Source, pixels: &PixelDirections, radiance: &[Vec3]) {
    let Some(core) = core(source, pixels) else {
        return;
    };
    let above = |i: usize| (radiance[i] - source.background).dot(LUMINANCE);
    let edge = edge(source, pixels, 0.5 * core.dot(LUMINANCE), above);
    let Some(cone) = edge.and_then(|edge| Cone::through(&edge)) else {
        return;
    };
    let size = PI * cone.radius.powi(2);
    let flux = core * (cone.certainty * size / POINTS as f32);
    let reach = 0.75 * mean_size(source, pixels).sqrt();
    let is_seen = |d: Vec3| {
        let near = |(i, _): &(u32, Vec3)| pixels.directions[*i as usize].distance(d) < reach;
        source.parts.iter().any(near)
    };
    let hidden = cone.points().filter(|d| !is_seen(*d)).map(|d| (d, flux));
    source.hidden = hidden.collect();
    let mut centre = source.direction * source.flux.dot(LUMINANCE);
    for (direction, flux) in &source.hidden {
        source.flux += *flux;
        centre += *direction * flux.dot(LUMINANCE);
    }
    source.direction = centre.try_normalize().unwrap_or(source.direction);
    source.solid_angle += (size.max(source.solid_angle) - source.solid_angle) * cone.certainty;
}

/// Radiance of a source above its background, without the samples on its edge.
fn core(source: &Source, pixels: &PixelDirections) -> Option<Vec3> {
    let radiance = |(i, flux): &(u32, Vec3)| *flux / pixels.solid_angles[*i as usize];
    let most = source.parts.iter().map(|p| radiance(p).dot(LUMINANCE));
    let least = CORE * most.fold(0.0, f32::max);
    let inside = source.parts.iter().map(radiance);
    let (sum, count) = inside
        .filter(|l| l.dot(LUMINANCE) > least)
        .fold((Vec3::ZERO, 0.0), |(sum, count), l| (sum + l, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

fn mean_size(source: &Source, pixels: &PixelDirections) -> f32 {
    let sizes = source
        .parts
        .iter()
        .map(|(i, _)| pixels.solid_angles[*i as usize]);
    sizes.sum::<f32>() / source.parts.len().max(1) as f32
}

/// Directions to the edge of a source, where its light falls to `level`; `None` if it ends at no unseen pixel.
fn edge(
    source: &Source,
    pixels: &PixelDirections,
    level: f32,
    above: impl Fn(usize) -> f32,
) -> Option<Vec<Vec3>> {
    let around = Around::of(pixels);
    let mut is_cut = false;
    let mut edge = Vec::new();
    for (i, _) in &source.parts {
        let (i, inside) = (*i as usize, above(*i as usize));
        if inside <= level {
            continue;
        }
        for k in around.within(i, 1).filter(|k| around.is_beside(i, *k)) {
            if !around.is_seen(k) {
                is_cut = true;
            } else if above(k) <= level && around.within(i, MARGIN).all(|k| around.is_seen(k)) {
                let share = (inside - level) / (inside - above(k));
                edge.push(pixels.directions[i].lerp(pixels.directions[k], share));
            }
        }
    }
    is_cut.then_some(edge)
}

/// The pixels around others.
struct Around<'a> {
    pixels: &'a PixelDirections,
    width: i64,
    height: i64,
}

impl<'a> Around<'a> {
    fn of(pixels: &'a PixelDirections) -> Self {
        Self {
            pixels,
            width: i64::from(pixels.width),
            height: i64::from(pixels.height),
        }
    }

    fn within(&self, i: usize, reach: i64) -> impl Iterator<Item = usize> + use<> {
        let (x, y) = (i as i64 % self.width, i as i64 / self.width);
        let (width, height) = (self.width, self.height);
        let rows = (y - reach).max(0)..=(y + reach).min(height - 1);
        rows.flat_map(move |v| {
            ((x - reach).max(0)..=(x + reach).min(width - 1)).map(move |u| (v * width + u) as usize)
        })
    }

    fn is_beside(&self, i: usize, k: usize) -> bool {
        let apart = i.abs_diff(k);
        apart == 1 || apart == self.width as usize
    }

    fn is_seen(&self, i: usize) -> bool {
        self.pixels.solid_angles[i] > 0.0
    }
}

/// A cone of directions.
struct Cone {
    axis: Vec3,
    /// Half angle, radians.
    radius: f32,
    /// How certain it is that a lamp fills it, 0..=1.
    certainty: f32,
}

impl Cone {
    fn through(points: &[Vec3]) -> Option<Self> {
        if points.len() < MIN_POINTS {
            return None;
        }
        let (mut a, mut b) = ([[0.0; 3]; 3], [0.0; 3]);
        for point in points {
            let d = point.as_dvec3().normalize().to_array();
            for (row, x) in d.iter().enumerate() {
                b[row] += x;
                for (column, y) in d.iter().enumerate() {
                    a[row][column] += x * y;
                }
            }
        }
        let plane = DVec3::from(solve(&a, &b)?);
        let axis = plane.normalize().as_vec3();
        let radius = (plane.length_squared() - 1.0).max(0.0).sqrt().atan() as f32;
        let misfit = |d: &Vec3| (d.normalize().distance(axis) - radius).powi(2);
        let misfit = points.iter().map(misfit).sum::<f32>() / points.len() as f32;
        let falls = |(low, high), x| 1.0 - smoothstep(low, high, x);
        let certainty = falls(MISFIT, misfit.sqrt() / radius.max(f32::MIN_POSITIVE))
            * falls(GAP, largest_gap(points, axis));
        (certainty > 0.0).then_some(Self {
            axis,
            radius,
            certainty,
        })
    }

    /// Directions that are evenly spread over it.
    fn points(&self) -> impl Iterator<Item = Vec3> {
        let (right, up) = tangent_frame(self.axis);
        (0..POINTS).map(move |k| {
            let (sin, cos) = (TAU * GOLDEN * k as f32).sin_cos();
            let apart = self.radius * ((k as f32 + 0.5) / POINTS as f32).sqrt();
            (self.axis + (right * cos + up * sin) * apart).normalize()
        })
    }
}

/// The largest angle around `axis`, radians, in which there is no point.
fn largest_gap(points: &[Vec3], axis: Vec3) -> f32 {
    let (right, up) = tangent_frame(axis);
    let angle = |d: &Vec3| d.dot(up).atan2(d.dot(right));
    let mut angles: Vec<f32> = points.iter().map(angle).collect();
    angles.sort_unstable_by(f32::total_cmp);
    let next = angles
        .iter()
        .skip(1)
        .copied()
        .chain(angles.first().map(|first| first + TAU));
    next.zip(&angles)
        .map(|(next, angle)| next - angle)
        .fold(0.0, f32::max)
}
