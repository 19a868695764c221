//! Assigns the corners of a grid to the corners of the board.

use super::NoChessboard;
use super::grid::Grid;
use crate::intrinsics::Correspondence;
use glam::DVec2;
use std::collections::BTreeMap;

/// A row or column at the rim with fewer of its corners than this share is not the board's
/// when the grid is too large: a shadow's edge or a tile beside it.
const STRAY: f64 = 0.5;

/// Ambiguity of the assignment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// Every corner is known.
    Known,
    /// The board may be rotated by 180°, which leaves its colours unchanged.
    KnownButHalfTurn,
    /// Only part of the board is in sight: corners are counted from one that is. Lens and
    /// pose of the paper follow from such a view, the board's own origin does not.
    Unknown,
}

/// A chessboard in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ChessSighting {
    /// Corner by column and row.
    pub corners: BTreeMap<(u32, u32), DVec2>,
    /// Meaning of column and row.
    pub placement: Placement,
    /// Columns and rows over which the corners extend.
    pub extent: (u32, u32),
}

impl ChessSighting {
    /// With squares of that size, metres.
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

pub(super) fn place(
    mut grid: Grid,
    columns: u32,
    rows: u32,
) -> Result<ChessSighting, NoChessboard> {
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
    let whole = (w, h) == (c, r) || (w, h) == (r, c);
    let (quarters, placement) = if whole {
        orientation(&grid, c, r)
    } else {
        (u32::from(!fits(w, h)), Placement::Unknown)
    };
    let grid = turned(grid, quarters);
    let (low, _) = grid.bounds();
    let (w, h) = grid.extent();
    let corners = grid
        .corners
        .iter()
        .map(|(&(i, j), &p)| (((i - low.x).unsigned_abs(), (j - low.y).unsigned_abs()), p))
        .collect();
    Ok(ChessSighting {
        corners,
        placement,
        extent: (w.unsigned_abs(), h.unsigned_abs()),
    })
}

/// Takes sparse rows and columns off the rim as long as the grid is larger than the board.
fn trim(grid: &mut Grid, columns: i32, rows: i32) {
    loop {
        let (w, h) = grid.extent();
        let (long, short) = (columns.max(rows), columns.min(rows));
        if w.max(h) <= long && w.min(h) <= short {
            return;
        }
        let (low, high) = grid.bounds();
        // Only a side that is too long for the board in either position.
        let too_wide = w > long || (w > short && h > short && w <= h);
        let rims: Vec<(bool, i32)> = if too_wide {
            vec![(true, low.x), (true, high.x)]
        } else {
            vec![(false, low.y), (false, high.y)]
        };
        let on_rim = |&(vertical, at): &(bool, i32)| {
            let on = grid
                .corners
                .keys()
                .filter(|k| if vertical { k.0 == at } else { k.1 == at });
            on.count()
        };
        let Some(rim) = rims.into_iter().min_by_key(on_rim) else {
            return;
        };
        let across = if rim.0 { h } else { w };
        if on_rim(&rim) as f64 >= STRAY * f64::from(across.min(long)) {
            return;
        }
        grid.corners
            .retain(|k, _| if rim.0 { k.0 != rim.1 } else { k.1 != rim.1 });
    }
}

/// Quarter turns that bring a whole board upright: the sector between +column and +row of
/// its first corner is dark, as [`super::super::board`] draws it, where its colours tell.
fn orientation(grid: &Grid, columns: i32, rows: i32) -> (u32, Placement) {
    let (w, _) = grid.extent();
    let lying: &[u32] = if columns == rows {
        &[0, 1, 2, 3]
    } else if w == columns {
        &[0, 2]
    } else {
        &[1, 3]
    };
    let is_upright = |quarters: &&u32| {
        let turned = turned(grid.clone(), **quarters);
        let (low, _) = turned.bounds();
        !turned.is_bright((low.x, low.y))
    };
    let mut upright = lying.iter().filter(is_upright);
    match (upright.next(), upright.next()) {
        (Some(&one), None) => (one, Placement::Known),
        (Some(&one), Some(_)) => (best_upright(grid, lying, one), Placement::KnownButHalfTurn),
        (None, _) => (
            best_upright(grid, lying, lying[0]),
            Placement::KnownButHalfTurn,
        ),
    }
}

/// Of several possible turns the one whose rows run most nearly rightwards.
fn best_upright(grid: &Grid, turns: &[u32], fallback: u32) -> u32 {
    let rightwards = |&quarters: &u32| {
        let turned = turned(grid.clone(), quarters);
        let step = |(&(i, j), p): (&(i32, i32), &DVec2)| {
            turned.corners.get(&(i + 1, j)).map(|q| (*q - *p).x)
        };
        turned.corners.iter().filter_map(step).sum::<f64>()
    };
    let best = turns
        .iter()
        .max_by(|a, b| rightwards(a).total_cmp(&rightwards(b)));
    best.copied().unwrap_or(fallback)
}

/// The grid with its columns counted along another of its sides.
fn turned(grid: Grid, quarters: u32) -> Grid {
    let mut out = grid;
    for _ in 0..quarters {
        let corners = out
            .corners
            .iter()
            .map(|(&(i, j), &p)| ((j, -i), p))
            .collect();
        out = Grid {
            corners,
            // The sector between the new axes of the same corner is the neighbouring one.
            bright_origin: !out.bright_origin,
        };
    }
    out
}
