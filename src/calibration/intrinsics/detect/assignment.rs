//! Assigns the corners of a grid to the corners of the board.

use super::NoChessboard;
use super::grid::Grid;
use crate::intrinsics::Correspondence;
use glam::DVec2;
use std::collections::BTreeMap;

/// Minimum share of corners in an outer row or column of a grid that is larger than the board;
/// sparser ones are removed as e.g. a shadow's edge or a tile beside the board.
const MIN_FILLED: f64 = 0.5;

/// Ambiguity of the assignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// Every corner is identified.
    Known,
    /// The board may be rotated by 180°, which leaves its colours unchanged.
    KnownButHalfTurn,
    /// Only part of the board is visible, and corners are counted from a visible one. Such a view
    /// determines lens and pose of the plane, but not the board's origin.
    Unknown,
}

/// A chessboard detected in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ChessboardDetection {
    /// Corner by column and row.
    pub corners: BTreeMap<(u32, u32), DVec2>,
    /// How column and row relate to the board.
    pub placement: Placement,
    /// Number of columns and rows over which the corners extend.
    pub extent: (u32, u32),
}

impl ChessboardDetection {
    /// Returns the corners as correspondences; `square` is the edge of a square, metres.
    #[must_use]
    pub fn correspondences(&self, square: f64) -> Vec<Correspondence> {
        self.corners
            .iter()
            .map(|(&(i, j), &pixel)| Correspondence {
                point: DVec2::new(f64::from(i), f64::from(j)) * square,
                pixel,
            })
            .collect()
    }
}

/// Assigns the grid to a board of `columns` × `rows` inner corners.
pub(super) fn assign(
    mut grid: Grid,
    columns: u32,
    rows: u32,
) -> Result<ChessboardDetection, NoChessboard> {
    let (c, r) = (columns as i32, rows as i32);
    trim(&mut grid, c, r);
    let fits = |w: i32, h: i32| w <= c && h <= r;
    let (w, h) = grid.extent();
    if !fits(w, h) && !fits(h, w) {
        return Err(NoChessboard::Larger {
            columns: w.max(h).unsigned_abs(),
            rows: w.min(h).unsigned_abs(),
        });
    }
    let is_complete = (w, h) == (c, r) || (w, h) == (r, c);
    let (quarter_turns, placement) = if is_complete {
        orientation(&grid, c, r)
    } else {
        (u32::from(!fits(w, h)), Placement::Unknown)
    };
    let grid = rotated(grid, quarter_turns);
    let (low, _) = grid.bounds();
    let (w, h) = grid.extent();
    let corners = grid
        .corners
        .iter()
        .map(|(&(i, j), &p)| (((i - low.x).unsigned_abs(), (j - low.y).unsigned_abs()), p))
        .collect();
    Ok(ChessboardDetection {
        corners,
        placement,
        extent: (w.unsigned_abs(), h.unsigned_abs()),
    })
}

/// Removes sparse outer rows and columns while the grid is larger than the board.
fn trim(grid: &mut Grid, columns: i32, rows: i32) {
    loop {
        let (w, h) = grid.extent();
        let (long, short) = (columns.max(rows), columns.min(rows));
        if w.max(h) <= long && w.min(h) <= short {
            return;
        }
        let (low, high) = grid.bounds();
        // Trims only a side that is too long for the board in either orientation.
        let too_wide = w > long || (w > short && h > short && w <= h);
        let borders: Vec<(bool, i32)> = if too_wide {
            vec![(true, low.x), (true, high.x)]
        } else {
            vec![(false, low.y), (false, high.y)]
        };
        let corners_on = |&(vertical, at): &(bool, i32)| {
            let on = grid
                .corners
                .keys()
                .filter(|k| if vertical { k.0 == at } else { k.1 == at });
            on.count()
        };
        let Some(border) = borders.into_iter().min_by_key(corners_on) else {
            return;
        };
        let across = if border.0 { h } else { w };
        if corners_on(&border) as f64 >= MIN_FILLED * f64::from(across.min(long)) {
            return;
        }
        grid.corners.retain(|k, _| {
            if border.0 {
                k.0 != border.1
            } else {
                k.1 != border.1
            }
        });
    }
}

/// Returns the number of quarter turns that bring a complete board upright, so that the sector
/// between +column and +row of its first corner is dark ([`crate::board_sheet`]), if its colours
/// determine them.
fn orientation(grid: &Grid, columns: i32, rows: i32) -> (u32, Placement) {
    let (w, _) = grid.extent();
    let candidates: &[u32] = if columns == rows {
        &[0, 1, 2, 3]
    } else if w == columns {
        &[0, 2]
    } else {
        &[1, 3]
    };
    let is_upright = |quarter_turns: &&u32| {
        let rotated = rotated(grid.clone(), **quarter_turns);
        let (low, _) = rotated.bounds();
        !rotated.is_bright((low.x, low.y))
    };
    let mut upright = candidates.iter().filter(is_upright);
    match (upright.next(), upright.next()) {
        (Some(&one), None) => (one, Placement::Known),
        (Some(&one), Some(_)) => (
            best_upright(grid, candidates, one),
            Placement::KnownButHalfTurn,
        ),
        (None, _) => (
            best_upright(grid, candidates, candidates[0]),
            Placement::KnownButHalfTurn,
        ),
    }
}

/// Returns the rotation whose rows run most nearly rightwards.
fn best_upright(grid: &Grid, candidates: &[u32], fallback: u32) -> u32 {
    let rightwards = |&quarter_turns: &u32| {
        let rotated = rotated(grid.clone(), quarter_turns);
        let step = |(&(i, j), p): (&(i32, i32), &DVec2)| {
            rotated.corners.get(&(i + 1, j)).map(|q| (*q - *p).x)
        };
        rotated.corners.iter().filter_map(step).sum::<f64>()
    };
    let best = candidates
        .iter()
        .max_by(|a, b| rightwards(a).total_cmp(&rightwards(b)));
    best.copied().unwrap_or(fallback)
}

/// Returns the grid rotated by quarter turns, i.e. with columns counted along another side.
fn rotated(grid: Grid, quarter_turns: u32) -> Grid {
    let mut out = grid;
    for _ in 0..quarter_turns {
        let corners = out
            .corners
            .iter()
            .map(|(&(i, j), &p)| ((j, -i), p))
            .collect();
        out = Grid {
            corners,
            // The sector between the new axes is the neighbouring one.
            is_origin_bright: !out.is_origin_bright,
        };
    }
    out
}
