//! Which of the lattice's cells is which patch: told by the colours.

use super::lattice::{Lattice, bounds};
use super::level::Level;
use crate::radiometric::reference::{COLUMNS, Edition, ROWS};
use glam::{DMat3, DVec2, DVec3, IVec2};
use penumbra_camera::linear_from_srgb;

/// A way to lay the chart's columns and rows over the lattice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    /// Lattice cell of a column and row.
    pub cell_from_patch: DMat3,
    /// Share of the colours' differences that the chart explains, 0 to 1.
    pub explained: f64,
    /// The next best other way's.
    pub runner_up: f64,
    /// The picture shows the chart in a mirror.
    pub mirrored: bool,
    /// Blobs on patches.
    pub seen: usize,
}

/// Rows and columns beyond those seen that a chart may have.
const MISSING: i32 = 2;
/// Patches that must have been seen as blobs, of those the placement claims.
const SEEN: usize = 10;
/// Added to linear values before the logarithm, so that black's noise does not count.
const DARK: f64 = 0.004;

/// The best way; `None` where no placement lies within the picture.
pub(super) fn place(level: &Level, lattice: &Lattice) -> Option<Placement> {
    let known: Vec<IVec2> = lattice.cells.iter().map(|c| c.0).collect();
    let (low, high) = bounds(&known)?;
    let reference = Edition::default().linear().map(log);
    let mut best: Option<Placement> = None;
    let mut others = Vec::new();
    for turn in turns() {
        let (a, b) = (turn.0, turn.1);
        let far = a * (COLUMNS as i32 - 1) + b * (ROWS as i32 - 1);
        let (from, to) = (low - far.max(IVec2::ZERO), high - far.min(IVec2::ZERO));
        for y in from.y - MISSING..=to.y + MISSING {
            for x in from.x - MISSING..=to.x + MISSING {
                let origin = IVec2::new(x, y);
                let Some(found) = try_placement(level, lattice, &known, origin, turn, &reference)
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

/// The eight ways to lay axes along axes; the last four are mirrored.
fn turns() -> [(IVec2, IVec2); 8] {
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
    if seen < SEEN.min(known.len()) {
        return None;
    }
    let mut colours = [DVec3::ZERO; COLUMNS * ROWS];
    for (colour, cell) in colours.iter_mut().zip(cells) {
        let codes = level.at(lattice.place(cell.as_dvec2()))?;
        let linear = codes.map(|c| f64::from(linear_from_srgb(c / 255.0)));
        *colour = log(DVec3::from_array(linear));
    }
    let cell_from_patch = DMat3::from_cols(
        right.as_dvec2().extend(0.0),
        down.as_dvec2().extend(0.0),
        origin.as_dvec2().extend(1.0),
    );
    // Rows and columns of the lattice may themselves run against the picture's.
    let steps = [DVec2::ZERO, DVec2::X, DVec2::Y].map(|p| {
        let cell = (cell_from_patch * p.extend(1.0)).truncate();
        lattice.place(cell)
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

/// How well measured = γ · reference + gain (per channel, logarithms) holds: the camera's white
/// balance, exposure and, within limits, its tone curve are unknown. As R² over what differs from
/// the channels' means.
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
    // A negative is no chart.
    if mr <= 0.0 || mm < 1e-3 {
        return 0.0;
    }
    mr * mr / (rr * mm)
}
