//! Finds the inner corners of a completely or partly visible chessboard in a grey picture, through
//! any lens.
//!
//! Finds saddle points of brightness (`saddles`), links those joined by an edge (`links`), orders
//! them in rows and columns (`grid`), adds missed corners (`complete`), refines all to subpixel
//! accuracy (`refine`) and assigns them to the board's corners (`assignment`). `symmetry` refines
//! the corners of tag boards.

mod assignment;
mod complete;
mod grey;
mod grid;
mod links;
mod refine;
mod saddles;
mod symmetry;

pub use assignment::{ChessboardDetection, Placement};
pub use grey::Grey;

use glam::DVec2;
use grid::Grid;

/// Minimum number of corners of a grid.
const MIN_CORNERS: usize = 9;
/// Standard deviation of the blur before corners are refined, pixels: in sharper pictures corners
/// are biased towards pixel centres.
pub(super) const SMOOTHING: f32 = 1.2;
/// Maximum asymmetry of a corner's surroundings.
const MAX_ASYMMETRY: f64 = 0.1;
/// Maximum width and height at which corners are searched, pixels; larger pictures are halved.
/// Squares below five pixels at that size are too small for calibration.
const MAX_SEARCH_SIZE: usize = 1400;

/// Reasons why no chessboard was found in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoChessboard {
    /// The picture has no rows and columns of corners.
    #[error("no chessboard in the picture")]
    NotSeen,
    /// The chessboard has more corners than the given board.
    #[error(
        "the chessboard has at least {columns}×{rows} inner corners, more than the given board; \
         count the inner corners (one less than squares) and correct the board"
    )]
    Larger {
        /// Corners in a row.
        columns: u32,
        /// Rows of corners.
        rows: u32,
    },
}

/// Refines the corner near a `predicted` pixel to subpixel accuracy, for boards whose corners are
/// predicted from markers ([`super::tags`]). The `window` (radius, pixels) should not reach the
/// edges of the next corner. `None` if no edges cross there, or if the surroundings are not
/// point-symmetric: the board is occluded, or other edges are so near that they would bias the
/// corner.
#[must_use]
pub fn refine_corner(picture: &Grey, predicted: DVec2, window: f64) -> Option<DVec2> {
    let edge_crossing = refine::refine(picture, predicted, window);
    let starts = edge_crossing.into_iter().chain([predicted]);
    let found = starts.filter_map(|start| symmetry::centre(picture, start, window));
    let best = found.min_by(|a, b| a.asymmetry.total_cmp(&b.asymmetry))?;
    (best.asymmetry < MAX_ASYMMETRY).then_some(best.at)
}

/// Finds the visible corners of a board of `columns` × `rows` inner corners.
///
/// # Errors
/// The picture shows no chessboard, or a larger one.
pub fn find_chessboard(
    picture: &Grey,
    columns: u32,
    rows: u32,
) -> Result<ChessboardDetection, NoChessboard> {
    let mut best = Grid::default();
    let mut level = picture.clone();
    let mut scale = 1.0;
    while level.width.max(level.height) > MAX_SEARCH_SIZE {
        level = level.halved();
        scale *= 2.0;
    }
    let corner_count = (columns * rows) as usize;
    for _ in 0..3 {
        let grid = find_in_level(&level, corner_count);
        // A coarser level must show more of the board, because it is less accurate.
        if grid.area() * scale * scale > 1.1 * best.area() {
            best = grid;
            best.corners.values_mut().for_each(|p| *p *= scale);
        }
        if best.corners.len() >= corner_count || level.width.min(level.height) < 160 {
            break;
        }
        level = level.halved();
        scale *= 2.0;
    }
    complete::refine_all(&picture.blurred(SMOOTHING), &mut best);
    if best.corners.len() < MIN_CORNERS {
        return Err(NoChessboard::NotSeen);
    }
    assignment::assign(best, columns, rows)
}

fn find_in_level(picture: &Grey, corner_count: usize) -> Grid {
    let saddles = saddles::find(picture);
    let links = links::find(picture, &saddles);
    let mut grid = grid::largest(&saddles, &links);
    if grid.corners.len() < corner_count && grid.corners.len() >= MIN_CORNERS {
        complete::fill(picture, &mut grid);
    }
    grid
}

#[cfg(test)]
mod tests;
