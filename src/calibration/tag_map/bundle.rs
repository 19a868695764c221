//! Bundle adjustment (Triggs et al. 2000): minimises the reprojection error over all tags and
//! cameras, with the cameras eliminated (`schur`).

use super::initial_poses::tag_corners;
use super::schur::{Block, Reduced, TAG_UNKNOWNS};
use super::{MapTag, View};
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Stop, descend};

/// Threshold of the Huber loss (Huber 1964) on reprojection errors, pixels.
const HUBER: f64 = 0.5;
/// End of the adjustment.
const STOP: Stop = Stop {
    iterations: 40,
    min_gain: 1e-9,
};
/// Weight of the prior that keeps a tag at its given size.
const SIZE_PRIOR: f64 = 1e10;

/// The adjustment problem.
#[derive(Clone, Debug)]
pub(super) struct Bundle<'a> {
    pub lens: &'a Lens,
    pub tags: Vec<MapTag>,
    pub views: Vec<View>,
    /// Whether the tags' sizes are unknowns too.
    pub free_sizes: bool,
}

/// Residual of a corner and its derivatives.
pub(super) struct Row {
    residual: DVec2,
    weight: f64,
    by_camera: [DVec2; 6],
    by_tag: [DVec2; TAG_UNKNOWNS],
}

impl Bundle<'_> {
    /// Returns each tag's number among the tags with unknowns; `None` for a fixed tag or one
    /// without a pose.
    fn unknowns(&self) -> Vec<Option<usize>> {
        let mut next = 0;
        self.tags
            .iter()
            .map(|t| {
                let free = !t.is_fixed && t.map_from_tag.is_some();
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
        for (_, _, residual) in self.residuals() {
            let error = residual.length();
            sum += if error <= HUBER {
                0.5 * error * error
            } else {
                HUBER * (error - 0.5 * HUBER)
            };
        }
        if self.free_sizes {
            return sum;
        }
        let size_errors = self.tags.iter().map(|t| (t.scale - 1.0).powi(2));
        sum + 0.5 * SIZE_PRIOR * size_errors.sum::<f64>()
    }

    /// Returns view, observation and residual (pixels) of each used corner; 10⁴ px for a corner
    /// that cannot be projected.
    pub fn residuals(&self) -> impl Iterator<Item = (usize, usize, DVec2)> {
        self.views.iter().enumerate().flat_map(move |(v, view)| {
            let camera = view.camera_from_map;
            let used = view
                .observations
                .iter()
                .enumerate()
                .filter(|(_, o)| o.is_used);
            used.flat_map(move |(i, observation)| {
                let tag = &self.tags[observation.tag];
                let poses = camera.zip(tag.map_from_tag);
                let corners = tag_corners(tag.size * tag.scale);
                (0..4).filter_map(move |k| {
                    let (camera, map_from_tag) = poses?;
                    let point = camera.transform_point(map_from_tag.transform_point(corners[k]));
                    let pixel = self.lens.project(point);
                    Some((
                        v,
                        i,
                        pixel.map_or(DVec2::splat(1e4), |p| p - observation.corners[k]),
                    ))
                })
            })
        })
    }

    /// Returns the residual of a corner and its derivatives; `None` if it cannot be projected.
    fn row(
        &self,
        camera: RigidTransform,
        tag: &MapTag,
        corner: DVec3,
        pixel: DVec2,
    ) -> Option<Row> {
        let map_from_tag = tag.map_from_tag?;
        let p = camera.transform_point(map_from_tag.transform_point(corner));
        let projected = self.lens.project_with_derivatives(p)?;
        let derivative = |v: DVec3| {
            let by = &projected.by_point;
            by[0] * v.x + by[1] * v.y + by[2] * v.z
        };
        let residual = projected.pixel - pixel;
        let rotation = camera.rotation * map_from_tag.rotation;
        let mut by_camera = [DVec2::ZERO; 6];
        let mut by_tag = [DVec2::ZERO; TAG_UNKNOWNS];
        for (k, axis) in DVec3::AXES.into_iter().enumerate() {
            by_camera[k] = derivative(axis.cross(p));
            by_camera[3 + k] = derivative(axis);
            by_tag[k] = derivative(rotation * axis.cross(corner));
            by_tag[3 + k] = derivative(rotation * axis);
        }
        by_tag[6] = derivative(rotation * corner) / tag.scale;
        Some(Row {
            residual,
            weight: (HUBER / residual.length().max(HUBER)).min(1.0),
            by_camera,
            by_tag,
        })
    }

    /// Returns the normal equations with the cameras eliminated; `None` if a corner cannot be projected
    /// or a view does not determine its camera.
    pub fn reduced(&self, damping: f64) -> Option<Reduced> {
        let numbers = self.unknowns();
        let count = numbers.iter().flatten().count();
        let mut reduced = Reduced::new(count, self.views.len());
        for view in &self.views {
            let Some(camera) = view.camera_from_map else {
                reduced.skip_view();
                continue;
            };
            let mut block = Block::default();
            for observation in view.observations.iter().filter(|o| o.is_used) {
                let tag = &self.tags[observation.tag];
                if tag.map_from_tag.is_none() {
                    continue;
                }
                let corners = tag_corners(tag.size * tag.scale);
                for (corner, pixel) in corners.into_iter().zip(observation.corners) {
                    let row = self.row(camera, tag, corner, pixel)?;
                    for axis in 0..2 {
                        block.add(
                            row.residual[axis],
                            row.weight,
                            &row.by_camera.map(|d| d[axis]),
                            numbers[observation.tag].map(|n| (n, row.by_tag.map(|d| d[axis]))),
                        );
                    }
                }
            }
            reduced.eliminate(block, damping)?;
        }
        let prior = if self.free_sizes { 1e-9 } else { SIZE_PRIOR };
        for (tag, number) in self.tags.iter().zip(&numbers) {
            if let Some(n) = number {
                reduced.add_prior(n * TAG_UNKNOWNS + 6, tag.scale - 1.0, prior);
            }
        }
        Some(reduced)
    }

    /// Returns the problem after a step of all unknowns.
    fn stepped(&self, by_tag: &[f64], by_camera: &[[f64; 6]]) -> Self {
        let mut out = self.clone();
        for (tag, number) in out.tags.iter_mut().zip(self.unknowns()) {
            let (Some(n), Some(pose)) = (number, tag.map_from_tag) else {
                continue;
            };
            let d = &by_tag[n * TAG_UNKNOWNS..(n + 1) * TAG_UNKNOWNS];
            let rotation = DQuat::from_scaled_axis(DVec3::new(d[0], d[1], d[2]));
            let local = RigidTransform::new(rotation, DVec3::new(d[3], d[4], d[5]));
            tag.map_from_tag = Some(pose * local);
            tag.scale = (tag.scale + d[6]).max(0.05);
        }
        for (view, d) in out.views.iter_mut().zip(by_camera) {
            let rotation = DQuat::from_scaled_axis(DVec3::new(d[0], d[1], d[2]));
            let step = RigidTransform::new(rotation, DVec3::new(d[3], d[4], d[5]));
            view.camera_from_map = view.camera_from_map.map(|c| step * c);
        }
        out
    }

    /// Minimises the cost from the current state.
    pub fn adjust(&mut self) {
        let start = self.clone();
        let linearise = |bundle: &Self| Some((bundle.cost(), ()));
        let step = |bundle: &Self, (): &(), damping| {
            let (tags, cameras) = bundle.reduced(damping)?.solve(damping)?;
            Some(bundle.stepped(&tags, &cameras))
        };
        if let Some((best, ())) = descend(start, STOP, linearise, step) {
            *self = best;
        }
    }
}
