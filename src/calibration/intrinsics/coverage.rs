//! Quality of the views: coverage of the picture by corners, tilt of the board, and uncertainty of
//! the lens in each part of the picture.

use super::estimate::{Estimate, ViewEstimate};
use super::rim::{Light, deviation};
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_numerics::median;

/// Columns and rows of cells in which corners are counted.
pub const CELLS: (usize, usize) = (8, 6);

/// Coverage of the picture by corners.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// Number of corners used per cell, row by row; [`CELLS`].
    pub corners: Vec<u32>,
    /// Cells that receive light: all but a fisheye's black corners.
    pub lit: Vec<bool>,
    /// Share of the lit cells with a corner in them.
    pub share: f64,
}

/// Tilt of the board: the largest angle between its normal and the line of sight towards each
/// side, radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tilt {
    /// Board facing left in the picture.
    pub left: f64,
    /// Board facing right.
    pub right: f64,
    /// Board facing up.
    pub up: f64,
    /// Board facing down.
    pub down: f64,
}

/// Standard deviation of a direction's pixel, caused by the lens's uncertainty, pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// At the centre of each cell ([`CELLS`]); `None` outside the lens's picture.
    pub by_cell: Vec<Option<f64>>,
    /// Median over all cells.
    pub median: f64,
    /// Maximum over all cells.
    pub worst: f64,
}

impl Coverage {
    /// Computes the coverage by the points used. `light` determines the lit cells of a fisheye.
    #[must_use]
    pub fn new(lens: &Lens, views: &[ViewEstimate], light: &Light) -> Self {
        let (columns, rows) = CELLS;
        let size = DVec2::new(f64::from(lens.width), f64::from(lens.height));
        let mut corners = vec![0_u32; columns * rows];
        for p in used_points(views) {
            let at = (p + 0.5) / size * DVec2::new(columns as f64, rows as f64);
            let (x, y) = (at.x.max(0.0) as usize, at.y.max(0.0) as usize);
            corners[y.min(rows - 1) * columns + x.min(columns - 1)] += 1;
        }
        let radius = lit_radius(lens, views);
        let lit: Vec<bool> = (0..columns * rows)
            .map(|i| {
                let middle = cell_middle(lens, i);
                let by_light = light.is_lit((middle + 0.5) / size);
                let fisheye = lens.model == LensModel::KannalaBrandt;
                by_light
                    .filter(|_| fisheye)
                    .unwrap_or_else(|| middle.distance(lens.centre) < radius)
            })
            .collect();
        let of_lit = corners.iter().zip(&lit).filter(|(_, lit)| **lit);
        let filled = of_lit.clone().filter(|(n, _)| **n > 0).count();
        Self {
            share: filled as f64 / of_lit.count().max(1) as f64,
            corners,
            lit,
        }
    }

    /// Returns the part of the picture with the fewest filled cells; `None` if all are half filled.
    #[must_use]
    pub fn least_covered_part(&self) -> Option<&'static str> {
        const NAMES: [&str; 9] = [
            "top left corner",
            "top",
            "top right corner",
            "left side",
            "middle",
            "right side",
            "bottom left corner",
            "bottom",
            "bottom right corner",
        ];
        let (columns, rows) = CELLS;
        let share = |part: usize| {
            let within = |i: usize| {
                let (x, y) = (i % columns, i / columns);
                3 * x / columns == part % 3 && 3 * y / rows == part / 3
            };
            let cells = (0..columns * rows).filter(|&i| within(i) && self.lit[i]);
            let filled = cells.clone().filter(|&i| self.corners[i] > 0).count();
            let all = cells.count();
            if all == 0 {
                1.0
            } else {
                filled as f64 / all as f64
            }
        };
        let least = (0..9).min_by(|&a, &b| share(a).total_cmp(&share(b)))?;
        (share(least) < 0.5).then_some(NAMES[least])
    }
}

impl Tilt {
    /// Computes the tilt over the views used.
    #[must_use]
    pub fn from_views(views: &[ViewEstimate]) -> Self {
        let mut tilt = Self::default();
        for view in views.iter().filter(|v| v.used) {
            let Some(pose) = view.pose else { continue };
            let sight = pose.translation.normalize_or(DVec3::Z);
            // The board's outward normal, without its component along the line of sight.
            let normal = -(pose.rotation * DVec3::Z);
            let lateral = normal - sight * normal.dot(sight);
            let angle = |component: f64| component.clamp(-1.0, 1.0).asin();
            tilt.left = tilt.left.max(angle(-lateral.x));
            tilt.right = tilt.right.max(angle(lateral.x));
            tilt.up = tilt.up.max(angle(-lateral.y));
            tilt.down = tilt.down.max(angle(lateral.y));
        }
        tilt
    }

    /// Returns the largest tilt towards any side, radians.
    #[must_use]
    pub fn max(&self) -> f64 {
        self.left.max(self.right).max(self.up).max(self.down)
    }

    /// Returns the side with the smallest tilt, if it is below 15°.
    #[must_use]
    pub fn least_tilted_side(&self) -> Option<&'static str> {
        let sides = [
            (self.left, "left"),
            (self.right, "right"),
            (self.up, "upwards"),
            (self.down, "downwards"),
        ];
        let least = sides.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        (least.0 < 15_f64.to_radians()).then_some(least.1)
    }
}

impl Uncertainty {
    // ┌ Lens errors that a small rotation of the camera compensates are harmless. An error Δ   ┐
    // │ of the lens moves all cells' pixels by J Δ; the part in the span of camera rotations R │
    // └ is removed, J' = J − R (RᵀR)⁻¹ Rᵀ J; then Σ_pixel = J' Σ J'ᵀ (cf. mrcal, 2021).        ┘
    /// Computes the lens's uncertainty in all parts of the picture.
    #[must_use]
    pub fn from_estimate(estimate: &Estimate) -> Self {
        let lens = &estimate.lens;
        let radius = lit_radius(lens, &estimate.views);
        let n = estimate.unknowns.count();
        let mut projections = Vec::new();
        let mut gathered = vec![DVec2::ZERO; n];
        for cell in 0..CELLS.0 * CELLS.1 {
            let pixel = cell_middle(lens, cell);
            let near = pixel.distance(lens.centre) < radius;
            let projection = lens
                .unproject(pixel)
                .filter(|_| near)
                .and_then(|ray| Some((ray, lens.project_with_derivatives(ray)?)));
            if let Some((ray, p)) = projection {
                estimate.unknowns.gather(&p.by_parameter, &mut gathered);
                let by_rotation = super::pose::by_pose(&p.by_point, ray);
                projections.push((
                    cell,
                    gathered.clone(),
                    [by_rotation[0], by_rotation[1], by_rotation[2]],
                ));
            }
        }
        let compensation = compensating_rotations(&projections, n);
        let mut by_cell = vec![None; CELLS.0 * CELLS.1];
        for (cell, by_lens, by_rotation) in &projections {
            let remaining = |c: usize| {
                let rotation = compensation[c];
                by_lens[c]
                    - by_rotation[0] * rotation.x
                    - by_rotation[1] * rotation.y
                    - by_rotation[2] * rotation.z
            };
            let rows: Vec<DVec2> = (0..n).map(remaining).collect();
            by_cell[*cell] = Some(deviation(&rows, &estimate.covariance));
        }
        let known = || by_cell.iter().copied().flatten();
        Self {
            median: median(known()).unwrap_or(f64::INFINITY),
            worst: known().fold(0.0, f64::max),
            by_cell,
        }
    }
}

/// Returns, for each unknown, the camera rotation that compensates most of its effect.
fn compensating_rotations(projections: &[(usize, Vec<DVec2>, [DVec2; 3])], n: usize) -> Vec<DVec3> {
    let mut normal = DMat3::ZERO;
    let mut right = vec![DVec3::ZERO; n];
    for (_, by_lens, by_rotation) in projections {
        for axis in 0..2 {
            let row = DVec3::new(
                by_rotation[0][axis],
                by_rotation[1][axis],
                by_rotation[2][axis],
            );
            normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            for (slot, by) in right.iter_mut().zip(by_lens) {
                *slot += row * by[axis];
            }
        }
    }
    let is_solvable = normal.determinant().abs() > 1e-9;
    let inverse = if is_solvable {
        normal.inverse()
    } else {
        DMat3::ZERO
    };
    right.into_iter().map(|r| inverse * r).collect()
}

/// Returns the radius of the picture about the principal point, pixels: infinite for a pinhole; for
/// a fisheye 0.9 of the inscribed circle's, or that of the outermost corner if larger.
pub(super) fn lit_radius(lens: &Lens, views: &[ViewEstimate]) -> f64 {
    if lens.model != LensModel::KannalaBrandt {
        return f64::INFINITY;
    }
    let farthest = used_points(views)
        .map(|p| p.distance(lens.centre))
        .fold(0.0, f64::max);
    farthest.max(0.45 * f64::from(lens.width.min(lens.height)))
}

fn used_points(views: &[ViewEstimate]) -> impl Iterator<Item = DVec2> + '_ {
    let used = views.iter().filter(|v| v.used);
    used.flat_map(|v| v.points.iter().filter(|p| p.used).map(|p| p.pixel))
}

/// Returns the pixel at the centre of a cell.
pub(super) fn cell_middle(lens: &Lens, cell: usize) -> DVec2 {
    let (columns, rows) = CELLS;
    let at = DVec2::new((cell % columns) as f64 + 0.5, (cell / columns) as f64 + 0.5);
    let size = DVec2::new(f64::from(lens.width), f64::from(lens.height));
    at / DVec2::new(columns as f64, rows as f64) * size - 0.5
}
