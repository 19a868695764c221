//! The black rectangles of a board, independent of the sheet.

use crate::intrinsics::Board;
use crate::intrinsics::layout::Layout;
use crate::sheet::Black;
use penumbra_fiducials::Family;

/// A board's black rectangles, metres from its top left corner.
pub(crate) struct Pattern {
    pub width: f64,
    pub height: f64,
    /// Edge of the outer squares, metres; the white margin is proportional to it.
    pub border: f64,
    pub black: Vec<Black>,
}

pub(crate) fn from_board(board: &Board) -> Pattern {
    match *board {
        Board::Chess {
            columns,
            rows,
            square,
        } => chess(columns + 1, rows + 1, square),
        Board::AprilGrid {
            columns,
            rows,
            tag,
            gap,
            family,
        } => april_grid(board, (columns, rows), (tag, gap * tag), family),
        Board::Charuco {
            columns,
            rows,
            square,
            marker,
            family,
        } => {
            let mut pattern = chess(columns, rows, square);
            let inset = 0.5 * (square - marker);
            let at =
                |x: i32, y: i32| (f64::from(x) * square + inset, f64::from(y) * square + inset);
            pattern.add_tags(board, family, marker, at);
            pattern
        }
    }
}

/// Lays out the black squares of a chessboard: those whose column and row have an even sum.
fn chess(columns: u32, rows: u32, square: f64) -> Pattern {
    let all = (0..columns * rows).map(|i| (i % columns, i / columns));
    let black = all.filter(|(x, y)| (x + y) % 2 == 0);
    Pattern {
        width: f64::from(columns) * square,
        height: f64::from(rows) * square,
        border: square,
        black: black
            .map(|(x, y)| black_square(f64::from(x) * square, f64::from(y) * square, square))
            .collect(),
    }
}

/// Lays out the tags, and the black squares at the crossings of the gaps (Kalibr).
fn april_grid(
    board: &Board,
    (columns, rows): (u32, u32),
    (tag, gap): (f64, f64),
    family: Family,
) -> Pattern {
    let pitch = tag + gap;
    let corners = (0..(columns + 1) * (rows + 1)).map(|i| (i % (columns + 1), i / (columns + 1)));
    let mut pattern = Pattern {
        width: f64::from(columns) * pitch + gap,
        height: f64::from(rows) * pitch + gap,
        border: gap,
        black: corners
            .map(|(x, y)| black_square(f64::from(x) * pitch, f64::from(y) * pitch, gap))
            .collect(),
    };
    let at = |x: i32, y: i32| (f64::from(x) * pitch + gap, f64::from(y) * pitch + gap);
    pattern.add_tags(board, family, tag, at);
    pattern
}

const fn black_square(x: f64, y: f64, edge: f64) -> Black {
    Black {
        x,
        y,
        width: edge,
        height: edge,
    }
}

impl Pattern {
    /// Adds all tags; `at` returns the top left corner of a tag's border from its column and row.
    fn add_tags(
        &mut self,
        board: &Board,
        family: Family,
        size: f64,
        at: impl Fn(i32, i32) -> (f64, f64),
    ) {
        let Some(layout) = Layout::from_board(board) else {
            return;
        };
        for id in 0..board.tag_count() {
            if let Some(cell) = layout.cell(id) {
                let (x, y) = at(cell.x, cell.y);
                let tag = tag_modules((family, id), board.has_rotated_tags(), size, (x, y));
                self.black.extend(tag);
            }
        }
    }
}

/// Returns a tag's black modules; adjacent ones of a row are one rectangle. `left` and `top` are
/// those of its border, metres.
pub(crate) fn tag_modules(
    (family, id): (Family, u32),
    rotated: bool,
    size: f64,
    (left, top): (f64, f64),
) -> Vec<Black> {
    let n = family.modules();
    let is_white = |x: u32, y: u32| match rotated {
        true => family.is_white(id, n - 1 - x, n - 1 - y),
        false => family.is_white(id, x, y),
    };
    let module = size / f64::from(n);
    let mut black = Vec::new();
    for row in 0..n {
        let mut column = 0;
        while column < n {
            let run = (column..n).take_while(|&x| !is_white(x, row)).count() as u32;
            if run > 0 {
                black.push(Black {
                    x: left + f64::from(column) * module,
                    y: top + f64::from(row) * module,
                    width: f64::from(run) * module,
                    height: module,
                });
            }
            column += run + 1;
        }
    }
    black
}
