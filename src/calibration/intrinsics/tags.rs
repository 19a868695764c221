//! From tags seen to points of the board: the seam between a detector of AprilTags or ArUco
//! markers and calibration.

use super::board::{Board, Correspondence};
use super::homography;
use glam::{DVec2, DVec3};

/// A tag in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenTag {
    /// Its number within the family.
    pub id: u32,
    /// Corners of its black border: top left, top right, bottom right, bottom left of the tag
    /// as it is printed; pixels.
    pub corners: [DVec2; 4],
}

/// The points of `board` that the tags show. On an AprilGrid these are the tags' corners. On
/// a ChArUco board they are the chessboard's corners between the markers, foretold from the
/// markers next to them and brought to the true corner by `refine`: (foretold pixel, distance
/// to the nearest other corner in pixels) to the corner, `None` where there is none. Tags
/// that are not on the board are passed over; a chessboard has none.
#[must_use]
pub fn correspondences(
    board: &Board,
    tags: &[SeenTag],
    refine: impl Fn(DVec2, f64) -> Option<DVec2>,
) -> Vec<Correspondence> {
    match *board {
        Board::Chess { .. } => Vec::new(),
        Board::AprilGrid { .. } => tags.iter().flat_map(|tag| on_board(board, tag)).collect(),
        Board::Charuco {
            columns,
            rows,
            square,
            ..
        } => {
            let known: Vec<Correspondence> =
                tags.iter().flat_map(|tag| on_board(board, tag)).collect();
            (1..columns * rows)
                .map(|i| (i % columns, i / columns))
                .filter(|&(x, y)| x > 0 && y > 0)
                .filter_map(|(x, y)| {
                    let point = DVec2::new(f64::from(x), f64::from(y)) * square;
                    let (foretold, pitch) = foretell(&known, point, square)?;
                    let pixel = refine(foretold, pitch)?;
                    (pixel.distance(foretold) < 0.25 * pitch)
                        .then_some(Correspondence { point, pixel })
                })
                .collect()
        }
    }
}

/// The tag's corners, where the board has it.
fn on_board(board: &Board, tag: &SeenTag) -> Vec<Correspondence> {
    let (corner, size) = match *board {
        // Kalibr counts from the lower left, row by row upwards; its board frame is turned to
        // ours, whose rows run downwards.
        Board::AprilGrid {
            columns,
            rows,
            tag: size,
            gap,
        } if tag.id < columns * rows => {
            let (x, y) = (tag.id % columns, rows - 1 - tag.id / columns);
            let pitch = size * (1.0 + gap);
            (DVec2::new(f64::from(x), f64::from(y)) * pitch, size)
        }
        // OpenCV puts markers into the white squares, row by row from the top left square,
        // which is black.
        Board::Charuco {
            columns,
            rows,
            square,
            marker,
        } => {
            let white = (0..columns * rows)
                .map(|i| (i % columns, i / columns))
                .filter(|(x, y)| (x + y) % 2 == 1)
                .nth(tag.id as usize);
            let Some((x, y)) = white else {
                return Vec::new();
            };
            let inset = 0.5 * (square - marker);
            (
                DVec2::new(f64::from(x), f64::from(y)) * square + inset,
                marker,
            )
        }
        _ => return Vec::new(),
    };
    let around = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    around
        .iter()
        .zip(tag.corners)
        .map(|(step, pixel)| Correspondence {
            point: corner + *step * size,
            pixel,
        })
        .collect()
}

/// Where a point should be by the markers next to it, and how far apart corners are there,
/// pixels. Markers farther off would bring the lens's distortion in.
fn foretell(known: &[Correspondence], point: DVec2, square: f64) -> Option<(DVec2, f64)> {
    let near: Vec<(DVec2, DVec3)> = known
        .iter()
        .filter(|c| (c.point - point).abs().max_element() < 1.05 * square)
        .map(|c| (c.point - point, c.pixel.extend(1.0)))
        .collect();
    let h = homography::from_rays(&near)?;
    let at = |p: DVec2| {
        let image = h * p.extend(1.0);
        (image.z.abs() > 1e-12).then(|| image.truncate() / image.z)
    };
    let here = at(DVec2::ZERO)?;
    let apart = |step: DVec2| Some(at(step)?.distance(here));
    let pitch = apart(DVec2::X * square)?.min(apart(DVec2::Y * square)?);
    Some((here, pitch))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// A plane in perspective.
    fn seen(p: DVec2) -> DVec2 {
        let w = 1.0 + 0.8 * p.x - 0.5 * p.y;
        DVec2::new(
            100.0 + 2000.0 * p.x + 150.0 * p.y,
            80.0 - 100.0 * p.x + 1900.0 * p.y,
        ) / w
    }

    fn tag(id: u32, corner: DVec2, size: f64) -> SeenTag {
        let around = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        SeenTag {
            id,
            corners: around.map(|step| seen(corner + step * size)),
        }
    }

    #[test]
    fn an_april_grids_points_are_its_tags_corners() {
        let board = Board::parse("aprilgrid:3x2:0.04:0.25").unwrap();
        // Tag 1 is the middle one of the lower row.
        let tags = [
            tag(1, DVec2::new(0.05, 0.05), 0.04),
            tag(9, DVec2::ZERO, 0.04),
        ];
        let points = correspondences(&board, &tags, |p, _| Some(p));
        assert_eq!(points.len(), 4);
        assert!(points[2].point.distance(DVec2::new(0.09, 0.09)) < 1e-12);
        assert!(points[2].pixel.distance(seen(points[2].point)) < 1e-9);
    }

    #[test]
    fn a_charuco_boards_points_lie_between_its_markers() {
        let board = Board::parse("charuco:4x3:0.03:0.02").unwrap();
        // White squares in order: (1, 0), (3, 0), (0, 1), (2, 1), ...
        let corner = |x: f64, y: f64| DVec2::new(x, y) * 0.03 + 0.005;
        let tags = [
            tag(0, corner(1.0, 0.0), 0.02),
            tag(2, corner(0.0, 1.0), 0.02),
        ];
        let points = correspondences(&board, &tags, |p, _| Some(p));
        let first = points
            .iter()
            .find(|c| c.point == DVec2::splat(0.03))
            .unwrap();
        assert!(first.pixel.distance(seen(first.point)) < 1e-6);
        assert!(
            points
                .iter()
                .all(|c| c.pixel.distance(seen(c.point)) < 1e-6)
        );
        assert!(correspondences(&board, &tags, |_, _| None).is_empty());
        let far = correspondences(&board, &tags, |p, pitch| Some(p + pitch));
        assert!(far.is_empty());
    }
}
