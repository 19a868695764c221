//! Calibration boards and the positions of their points.
//!
//! Board frame: +X along a row, +Y down the columns, +Z into the paper, the origin at the
//! first corner; metres. A board seen upright from the front has the axes of the camera frame.

use glam::DVec2;
use penumbra_fiducials::{Family, UnknownFamily};
use thiserror::Error;

/// A calibration pattern.
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
    /// Kalibr's grid of AprilTags; black squares join the tags' corners.
    AprilGrid {
        /// Tags in a row.
        columns: u32,
        /// Rows of tags.
        rows: u32,
        /// Edge of a tag's black border, metres.
        tag: f64,
        /// Gap between tags as a share of `tag` (Kalibr's tagSpacing).
        gap: f64,
        /// Family of the tags, numbered from 0.
        family: Family,
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
        /// Dictionary of the markers, numbered from 0.
        family: Family,
    },
}

/// Errors of parsing a board.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum BoardError {
    /// The text has the wrong form.
    #[error(
        "board `{text}`: write chess:COLUMNSxROWS:SQUARE (inner corners, metres), \
         aprilgrid:COLUMNSxROWS:TAG:GAP (metres, share of the tag) or \
         charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY (squares, metres), e.g. chess:9x6:0.025 \
         or charuco:8x5:0.03:0.022:4x4_50"
    )]
    Unreadable {
        /// The text.
        text: String,
    },
    /// The tag family is unknown.
    #[error("board `{text}`: {reason}")]
    Tags {
        /// The text.
        text: String,
        /// The known families.
        reason: UnknownFamily,
    },
    /// A number is out of range.
    #[error("board `{text}`: {reason}")]
    Impossible {
        /// The text.
        text: String,
        /// The number and its valid range.
        reason: &'static str,
    },
}

/// Maximum number of rows or columns.
const MAX_COUNT: u32 = 100;

impl Board {
    /// Parses a board, e.g. `chess:9x6:0.025`.
    ///
    /// # Errors
    /// The text has another form, or a number is out of range: sizes are in metres, at most 2 m.
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
        let (lengths, family) = lengths_and_family(text, parts)?;
        let board = match (kind, lengths.as_slice()) {
            ("chess", &[square]) if family.is_none() => Self::Chess {
                columns,
                rows,
                square,
            },
            ("aprilgrid", &[tag, gap]) => Self::AprilGrid {
                columns,
                rows,
                tag,
                gap,
                family: family.unwrap_or(Family::Kalibr36h11),
            },
            ("charuco", &[square, marker]) => Self::Charuco {
                columns,
                rows,
                square,
                marker,
                family: family.unwrap_or(default_dictionary(columns.saturating_mul(rows) / 2)),
            },
            _ => return Err(unreadable()),
        };
        board.check().map_err(|reason| BoardError::Impossible {
            text: text.to_owned(),
            reason,
        })?;
        Ok(board)
    }

    /// Checks that the numbers are in range; the error is the valid range.
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
        let min = if matches!(self, Self::AprilGrid { .. }) {
            1
        } else {
            3
        };
        if columns < min || rows < min || columns > MAX_COUNT || rows > MAX_COUNT {
            return Err("columns and rows must be 3 to 100 (an AprilGrid's 1 to 100)");
        }
        if !(edge > 0.0 && edge <= 2.0) {
            return Err("sizes must be in metres, above 0 and at most 2 (25 mm is 0.025)");
        }
        let numbers = self.family().map_or(0, Family::count);
        if self.tag_count() > numbers && self.family().is_some() {
            return Err("the board has more tags than its dictionary; use a larger one");
        }
        match *self {
            Self::AprilGrid { gap, .. } if !(gap > 0.0 && gap < 2.0) => {
                Err("the gap must be a share of the tag, above 0 and below 2 (Kalibr's is 0.3)")
            }
            Self::Charuco { square, marker, .. } if !(marker > 0.0 && marker < square) => {
                Err("the marker must be smaller than its square")
            }
            _ => Ok(()),
        }
    }

    /// Returns the family of its tags; `None` for a chessboard.
    #[must_use]
    pub const fn family(&self) -> Option<Family> {
        match *self {
            Self::Chess { .. } => None,
            Self::AprilGrid { family, .. } | Self::Charuco { family, .. } => Some(family),
        }
    }

    /// Returns whether its tags are upside down: OpenCV stores AprilTag codes rotated by 180° and
    /// draws them rotated on its boards.
    #[must_use]
    pub const fn has_rotated_tags(&self) -> bool {
        matches!(
            self,
            Self::Charuco {
                family: Family::Tag36h11 | Family::Tag25h9 | Family::Tag16h5 | Family::Kalibr36h11,
                ..
            }
        )
    }

    /// Returns the number of tags on it.
    #[must_use]
    pub const fn tag_count(&self) -> u32 {
        match *self {
            Self::Chess { .. } => 0,
            Self::AprilGrid { columns, rows, .. } => columns * rows,
            Self::Charuco { columns, rows, .. } => columns * rows / 2,
        }
    }

    /// Returns the number of points that can be detected on it.
    #[must_use]
    pub const fn point_count(&self) -> usize {
        match *self {
            Self::Chess { columns, rows, .. } => columns as usize * rows as usize,
            Self::AprilGrid { columns, rows, .. } => 4 * columns as usize * rows as usize,
            Self::Charuco { columns, rows, .. } => (columns as usize - 1) * (rows as usize - 1),
        }
    }

    /// Returns the distance between neighbouring points, metres.
    #[must_use]
    pub const fn pitch(&self) -> f64 {
        match *self {
            Self::Chess { square, .. } | Self::Charuco { square, .. } => square,
            Self::AprilGrid { tag, .. } => tag,
        }
    }
}

/// Parses the lengths after the counts and, if there are three parts, the family.
fn lengths_and_family<'a>(
    text: &str,
    parts: impl Iterator<Item = &'a str>,
) -> Result<(Vec<f64>, Option<Family>), BoardError> {
    let mut parts: Vec<&str> = parts.map(str::trim).collect();
    let has_family = parts.len() == 3;
    let family = parts.pop_if(|_| has_family).map(str::parse).transpose();
    let family = family.map_err(|reason| BoardError::Tags {
        text: text.to_owned(),
        reason,
    })?;
    let lengths = parts.iter().map(|p| p.parse()).collect::<Result<_, _>>();
    lengths
        .map(|lengths| (lengths, family))
        .map_err(|_| BoardError::Unreadable {
            text: text.to_owned(),
        })
}

/// Returns OpenCV's smallest 4×4 dictionary with at least this number of markers.
fn default_dictionary(markers: u32) -> Family {
    let sizes = [50, 100, 250].into_iter();
    let enough = |n: &u16| u32::from(*n) >= markers;
    Family::Aruco4x4({ sizes }.find(enough).unwrap_or(1000))
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
                family,
            } => {
                write!(f, "aprilgrid:{columns}x{rows}:{tag}:{gap}")?;
                match family {
                    Family::Kalibr36h11 => Ok(()),
                    other => write!(f, ":{other}"),
                }
            }
            Self::Charuco {
                columns,
                rows,
                square,
                marker,
                family,
            } => {
                write!(f, "charuco:{columns}x{rows}:{square}:{marker}:{family}")
            }
        }
    }
}

/// A point of the board and its position in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// Position on the board, metres.
    pub point: DVec2,
    /// Position in the picture, pixels.
    pub pixel: DVec2,
}

/// One picture of the board.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct View {
    /// Name for messages: file name or time.
    pub name: String,
    /// The points, in any order.
    pub points: Vec<Correspondence>,
}

#[cfg(test)]
mod tests;
