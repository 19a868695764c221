//! Layout of a board's tags: checks from neighbouring tags that the board in a picture is the given
//! one.

use super::board::Board;
use super::homography;
use glam::{DMat3, DVec2, IVec2};

/// A tag detected in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectedTag {
    /// Its number within the family.
    pub id: u32,
    /// Corners of its black border: top left, top right, bottom right, bottom left of the tag as
    /// printed; pixels.
    pub corners: [DVec2; 4],
}

/// Maximum distance of compared tags, grid steps; limited by lens distortion.
const MAX_DISTANCE: i32 = 2;
/// Maximum deviation of a tag from its grid position, as a share of a step.
const MAX_DEVIATION: f64 = 0.25;
/// Minimum share of neighbours that are consistent with the board.
const MIN_CONSISTENT: f64 = 0.75;
/// Maximum number of columns of other boards that are tried.
const MAX_COLUMNS: u32 = 40;

/// Assignment of tag numbers to a board's cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Cells in a row: tags, or squares of a ChArUco board.
    pub columns: u32,
    /// Rows of cells.
    pub rows: u32,
    /// For a ChArUco board: the top left square is white and has the first marker, as OpenCV before
    /// 4.6 laid out boards with an even number of rows.
    pub white_first: bool,
    /// Every cell has a tag (AprilGrid).
    every_cell: bool,
}

impl Layout {
    /// Returns the board's default layout; `None` for a chessboard.
    #[must_use]
    pub const fn from_board(board: &Board) -> Option<Self> {
        let (columns, rows, every_cell) = match *board {
            Board::Chess { .. } => return None,
            Board::AprilGrid { columns, rows, .. } => (columns, rows, true),
            Board::Charuco { columns, rows, .. } => (columns, rows, false),
        };
        Some(Self {
            columns,
            rows,
            white_first: false,
            every_cell,
        })
    }

    /// Returns the alternative layout, if there is one.
    #[must_use]
    pub fn alternative(self) -> Option<Self> {
        (!self.every_cell && self.rows.is_multiple_of(2)).then_some(Self {
            white_first: !self.white_first,
            ..self
        })
    }

    /// Returns column and row of a tag's cell, from the top left; `None` if it is not on the board.
    #[must_use]
    pub fn cell(self, id: u32) -> Option<IVec2> {
        let cell = self.unbounded(id);
        (cell.y >= 0 && cell.y < self.rows as i32).then_some(cell)
    }

    fn unbounded(self, id: u32) -> IVec2 {
        let (columns, rows, id) = (self.columns as i32, self.rows as i32, id as i32);
        if self.every_cell {
            // Kalibr counts from the lower left, row by row upwards.
            return IVec2::new(id % columns, rows - 1 - id / columns);
        }
        // OpenCV counts the white squares row by row from the top left.
        let first = i32::from(!self.white_first);
        let two_rows = columns;
        let (pair, mut rest) = (id / two_rows, id % two_rows);
        let in_first_row = (columns + 1 - first) / 2;
        let (mut row, mut start) = (2 * pair, first);
        if rest >= in_first_row {
            rest -= in_first_row;
            (row, start) = (row + 1, 1 - first);
        }
        IVec2::new(start + 2 * rest, row)
    }
}

/// Comparison of a picture's tags with the board.
#[derive(Clone, Debug, PartialEq)]
pub struct Fit {
    /// The layout of the tags: the default or the alternative one.
    pub layout: Layout,
    /// Number of pairs of neighbours that were compared; 0 leaves the layout unchecked.
    pub pairs: usize,
    /// Number of columns with which most pairs are consistent, if they are not with the given
    /// board.
    pub other_columns: Option<u32>,
    /// The tags are inconsistent with the board.
    pub is_inconsistent: bool,
    /// Tags consistent with the layout, and tags without neighbours.
    pub tags: Vec<DetectedTag>,
}

/// Relative position of two tags, grid steps.
struct Pair {
    from: usize,
    to: usize,
    step: IVec2,
}

/// Determines which of the two layouts of `board` the tags have; `default` if both fit equally.
#[must_use]
pub fn fit(board: &Board, tags: &[DetectedTag], default: Layout) -> Fit {
    let pairs = pairs(board, tags);
    let share = |layout: Layout| {
        let consistent = pairs
            .iter()
            .filter(|p| is_consistent(layout, tags, p))
            .count();
        consistent as f64 / pairs.len().max(1) as f64
    };
    let mut layout = default;
    if let Some(other) = default.alternative()
        && share(other) > share(default)
    {
        layout = other;
    }
    let is_inconsistent = pairs.len() >= 3 && share(layout) < MIN_CONSISTENT;
    let other_columns = is_inconsistent
        .then(|| best_columns(layout, &share))
        .flatten();
    Fit {
        layout,
        pairs: pairs.len(),
        other_columns,
        is_inconsistent,
        tags: consistent_tags(layout, tags, &pairs),
    }
}

fn is_consistent(layout: Layout, tags: &[DetectedTag], pair: &Pair) -> bool {
    let cell = |i: usize| layout.unbounded(tags[i].id);
    cell(pair.to) - cell(pair.from) == pair.step
}

fn best_columns(given: Layout, share: &impl Fn(Layout) -> f64) -> Option<u32> {
    let candidates = (1..=MAX_COLUMNS).flat_map(|columns| {
        let one = Layout { columns, ..given };
        let other = Layout {
            white_first: !given.white_first && !given.every_cell,
            ..one
        };
        [one, other].map(|layout| (share(layout), columns))
    });
    let best = candidates.max_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 >= MIN_CONSISTENT).then_some(best.1)
}

/// Returns the tags of the board that are consistent with most of their neighbours; of duplicate
/// numbers, the first.
fn consistent_tags(layout: Layout, tags: &[DetectedTag], pairs: &[Pair]) -> Vec<DetectedTag> {
    let mut votes = vec![0_i32; tags.len()];
    for pair in pairs {
        let vote = if is_consistent(layout, tags, pair) {
            1
        } else {
            -1
        };
        votes[pair.from] += vote;
        votes[pair.to] += vote;
    }
    let mut out: Vec<DetectedTag> = Vec::new();
    for (tag, _) in tags.iter().zip(&votes).filter(|(_, votes)| **votes >= 0) {
        let is_new = out.iter().all(|known| known.id != tag.id);
        if is_new && layout.cell(tag.id).is_some() {
            out.push(*tag);
        }
    }
    out
}

/// Returns pairs of neighbouring tags; their relative positions follow from the homography of one
/// tag, independently of the tags' numbers.
fn pairs(board: &Board, tags: &[DetectedTag]) -> Vec<Pair> {
    let step = match *board {
        Board::Chess { .. } => return Vec::new(),
        Board::AprilGrid { gap, .. } => 1.0 + gap,
        Board::Charuco { square, marker, .. } => square / marker,
    };
    let mut out = Vec::new();
    for (from, tag) in tags.iter().enumerate() {
        let Some(tag_from_picture) = tag_from_picture(tag) else {
            continue;
        };
        for (to, other) in tags.iter().enumerate().filter(|(to, _)| *to != from) {
            let middle = other.corners.iter().sum::<DVec2>() / 4.0;
            let image = tag_from_picture * middle.extend(1.0);
            let at = image.truncate() / image.z / step;
            let rounded = at.round();
            let near =
                rounded.abs().max_element() <= f64::from(MAX_DISTANCE) && rounded != DVec2::ZERO;
            if near && at.distance(rounded) < MAX_DEVIATION {
                let step = rounded.as_ivec2();
                out.push(Pair { from, to, step });
            }
        }
    }
    out
}

/// Returns the homography from pixels to the tag's frame: edge 1, origin at the centre.
fn tag_from_picture(tag: &DetectedTag) -> Option<DMat3> {
    let around = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(DVec2::from);
    let pairs: Vec<_> = around.into_iter().zip(tag.corners).collect();
    let picture_from_tag = homography::from_pixels(&pairs)?;
    let inverse = picture_from_tag.inverse();
    inverse.is_finite().then_some(inverse)
}

#[cfg(test)]
mod tests;
