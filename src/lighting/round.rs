//! Round lamps in a picture: whether the edge of a region lies on a circle.
//!
//! Most lamps are round from every side. The circle's plane v·d = 1 is fitted to the directions d of the edge by
//! least squares; its cone has the axis v/|v| and cos r = 1/|v|.

use super::cube::{spiral, tangent_frame};
use super::sources::{Layout, SampleGrid};
use glam::{DVec3, Vec3};
use penumbra_numerics::fixed_size::solve;
use penumbra_numerics::smoothstep;
use std::f32::consts::TAU;

/// Least number of points on the edge.
const MIN_POINTS: usize = 8;
/// Pixels around an unseen one that may show a part of what hides the lamp.
const MARGIN: i32 = 2;
/// Distance of the edge from the circle (root mean square), relative to its radius, up to which it is a lamp's,
/// and from which it is not.
const MISFIT: (f32, f32) = (0.04, 0.08);
/// The same for the largest angle, radians, over which no edge is seen.
const GAP: (f32, f32) = (4.4, 5.0);

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
        let Layout::Picture(width) = grid.layout else {
            return None;
        };
        let is_seen = |k: u32| grid.solid_angles[k as usize] > 0.0;
        let mut edge = Self {
            points: Vec::new(),
            is_cut: false,
        };
        for i in region {
            let inside = above(i as usize);
            if inside <= level {
                continue;
            }
            let mut is_clear = true;
            grid.near(i, MARGIN, |k| is_clear &= is_seen(k));
            grid.near(i, 1, |k| {
                let outside = above(k as usize);
                let is_beside = matches!(i.abs_diff(k), apart if apart == 1 || apart == width);
                if is_beside && !is_seen(k) {
                    edge.is_cut = true;
                } else if is_beside && is_clear && outside <= level {
                    let share = (inside - level) / (inside - outside);
                    let [from, to] = [i, k].map(|i| grid.directions[i as usize]);
                    edge.points.push(from.lerp(to, share));
                }
            });
        }
        Some(edge)
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
    /// Number of [`Self::points`].
    pub const POINTS: usize = 256;

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

    /// Directions that are evenly spread over it.
    pub fn points(&self) -> impl Iterator<Item = Vec3> {
        let (right, up) = tangent_frame(self.axis);
        (0..Self::POINTS).map(move |k| {
            let (sin, cos) = spiral(k);
            let apart = self.radius * ((k as f32 + 0.5) / Self::POINTS as f32).sqrt();
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
