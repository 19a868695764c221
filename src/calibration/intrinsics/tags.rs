//! Converts detected tags (AprilTags or ArUco markers) to points of the board.

use super::board::{Board, Correspondence};
use super::homography;
use super::layout::{Layout, SeenTag};
use glam::DVec2;
use penumbra_fiducials::Family;

/// No window reaches farther than this share of the way to the next corner.
const WINDOW: f64 = 0.55;
/// Least radius in which a corner alone can be seen, pixels.
const LEAST_WINDOW: f64 = 2.0;
/// A corner may be off from where it was foretold by this share of the way to the next.
const OFF: f64 = 0.25;

/// How closely a corner may be looked at.
#[derive(Clone, Copy)]
struct Room {
    /// Radius about it that no other edge enters, or only evenly from both sides, pixels.
    window: f64,
    /// How far it may be from where it was foretold, pixels.
    off: f64,
}

/// The points of `board` that the tags show, whose numbers go over it as `layout` says. On an
/// AprilGrid these are the tags' corners, where black squares meet. On a ChArUco board they are
/// the chessboard's corners between the markers, foretold from the markers next to them. Both
/// are brought to the true corner by `refine`: (foretold pixel, radius of the window in pixels)
/// to the corner, `None` where there is none. Tags that are not on the board are passed over; a
/// chessboard has none.
#[must_use]
pub fn correspondences(
    board: &Board,
    layout: Layout,
    tags: &[SeenTag],
    refine: impl Fn(DVec2, f64) -> Option<DVec2>,
) -> Vec<Correspondence> {
    let refined = |point: DVec2, foretold: DVec2, room: Room| {
        // What is smaller would be drawn to the edges beside it.
        let pixel = refine(foretold, room.window).filter(|_| room.window > LEAST_WINDOW)?;
        (pixel.distance(foretold) < room.off).then_some(Correspondence { point, pixel })
    };
    let known = tags
        .iter()
        .flat_map(|tag| on_board(board, layout, tag).map(move |c| (c, tag)));
    match *board {
        Board::Chess { .. } => Vec::new(),
        Board::AprilGrid { gap, family, .. } => known
            .filter_map(|(c, tag)| refined(c.point, c.pixel, room_at_tag(tag, gap, family)))
            .collect(),
        Board::Charuco {
            columns,
            rows,
            square,
            marker,
            family,
        } => {
            let known: Vec<Correspondence> = known.map(|(c, _)| c).collect();
            // Into the markers' borders: they look the same from both sides, and pull it nowhere.
            let border = marker * f64::from(family.border()) / f64::from(family.modules());
            let clear = (0.5 * (square - marker) + 0.5 * border) / square;
            (1..columns * rows)
                .map(|i| (i % columns, i / columns))
                .filter(|&(x, y)| x > 0 && y > 0)
                .filter_map(|(x, y)| {
                    let point = DVec2::new(f64::from(x), f64::from(y)) * square;
                    let (foretold, pitch) = foretell(&known, point, square)?;
                    let room = Room {
                        window: clear.min(WINDOW) * pitch,
                        off: OFF * pitch,
                    };
                    refined(point, foretold, room)
                })
                .collect()
        }
    }
}

/// A tag's corner on an AprilGrid: up to the tag's own word and to the far edges of the black
/// square that it touches.
fn room_at_tag(tag: &SeenTag, gap: f64, family: Family) -> Room {
    let [a, b, c, d] = tag.corners;
    let longest = [b - a, c - b, d - c, a - d]
        .iter()
        .map(|side| side.length())
        .fold(1e-9, f64::max);
    // Where a tag is foreshortened much less than its width.
    let depth = 0.5 * (c - a).perp_dot(d - b).abs() / longest;
    let border = f64::from(family.border()) / f64::from(family.modules());
    Room {
        window: depth * (0.9 * border).min(0.7 * gap),
        off: (0.1 * depth).max(1.5),
    }
}

/// Returns the tag's corners on the board.
fn on_board(
    board: &Board,
    layout: Layout,
    tag: &SeenTag,
) -> impl Iterator<Item = Correspondence> + use<> {
    let (pitch, inset, size) = match *board {
        Board::Chess { square, .. } => (square, 0.0, square),
        Board::AprilGrid { tag, gap, .. } => (tag * (1.0 + gap), 0.0, tag),
        Board::Charuco { square, marker, .. } => (square, 0.5 * (square - marker), marker),
    };
    let around = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    let pairs = around.into_iter().zip(tag.corners);
    layout.cell(tag.id).into_iter().flat_map(move |cell| {
        let corner = cell.as_dvec2() * pitch + inset;
        pairs.clone().map(move |(step, pixel)| Correspondence {
            point: corner + step * size,
            pixel,
        })
    })
}

/// Tags that were not seen, beside those that were: where they must be. On an AprilGrid their
/// corners are brought to where black squares meet, as in [`correspondences`].
pub(super) fn neighbours_foretold(
    board: &Board,
    layout: Layout,
    tags: &[SeenTag],
    refine: impl Fn(DVec2, f64) -> Option<DVec2>,
) -> Vec<SeenTag> {
    let missing = (0..board.tag_count()).filter(|id| tags.iter().all(|tag| tag.id != *id));
    let foretold = missing.filter_map(|id| {
        let cell = layout.cell(id)?;
        let within = |steps: i32| -> Vec<(DVec2, DVec2)> {
            let beside = |tag: &&SeenTag| {
                let other = layout.cell(tag.id);
                other.is_some_and(|other| (other - cell).abs().max_element() <= steps)
            };
            let near = tags.iter().filter(beside);
            let points = near.flat_map(|tag| on_board(board, layout, tag));
            points.map(|c| (c.point, c.pixel)).collect()
        };
        // The lens bends what is farther off, and one tag alone foretells too little.
        let known = (1..=2).map(within).find(|known| known.len() >= 8)?;
        let h = homography::from_pixels(&known)?;
        let blank = SeenTag {
            id,
            corners: [DVec2::ZERO; 4],
        };
        let mut corners = [DVec2::ZERO; 4];
        for (corner, c) in corners.iter_mut().zip(on_board(board, layout, &blank)) {
            let image = h * c.point.extend(1.0);
            *corner = image.truncate() / image.z;
        }
        let tag = SeenTag { id, corners };
        corners.iter().all(|c| c.is_finite()).then(|| match *board {
            Board::AprilGrid { gap, family, .. } => {
                let window = room_at_tag(&tag, gap, family).window;
                let found = |c: DVec2| refine(c, window).unwrap_or(c);
                SeenTag {
                    id,
                    corners: corners.map(found),
                }
            }
            _ => tag,
        })
    });
    foretold.collect()
}

/// Where a point should be by the markers next to it, and how far apart rows are there,
/// pixels. Markers farther off would bring the lens's distortion in.
fn foretell(known: &[Correspondence], point: DVec2, square: f64) -> Option<(DVec2, f64)> {
    let near: Vec<(DVec2, DVec2)> = known
        .iter()
        .filter(|c| (c.point - point).abs().max_element() < 1.05 * square)
        .map(|c| (c.point - point, c.pixel))
        .collect();
    let h = homography::from_pixels(&near)?;
    let at = |p: DVec2| {
        let image = h * p.extend(1.0);
        (image.z.abs() > 1e-12).then(|| image.truncate() / image.z)
    };
    let here = at(DVec2::ZERO)?;
    let step = |by: DVec2| Some(at(by)? - here);
    let (u, v) = (step(DVec2::X * square)?, step(DVec2::Y * square)?);
    // At a slant the next row is nearer than its corners are.
    let pitch = u.perp_dot(v).abs() / u.length().max(v.length()).max(1e-9);
    Some((here, pitch))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Projects a plane in perspective.
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
        let layout = Layout::of(&board).unwrap();
        let points = correspondences(&board, layout, &tags, |p, _| Some(p));
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
        let layout = Layout::of(&board).unwrap();
        let points = correspondences(&board, layout, &tags, |p, _| Some(p));
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
        assert!(correspondences(&board, layout, &tags, |_, _| None).is_empty());
        let far = correspondences(&board, layout, &tags, |p, window| Some(p + window));
        assert!(far.is_empty());
    }
}
