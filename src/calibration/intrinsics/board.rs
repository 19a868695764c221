//! Boards: which point of a printed pattern is where.
//!
//! Board frame: +X along a row, +Y down the columns, +Z into the paper, the origin at the
//! first corner; metres. So a board seen upright from the front has the camera's own axes.

use glam::DVec2;
use thiserror::Error;

/// A pattern to calibrate with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Board {
    /// A chessboard, by its inner corners.
    Chess {
        /// Inner corners in a row: one less than squares.
        columns: u32,
        /// Rows of inner corners.
        rows: u32,
        /// Edge of a square, metres.
        square: f64,
    },
    /// Kalibr's grid of AprilTags 36h11; black squares join the tags' corners.
    AprilGrid {
        /// Tags in a row.
        columns: u32,
        /// Rows of tags.
        rows: u32,
        /// Edge of a tag's black border, metres.
        tag: f64,
        /// Gap between tags as a share of `tag` (Kalibr's tagSpacing).
        gap: f64,
    },
    /// A chessboard with markers in its white squares (OpenCV's `CharucoBoard`).
    Charuco {
        /// Squares in a row.
        columns: u32,
        /// Rows of squares.
        rows: u32,
        /// Edge of a square, metres.
        square: f64,
        /// Edge of a marker, metres.
        marker: f64,
    },
}

/// What was typed is no board.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum BoardError {
    /// Not of the form expected.
    #[error(
        "board `{text}`: write chess:COLUMNSxROWS:SQUARE (inner corners, metres), \
         aprilgrid:COLUMNSxROWS:TAG:GAP (metres, share of the tag) or \
         charuco:COLUMNSxROWS:SQUARE:MARKER (squares, metres), e.g. chess:9x6:0.025"
    )]
    Unreadable {
        /// As typed.
        text: String,
    },
    /// A number that no board can have.
    #[error("board `{text}`: {reason}")]
    Impossible {
        /// As typed.
        text: String,
        /// Which, and what would do.
        reason: &'static str,
    },
}

/// No board has more rows or columns.
const MOST: u32 = 100;

impl Board {
    /// Reads `chess:9x6:0.025` and the like.
    ///
    /// # Errors
    /// Another form, or impossible numbers: sizes are in metres, and above 2 m nobody prints.
    pub fn parse(text: &str) -> Result<Self, BoardError> {
        let unreadable = || BoardError::Unreadable {
            text: text.to_owned(),
        };
        let mut parts = text.split(':');
        let kind = parts.next().unwrap_or_default();
        let counts = parts.next().and_then(|c| c.split_once(['x', 'X', '×']));
        let (columns, rows) = counts.ok_or_else(unreadable)?;
        let columns: u32 = columns.trim().parse().map_err(|_| unreadable())?;
        let rows: u32 = rows.trim().parse().map_err(|_| unreadable())?;
        let lengths: Vec<f64> = parts
            .map(|p| p.trim().parse().map_err(|_| unreadable()))
            .collect::<Result<_, _>>()?;
        let board = match (kind, lengths.as_slice()) {
            ("chess", &[square]) => Self::Chess {
                columns,
                rows,
                square,
            },
            ("aprilgrid", &[tag, gap]) => Self::AprilGrid {
                columns,
                rows,
                tag,
                gap,
            },
            ("charuco", &[square, marker]) => Self::Charuco {
                columns,
                rows,
                square,
                marker,
            },
            _ => return Err(unreadable()),
        };
        board.check().map_err(|reason| BoardError::Impossible {
            text: text.to_owned(),
            reason,
        })?;
        Ok(board)
    }

    /// Why there can be no such board.
    fn check(&self) -> Result<(), &'static str> {
        let ((columns, rows), edge) = match *self {
            Self::Chess {
                columns,
                rows,
                square,
            } => ((columns, rows), square),
            Self::AprilGrid {
                columns, rows, tag, ..
            } => ((columns, rows), tag),
            Self::Charuco {
                columns,
                rows,
                square,
                ..
            } => ((columns, rows), square),
        };
        let least = if matches!(self, Self::AprilGrid { .. }) {
            1
        } else {
            3
        };
        if columns < least || rows < least || columns > MOST || rows > MOST {
            return Err("columns and rows must be 3 to 100 (an AprilGrid's 1 to 100)");
        }
        if !(edge > 0.0 && edge <= 2.0) {
            return Err("sizes are in metres, above 0 and at most 2 (25 mm is 0.025)");
        }
        match *self {
            Self::AprilGrid { gap, .. } if !(gap > 0.0 && gap < 2.0) => {
                Err("the gap is a share of the tag, above 0 and below 2 (Kalibr's is 0.3)")
            }
            Self::Charuco { square, marker, .. } if !(marker > 0.0 && marker < square) => {
                Err("the marker must be smaller than its square")
            }
            _ => Ok(()),
        }
    }

    /// Number of points that can be found on it.
    #[must_use]
    pub const fn point_count(&self) -> usize {
        match *self {
            Self::Chess { columns, rows, .. } => columns as usize * rows as usize,
            Self::AprilGrid { columns, rows, .. } => 4 * columns as usize * rows as usize,
            Self::Charuco { columns, rows, .. } => (columns as usize - 1) * (rows as usize - 1),
        }
    }

    /// Distance between neighbouring points, metres.
    #[must_use]
    pub const fn pitch(&self) -> f64 {
        match *self {
            Self::Chess { square, .. } | Self::Charuco { square, .. } => square,
            Self::AprilGrid { tag, .. } => tag,
        }
    }
}

impl std::fmt::Display for Board {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Chess {
                columns,
                rows,
                square,
            } => write!(f, "chess:{columns}x{rows}:{square}"),
            Self::AprilGrid {
                columns,
                rows,
                tag,
                gap,
            } => {
                write!(f, "aprilgrid:{columns}x{rows}:{tag}:{gap}")
            }
            Self::Charuco {
                columns,
                rows,
                square,
                marker,
            } => {
                write!(f, "charuco:{columns}x{rows}:{square}:{marker}")
            }
        }
    }
}

/// A point of the board and where it was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// On the board, metres.
    pub point: DVec2,
    /// In the picture.
    pub pixel: DVec2,
}

/// One picture of the board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct View {
    /// For messages: a file's name, or a time.
    pub name: String,
    /// In no order.
    pub points: Vec<Correspondence>,
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn boards_are_read_as_they_are_written() {
        for text in [
            "chess:9x6:0.025",
            "aprilgrid:6x6:0.088:0.3",
            "charuco:8x5:0.03:0.022",
        ] {
            assert_eq!(Board::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Board::parse("chess:9x6:0.025").unwrap().point_count(), 54);
        assert_eq!(
            Board::parse("charuco:8x5:0.03:0.022")
                .unwrap()
                .point_count(),
            28
        );
    }

    #[test]
    fn what_is_no_board_is_told_in_one_line() {
        for (text, says) in [
            ("", "write chess:"),
            ("chess", "write chess:"),
            ("chess:9x6", "write chess:"),
            ("chess:9by6:0.02", "write chess:"),
            ("chess:9x6:25", "metres"),
            ("chess:9x6:-0.1", "metres"),
            ("chess:9x6:nan", "metres"),
            ("chess:1x6:0.02", "3 to 100"),
            ("chess:9x4000000000:0.02", "3 to 100"),
            ("aprilgrid:6x6:0.088:3", "gap"),
            ("charuco:6x6:0.03:0.03", "marker"),
            ("circles:6x6:0.03", "write chess:"),
        ] {
            let error = Board::parse(text).unwrap_err().to_string();
            assert!(error.contains(says) && !error.contains('\n'), "{error}");
        }
    }
}
