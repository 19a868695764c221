//! Assigns the chart's patches to the cells of a lattice by their colours.

use super::lattice::{Lattice, bounds};
use super::level::Level;
use crate::radiometric::reference::{COLUMNS, Edition, ROWS};
use glam::{DMat3, DVec2, DVec3, IVec2};
use penumbra_camera::linear_from_srgb;

/// An assignment of the chart's columns and rows to the lattice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    /// Map from column and row to the lattice cell.
    pub cell_from_patch: DMat3,
    /// Share of the colours' variance that the chart explains, 0 to 1.
    pub explained: f64,
    /// The same for the next best placement.
    pub runner_up: f64,
    /// Whether the chart is mirrored.
    pub mirrored: bool,
    /// Number of patches with a blob.
    pub seen: usize,
}

/// Maximum number of undetected rows and columns of a chart.
const MAX_MISSING: i32 = 2;
/// Minimum number of patches with a blob.
const MIN_SEEN: usize = 10;
/// Added to linear values before the logarithm, to suppress the noise of black.
const DARK: f64 = 0.004;

/// Returns the best placement; `None` where none lies within the picture.
pub(super) fn best_placement(level: &Level, lattice: &Lattice) -> Option<Placement> {
    let known: Vec<IVec2> = lattice.cells.iter().map(|c| c.0).collect();
    let (low, high) = bounds(&known)?;
    let reference = Edition::default().linear().map(log);
    let mut best: Option<Placement> = None;
    let mut others = Vec::new();
    for orientation in orientations() {
        let (a, b) = orientation;
        let far = a * (COLUMNS as i32 - 1) + b * (ROWS as i32 - 1);
        let (from, to) = (low - far.max(IVec2::ZERO), high - far.min(IVec2::ZERO));
        for y in from.y - MAX_MISSING..=to.y + MAX_MISSING {
            for x in from.x - MAX_MISSING..=to.x + MAX_MISSING {
                let origin = IVec2::new(x, y);
                let Some(found) =
                    try_placement(level, lattice, &known, origin, orientation, &reference)
                else {
                    continue;
                };
                others.push(found.explained);
                if best.as_ref().is_none_or(|b| found.explained > b.explained) {
                    best = Some(found);
                }
            }
        }
    }
    let mut best = best?;
    others.sort_by(|a, b| b.total_cmp(a));
    best.runner_up = others.get(1).copied().unwrap_or(0.0);
    Some(best)
}

/// Returns the eight orientations as directions of columns and rows; the last four are mirrored.
fn orientations() -> [(IVec2, IVec2); 8] {
    let [x, y] = [IVec2::X, IVec2::Y];
    [
        (x, y),
        (y, -x),
        (-x, -y),
        (-y, x),
        (x, -y),
        (y, x),
        (-x, y),
        (-y, -x),
    ]
}

fn try_placement(
    level: &Level,
    lattice: &Lattice,
    known: &[IVec2],
    origin: IVec2,
    (right, down): (IVec2, IVec2),
    reference: &[DVec3; COLUMNS * ROWS],
) -> Option<Placement> {
    let cells: [IVec2; COLUMNS * ROWS] = std::array::from_fn(|i| {
        origin + right * (i % COLUMNS) as i32 + down * (i / COLUMNS) as i32
    });
    let seen = cells.iter().filter(|c| known.contains(c)).count();
    if seen < MIN_SEEN.min(known.len()) {
        return None;
    }
    let mut colours = [DVec3::ZERO; COLUMNS * ROWS];
    for (colour, cell) in colours.iter_mut().zip(cells) {
        let codes = level.at(lattice.centre(cell.as_dvec2()))?;
        let linear = codes.map(|c| f64::from(linear_from_srgb(c / 255.0)));
        *colour = log(DVec3::from_array(linear));
    }
    let cell_from_patch = DMat3::from_cols(
        right.as_dvec2().extend(0.0),
        down.as_dvec2().extend(0.0),
        origin.as_dvec2().extend(1.0),
    );
    // The lattice itself may be mirrored against the picture.
    let steps = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|p| {
        let cell = (cell_from_patch * p.extend(1.0)).truncate();
        lattice.centre(cell)
    });
    Some(Placement {
        cell_from_patch,
        explained: explained(&colours, reference),
        runner_up: 0.0,
        mirrored: (steps[1] - steps[0]).perp_dot(steps[2] - steps[0]) < 0.0,
        seen,
    })
}

fn log(linear: DVec3) -> DVec3 {
    (linear.max(DVec3::ZERO) + DARK).ln()
}

/// Returns the share of variance (R²) that measured = γ · reference + gain (by channel, logarithms)
/// explains: the camera's white balance, exposure and, within limits, its tone curve are unknown.
fn explained(measured: &[DVec3], reference: &[DVec3]) -> f64 {
    let count = measured.len() as f64;
    let mean = |v: &[DVec3]| v.iter().sum::<DVec3>() / count;
    let (m, r) = (mean(measured), mean(reference));
    let (mut mr, mut rr, mut mm) = (0.0, 0.0, 0.0);
    for (a, b) in measured.iter().zip(reference) {
        let (a, b) = (*a - m, *b - r);
        mr += a.dot(b);
        rr += b.dot(b);
        mm += a.dot(a);
    }
    // A negative image is not a chart.
    if mr <= 0.0 || mm < 1e-3 {
        return 0.0;
    }
    mr * mr / (rr * mm)
}
