//! Round lamps in a picture: whether the edge of a region lies on a circle.
//!
//! Most lamps are round from every side. The circle's plane v·d = 1 is fitted to the directions d of the edge by
//! least squares; its cone has the axis v/|v| and cos r = 1/|v|.

use super::cube::tangent_frame;
use super::sources::{Layout, SampleGrid};
use glam::{DVec3, Vec3};
use penumbra_numerics::fixed_size::solve;
use penumbra_numerics::smoothstep;
use std::f32::consts::TAU;

/// Least number of points on the edge.
const MIN_POINTS: usize = 8;
/// Pixels around an unseen one that may show a part of what hides the lamp.
const MARGIN: i64 = 2;
/// Distance of the edge from the circle (root mean square), relative to its radius, up to which it is a lamp's,
/// and from which it is not.
const MISFIT: (f32, f32) = (0.04, 0.08);
/// The same for the largest angle, radians, over which no edge is seen.
const GAP: (f32, f32) = (4.4, 5.0);
/// Points in the cone.
const POINTS: usize = 256;
/// Fraction of a turn from one of them to the next (golden angle).
const GOLDEN: f32 = 0.381_966;

/// The edge of a region of a picture.
pub(super) struct Edge {
    /// Directions to it; none where something hides the region.
    pub points: Vec<Vec3>,
    /// Whether the region ends at unseen pixels.
    pub is_cut: bool,
}

impl Edge {
    /// The edge of some pixels, where the light `above` the background falls to `level`; `None` without a
    /// picture.
    pub fn of(
        grid: SampleGrid,
        region: impl Iterator<Item = u32>,
        level: f32,
        above: impl Fn(usize) -> f32,
    ) -> Option<Self> {
        let around = Around::of(grid)?;
        let mut edge = Self {
            points: Vec::new(),
            is_cut: false,
        };
        for i in region {
            let (i, inside) = (i as usize, above(i as usize));
            if inside <= level {
                continue;
            }
            for k in around.within(i, 1).filter(|k| around.is_beside(i, *k)) {
                if !around.is_seen(k) {
                    edge.is_cut = true;
                } else if above(k) <= level && around.within(i, MARGIN).all(|k| around.is_seen(k)) {
                    let share = (inside - level) / (inside - above(k));
                    let point = grid.directions[i].lerp(grid.directions[k], share);
                    edge.points.push(point);
                }
            }
        }
        Some(edge)
    }
}

/// The pixels around others.
struct Around<'a> {
    seen: &'a [f32],
    width: i64,
    height: i64,
}

impl<'a> Around<'a> {
    fn of(grid: SampleGrid<'a>) -> Option<Self> {
        let Layout::Picture(width) = grid.layout else {
            return None;
        };
        Some(Self {
            seen: grid.solid_angles,
            width: i64::from(width),
            height: (grid.solid_angles.len() / width.max(1) as usize) as i64,
        })
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
        self.seen[i] > 0.0
    }
}

/// A cone of directions.
pub(super) struct Cone {
    axis: Vec3,
    /// Half angle, radians.
    pub radius: f32,
    /// How certain it is that a lamp fills it, 0..=1.
    pub certainty: f32,
}

impl Cone {
    pub const POINTS: usize = POINTS;

    /// The cone through directions (unit vectors) on the edge of a lamp; `None` if there is none.
    pub fn through(points: &[Vec3]) -> Option<Self> {
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

    /// [`Self::POINTS`] directions that are evenly spread over it.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
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
