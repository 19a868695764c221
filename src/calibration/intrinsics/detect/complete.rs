//! Adds missed corners to a grid and refines all corners to a fraction of a pixel.

use super::Grey;
use super::grid::{Grid, STEPS};
use super::refine::refine;
use super::saddles::examine;
use glam::DVec2;

/// A window reaches over this share of the way to the nearest corner: in perspective the next
/// corner's edges are nearer than that corner.
const WINDOW: f64 = 0.55;
/// A missed corner has at least this share of its neighbours' contrast: beside the board
/// there is texture too.
const CONTRAST: f64 = 0.4;
/// A foretold corner may be off by this share of the distance to its neighbour.
const FORETOLD: f64 = 0.25;

/// Adds corners at the positions predicted by rows and columns until no more are found.
pub(super) fn fill(picture: &Grey, grid: &mut Grid) {
    let light = picture.blurred(0.7);
    for _ in 0..8 {
        let found: Vec<_> = gaps(grid)
            .into_iter()
            .filter_map(|at| corner_at(&light, grid, at).map(|p| (at, p)))
            .collect();
        if found.is_empty() {
            return;
        }
        grid.corners.extend(found);
    }
}

/// Returns the free grid positions next to known corners.
fn gaps(grid: &Grid) -> Vec<(i32, i32)> {
    let mut out: Vec<_> = grid
        .corners
        .keys()
        .flat_map(|&(i, j)| [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)])
        .filter(|at| !grid.corners.contains_key(at))
        .collect();
    out.sort_unstable();
    out.dedup();
    out
}

/// The corner that belongs at `at`, if two lines through known corners agree on it and the
/// picture has one there of the right kind.
fn corner_at(picture: &Grey, grid: &Grid, at: (i32, i32)) -> Option<DVec2> {
    let foretold: Vec<(DVec2, f64)> = STEPS
        .iter()
        .filter_map(|&step| grid.extrapolated(at, step))
        .collect();
    let (first, pitch) = *foretold.first()?;
    let agree = foretold
        .iter()
        .all(|(p, _)| p.distance(first) < FORETOLD * pitch);
    if foretold.len() < 2 || !agree {
        return None;
    }
    let mean = foretold.iter().map(|f| f.0).sum::<DVec2>() / foretold.len() as f64;
    let pitch = foretold.iter().map(|f| f.1).fold(f64::MAX, f64::min);
    let found = refine(picture, mean, WINDOW * pitch)?;
    let saddle = examine(picture, found)?;
    let around = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    let beside = around.iter().filter_map(|(i, j)| {
        let neighbour = grid.corners.get(&(at.0 + i, at.1 + j))?;
        Some(examine(picture, *neighbour)?.contrast)
    });
    let usual = beside.fold(0.0, f64::max);
    if saddle.contrast < CONTRAST * usual {
        return None;
    }
    let fresh = grid
        .corners
        .values()
        .all(|p| p.distance(found) > 0.5 * pitch);
    (fresh && found.distance(mean) < FORETOLD * pitch && alternates(grid, at, &saddle))
        .then_some(found)
}

/// The sector towards the next column and row has the colour that belongs there.
fn alternates(grid: &Grid, at: (i32, i32), saddle: &super::saddles::Saddle) -> bool {
    let known = |(i, j): (i32, i32)| grid.corners.get(&(i, j)).copied();
    let along = |step: (i32, i32)| {
        let ahead = known((at.0 + step.0, at.1 + step.1));
        let behind = known((at.0 - step.0, at.1 - step.1));
        match (ahead, behind) {
            (Some(p), _) => Some(p - saddle.at),
            (None, Some(p)) => Some(saddle.at - p),
            (None, None) => None,
        }
    };
    let (Some(column), Some(row)) = (along((1, 0)), along((0, 1))) else {
        return false;
    };
    let towards = column.normalize_or_zero() + row.normalize_or_zero();
    let edge = (0..4)
        .filter(|&e| super::saddles::turn(towards.to_angle() - saddle.edges[e]) >= 0.0)
        .min_by(|&a, &b| {
            let behind = |e: usize| super::saddles::turn(towards.to_angle() - saddle.edges[e]);
            behind(a).total_cmp(&behind(b))
        });
    edge.is_some_and(|e| (saddle.bright_first == (e % 2 == 0)) == grid.is_bright(at))
}

/// Every corner through the window that its neighbours leave it; what cannot be refined is
/// dropped.
pub(super) fn refine_all(picture: &Grey, grid: &mut Grid) {
    let windows: Vec<_> = grid
        .corners
        .iter()
        .filter_map(|(&at, &p)| Some((at, p, WINDOW * nearest(grid, at)?)))
        .collect();
    grid.corners = windows
        .into_iter()
        .filter_map(|(at, p, window)| Some((at, refine(picture, p, window)?)))
        .collect();
}

/// Distance to the nearest of the neighbours, the diagonal ones too.
fn nearest(grid: &Grid, (i, j): (i32, i32)) -> Option<f64> {
    let here = grid.corners.get(&(i, j))?;
    let around = (-1..=1).flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj)));
    around
        .filter(|&at| at != (i, j))
        .filter_map(|at| grid.corners.get(&at))
        .map(|p| p.distance(*here))
        .min_by(f64::total_cmp)
}
