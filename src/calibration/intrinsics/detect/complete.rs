//! Adds missed corners to a grid and refines all corners to a fraction of a pixel.

use super::Grey;
use super::grid::{Grid, STEPS};
use super::refine::refine;
use super::saddles::examine;
use glam::DVec2;

/// Radius of the refinement window as a share of the distance to the nearest corner: in perspective
/// the next corner's edges are nearer than that corner.
const WINDOW: f64 = 0.55;
/// Minimum contrast of a missed corner as a share of its neighbours'; excludes texture beside the
/// board.
const MIN_CONTRAST: f64 = 0.4;
/// Maximum deviation from the predicted position as a share of the distance to the neighbour.
const MAX_DEVIATION: f64 = 0.25;

/// Adds corners at the positions predicted by rows and columns until none is found.
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

/// Finds the corner at grid position `at`, if at least two lines through known corners predict
/// consistent positions and the picture has a corner of the right polarity there.
fn corner_at(picture: &Grey, grid: &Grid, at: (i32, i32)) -> Option<DVec2> {
    let predictions: Vec<(DVec2, f64)> = STEPS
        .iter()
        .filter_map(|&step| grid.extrapolated(at, step))
        .collect();
    let (first, pitch) = *predictions.first()?;
    let is_consistent = predictions
        .iter()
        .all(|(p, _)| p.distance(first) < MAX_DEVIATION * pitch);
    if predictions.len() < 2 || !is_consistent {
        return None;
    }
    let mean = predictions.iter().map(|f| f.0).sum::<DVec2>() / predictions.len() as f64;
    let pitch = predictions.iter().map(|f| f.1).fold(f64::MAX, f64::min);
    let found = refine(picture, mean, WINDOW * pitch)?;
    let saddle = examine(picture, found)?;
    let directions = [(1, 0), (-1, 0), (0, 1), (0, -1)];
    let contrasts = directions.iter().filter_map(|(i, j)| {
        let neighbour = grid.corners.get(&(at.0 + i, at.1 + j))?;
        Some(examine(picture, *neighbour)?.contrast)
    });
    let neighbour_contrast = contrasts.fold(0.0, f64::max);
    if saddle.contrast < MIN_CONTRAST * neighbour_contrast {
        return None;
    }
    let is_new = grid
        .corners
        .values()
        .all(|p| p.distance(found) > 0.5 * pitch);
    (is_new
        && found.distance(mean) < MAX_DEVIATION * pitch
        && has_expected_polarity(grid, at, &saddle))
    .then_some(found)
}

/// Returns whether the sector towards the next column and row has the expected brightness.
fn has_expected_polarity(grid: &Grid, at: (i32, i32), saddle: &super::saddles::Saddle) -> bool {
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
        .filter(|&e| super::saddles::wrapped(towards.to_angle() - saddle.edges[e]) >= 0.0)
        .min_by(|&a, &b| {
            let behind = |e: usize| super::saddles::wrapped(towards.to_angle() - saddle.edges[e]);
            behind(a).total_cmp(&behind(b))
        });
    edge.is_some_and(|e| (saddle.is_first_bright == (e % 2 == 0)) == grid.is_bright(at))
}

/// Refines every corner within a window limited by its neighbours; removes corners that cannot be
/// refined.
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

/// Returns the distance to the nearest neighbour, diagonal ones included, pixels.
fn nearest(grid: &Grid, (i, j): (i32, i32)) -> Option<f64> {
    let here = grid.corners.get(&(i, j))?;
    let around = (-1..=1).flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj)));
    around
        .filter(|&at| at != (i, j))
        .filter_map(|at| grid.corners.get(&at))
        .map(|p| p.distance(*here))
        .min_by(f64::total_cmp)
}
