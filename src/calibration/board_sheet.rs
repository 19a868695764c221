//! Calibration boards to print at true scale.

pub(crate) mod pattern;

use super::intrinsics::Board;
use super::sheet::{Black, RULER, Sheet, Text, ruler};

/// White margin around the pattern, as a share of a square; the detection of the outer squares
/// needs it. With half a square, the default board of 9×6 corners and 25 mm fits a sheet of A4.
const MARGIN: f64 = 0.5;
/// Height below the pattern for ruler and caption, metres.
const FOOTER: f64 = 0.010;

/// Lays out a board on a sheet, with a ruler and a caption. The top left square of a chessboard is
/// black, as is a ChArUco board's (OpenCV since 4.6).
#[must_use]
pub fn sheet_of(board: &Board) -> Sheet {
    let pattern = pattern::from_board(board);
    let margin = MARGIN * pattern.border;
    let width = pattern.width + 2.0 * margin;
    let shift = |b: &Black| Black {
        x: b.x + margin,
        y: b.y + margin,
        ..*b
    };
    let mut black: Vec<Black> = pattern.black.iter().map(shift).collect();
    // The ruler may lie in the lower margin: it crosses no edge of the pattern.
    let footer_top = pattern.height + 1.5 * margin;
    black.extend(ruler(margin, footer_top, width - 2.0 * margin));
    Sheet {
        width,
        height: footer_top + FOOTER,
        black,
        texts: vec![Text {
            x: margin,
            y: footer_top + 0.65 * FOOTER,
            points: 6.0,
            text: format!(
                "Penumbra --board {board}   print at 100 %, not fitted to the page; \
                 the line above is {:.0} mm long: measure it",
                1000.0 * RULER.min(width - 2.0 * margin)
            ),
        }],
        ..Sheet::default()
    }
}

#[cfg(test)]
mod tests;
