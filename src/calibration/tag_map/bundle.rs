//! Bundle adjustment (Triggs et al. 2000): minimises the reprojection error over all tags and
//! cameras, with the cameras eliminated (`schur`).

use super::schur::{Block, OF_TAG, Reduced};
use super::start::square;
use super::{Seen, View};
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;

/// Threshold of the Huber loss (Huber 1964) on reprojection errors, pixels.
const HUBER: f64 = 0.5;
/// Maximum number of iterations.
const ROUNDS: usize = 40;
/// Holds a tag's size where it is given.
const STIFF: f64 = 1e10;

/// The adjustment problem.
#[derive(Clone, Debug)]
pub(super) struct Bundle<'a> {
    pub lens: &'a Lens,
    pub tags: Vec<Seen>,
    pub views: Vec<View>,
    /// Sizes are unknowns too.
    pub free_sizes: bool,
}

/// Residual of a corner and its derivatives.
pub(super) struct Row {
    off: DVec2,
    weight: f64,
    by_camera: [DVec2; 6],
    by_tag: [DVec2; OF_TAG],
}

impl Bundle<'_> {
    /// Returns the tags' indices among the unknowns.
    fn unknowns(&self) -> Vec<Option<usize>> {
        let mut next = 0;
        self.tags
            .iter()
            .map(|t| {
                let free = !t.fixed && t.map_from_tag.is_some();
                free.then(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect()
    }

    /// Returns half the robust sum of squares.
    fn cost(&self) -> f64 {
        let mut sum = 0.0;
        for (_, _, off) in self.residuals() {
            let off = off.length();
            sum += if off <= HUBER {
                0.5 * off * off
            } else {
                HUBER * (off - 0.5 * HUBER)
            };
        }
        if self.free_sizes {
            return sum;
        }
        let growth = self.tags.iter().map(|t| (t.scale - 1.0).powi(2));
        sum + 0.5 * STIFF * growth.sum::<f64>()
    }

    /// View, sight and pixels by which a corner in use is off; a corner behind the camera is
    /// very far off.
    pub fn residuals(&self) -> impl Iterator<Item = (usize, usize, DVec2)> {
        self.views.iter().enumerate().flat_map(move |(v, view)| {
            let camera = view.camera_from_map;
            let sights = view.sights.iter().enumerate().filter(|(_, s)| s.used);
            sights.flat_map(move |(i, sight)| {
                let tag = &self.tags[sight.tag];
                let placed = camera.zip(tag.map_from_tag);
                let corners = square(tag.size * tag.scale);
                (0..4).filter_map(move |k| {
                    let (camera, map_from_tag) = placed?;
                    let there = camera.transform_point(map_from_tag.transform_point(corners[k]));
                    let pixel = self.lens.project(there);
                    Some((
                        v,
                        i,
                        pixel.map_or(DVec2::splat(1e4), |p| p - sight.corners[k]),
                    ))
                })
            })
        })
    }

    fn row(&self, camera: RigidTransform, tag: &Seen, corner: DVec3, pixel: DVec2) -> Option<Row> {
        let map_from_tag = tag.map_from_tag?;
        let p = camera.transform_point(map_from_tag.transform_point(corner));
        let projected = self.lens.project_with_derivatives(p)?;
        let along = |v: DVec3| {
            let by = &projected.by_point;
            by[0] * v.x + by[1] * v.y + by[2] * v.z
        };
        let off = projected.pixel - pixel;
        let turn = camera.rotation * map_from_tag.rotation;
        let mut by_camera = [DVec2::ZERO; 6];
        let mut by_tag = [DVec2::ZERO; OF_TAG];
        for (k, axis) in DVec3::AXES.into_iter().enumerate() {
            by_camera[k] = along(axis.cross(p));
            by_camera[3 + k] = along(axis);
            by_tag[k] = along(turn * axis.cross(corner));
            by_tag[3 + k] = along(turn * axis);
        }
        by_tag[6] = along(turn * corner) / tag.scale;
        Some(Row {
            off,
            weight: (HUBER / off.length().max(HUBER)).min(1.0),
            by_camera,
            by_tag,
        })
    }

    /// Returns the normal equations with the cameras eliminated; `None` if a corner is behind a camera.
    pub fn reduced(&self, damping: f64) -> Option<Reduced> {
        let numbers = self.unknowns();
        let count = numbers.iter().flatten().count();
        let mut reduced = Reduced::new(count, self.views.len());
        for view in &self.views {
            let Some(camera) = view.camera_from_map else {
                reduced.skip();
                continue;
            };
            let mut block = Block::default();
            for sight in view.sights.iter().filter(|s| s.used) {
                let tag = &self.tags[sight.tag];
                if tag.map_from_tag.is_none() {
                    continue;
                }
                let corners = square(tag.size * tag.scale);
                for (corner, pixel) in corners.into_iter().zip(sight.corners) {
                    let row = self.row(camera, tag, corner, pixel)?;
                    for axis in 0..2 {
                        block.add(
                            row.off[axis],
                            row.weight,
                            &row.by_camera.map(|d| d[axis]),
                            numbers[sight.tag].map(|n| (n, row.by_tag.map(|d| d[axis]))),
                        );
                    }
                }
            }
            reduced.eliminate(block, damping)?;
        }
        let held = if self.free_sizes { 1e-9 } else { STIFF };
        for (tag, number) in self.tags.iter().zip(&numbers) {
            if let Some(n) = number {
                reduced.hold(n * OF_TAG + 6, tag.scale - 1.0, held);
            }
        }
        Some(reduced)
    }

    fn moved(&self, by_tag: &[f64], by_camera: &[[f64; 6]]) -> Self {
        let mut out = self.clone();
        for (tag, number) in out.tags.iter_mut().zip(self.unknowns()) {
            let (Some(n), Some(pose)) = (number, tag.map_from_tag) else {
                continue;
            };
            let d = &by_tag[n * OF_TAG..(n + 1) * OF_TAG];
            let turn = DQuat::from_scaled_axis(DVec3::new(d[0], d[1], d[2]));
            let local = RigidTransform::new(turn, DVec3::new(d[3], d[4], d[5]));
            tag.map_from_tag = Some(pose * local);
            tag.scale = (tag.scale + d[6]).max(0.05);
        }
        for (view, d) in out.views.iter_mut().zip(by_camera) {
            let turn = DQuat::from_scaled_axis(DVec3::new(d[0], d[1], d[2]));
            let step = RigidTransform::new(turn, DVec3::new(d[3], d[4], d[5]));
            view.camera_from_map = view.camera_from_map.map(|c| step * c);
        }
        out
    }

    /// Minimises the cost from the current state (Levenberg 1944, Marquardt 1963).
    pub fn adjust(&mut self) {
        let (mut cost, mut damping) = (self.cost(), 1e-4);
        for _ in 0..ROUNDS {
            let step = self.reduced(damping).and_then(|r| r.solve(damping));
            let next = step.map(|(tags, cameras)| self.moved(&tags, &cameras));
            let better = next.map(|n| (n.cost(), n)).filter(|(c, _)| *c < cost);
            let Some((lower, next)) = better else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
                continue;
            };
            let gained = cost - lower;
            (*self, cost, damping) = (next, lower, (damping * 0.2).max(1e-9));
            if gained < 1e-9 * cost.max(1e-9) {
                break;
            }
        }
    }
}
