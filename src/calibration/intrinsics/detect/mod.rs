//! Finds the inner corners of a completely or partly visible chessboard in a grey picture, through
//! any lens.
//!
//! Finds saddles of brightness (`saddles`), links those that an edge joins (`links`), orders them
//! in rows and columns (`grid`), adds missed corners (`complete`), refines all to a fraction of a
//! pixel (`refine`) and assigns them to the board's corners (`place`).

mod complete;
mod grey;
mod grid;
mod links;
mod place;
mod refine;
mod saddles;
mod symmetry;

pub use grey::Grey;
pub use place::{ChessSighting, Placement};

use glam::DVec2;
use grid::Grid;

/// Minimum number of corners of a grid.
const LEAST_CORNERS: usize = 9;
/// Blur before corners are refined, pixels: sharper pictures pull them towards pixels' middles.
pub(super) const SMOOTHING: f32 = 1.2;
/// Maximum asymmetry of a corner's surroundings.
const MOST_UNEVEN: f64 = 0.1;
/// Pictures longer than this are looked at from half the size on: what is smaller than a
/// square of five pixels there is nothing to calibrate with.
const FULL_SIZE: usize = 1400;

/// Why no chessboard was found in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoChessboard {
    /// No rows and columns of corners.
    #[error("no chessboard in the picture")]
    NotSeen,
    /// The chessboard has more corners than the given board.
    #[error(
        "a chessboard with at least {columns}×{rows} inner corners: more than the board given; \
         count the inner corners (one less than squares) and say so"
    )]
    Larger {
        /// Corners in a row.
        columns: u32,
        /// Rows of corners.
        rows: u32,
    },
}

/// The corner near a foretold pixel, to a fraction of a pixel, through a window of that radius,
/// which the next corner's edges should not enter; `None` if edges do not cross there, or if what
/// lies on one side of them does not go on opposite: something is before the board, or other edges
/// are so near that they would pull the corner. For boards whose corners are known from markers
/// ([`super::tags`]).
#[must_use]
pub fn refine_corner(picture: &Grey, foretold: DVec2, window: f64) -> Option<DVec2> {
    let crossing = refine::refine(picture, foretold, window);
    let starts = crossing.into_iter().chain([foretold]);
    let found = starts.filter_map(|start| symmetry::centre(picture, start, window));
    let best = found.min_by(|a, b| a.unevenness.total_cmp(&b.unevenness))?;
    (best.unevenness < MOST_UNEVEN).then_some(best.at)
}

/// Finds the visible corners of a board of `columns` × `rows` inner corners.
///
/// # Errors
/// The picture shows no chessboard, or a larger one.
pub fn find_chessboard(
    picture: &Grey,
    columns: u32,
    rows: u32,
) -> Result<ChessSighting, NoChessboard> {
    let mut best = Grid::default();
    let mut level = picture.clone();
    let mut scale = 1.0;
    while level.width.max(level.height) > FULL_SIZE {
        level = level.halved();
        scale *= 2.0;
    }
    let whole = (columns * rows) as usize;
    for _ in 0..3 {
        let grid = find_at_one_size(&level, whole);
        // A coarser level must show more of the board, because it is less accurate.
        if grid.area() * scale * scale > 1.1 * best.area() {
            best = grid;
            best.corners.values_mut().for_each(|p| *p *= scale);
        }
        if best.corners.len() >= whole || level.width.min(level.height) < 160 {
            break;
        }
        level = level.halved();
        scale *= 2.0;
    }
    complete::refine_all(&picture.blurred(SMOOTHING), &mut best);
    if best.corners.len() < LEAST_CORNERS {
        return Err(NoChessboard::NotSeen);
    }
    place::place(best, columns, rows)
}

fn find_at_one_size(picture: &Grey, whole: usize) -> Grid {
    let saddles = saddles::find(picture);
    let links = links::find(picture, &saddles);
    let mut grid = grid::largest(&saddles, &links);
    if grid.corners.len() < whole && grid.corners.len() >= LEAST_CORNERS {
        complete::fill(picture, &mut grid);
    }
    grid
}

#[cfg(test)]
mod tests;
