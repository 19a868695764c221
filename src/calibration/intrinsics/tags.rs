//! Converts detected tags (AprilTags or ArUco markers) to points of the board.

use super::board::{Board, Correspondence};
use super::homography;
use super::layout::{DetectedTag, Layout};
use glam::DVec2;
use penumbra_fiducials::Family;

/// Maximum radius of the refinement window, as a share of the distance to the next corner.
const MAX_WINDOW: f64 = 0.55;
/// Minimum radius of the refinement window, pixels; smaller ones show no isolated corner.
const MIN_WINDOW: f64 = 2.0;
/// Maximum deviation of a corner from its prediction, as a share of the distance to the next
/// corner.
const MAX_DEVIATION: f64 = 0.25;

/// Limits of the refinement of a corner.
#[derive(Clone, Copy)]
struct RefinementLimits {
    /// Radius without other edges, except point-symmetric ones, pixels.
    window: f64,
    /// Maximum deviation from the predicted position, pixels.
    deviation: f64,
}

/// Returns the points of `board` that the tags locate; `layout` assigns the tags' numbers to cells.
/// On an AprilGrid these are the tags' corners, where black squares meet. On a ChArUco board they
/// are the chessboard's corners between the markers, predicted from neighbouring markers. `refine`
/// maps (predicted pixel, radius of the window in pixels) to the corner, `None` if there is none.
/// Tags that are not on the board are ignored; a chessboard gives no points.
#[must_use]
pub fn correspondences(
    board: &Board,
    layout: Layout,
    tags: &[DetectedTag],
    refine: impl Fn(DVec2, f64) -> Option<DVec2>,
) -> Vec<Correspondence> {
    let refined = |point: DVec2, predicted: DVec2, limits: RefinementLimits| {
        // In a smaller window neighbouring edges would bias the corner.
        let pixel = refine(predicted, limits.window).filter(|_| limits.window > MIN_WINDOW)?;
        (pixel.distance(predicted) < limits.deviation).then_some(Correspondence { point, pixel })
    };
    let known = tags
        .iter()
        .flat_map(|tag| on_board(board, layout, tag).map(move |c| (c, tag)));
    match *board {
        Board::Chess { .. } => Vec::new(),
        Board::AprilGrid { gap, family, .. } => known
            .filter_map(|(c, tag)| refined(c.point, c.pixel, tag_corner_limits(tag, gap, family)))
            .collect(),
        Board::Charuco {
            columns,
            rows,
            square,
            marker,
            family,
        } => {
            let known: Vec<Correspondence> = known.map(|(c, _)| c).collect();
            // Reaches into the markers' borders: they are point-symmetric and do not bias the
            // corner.
            let border = marker * f64::from(family.border()) / f64::from(family.modules());
            let clear = (0.5 * (square - marker) + 0.5 * border) / square;
            (1..columns * rows)
                .map(|i| (i % columns, i / columns))
                .filter(|&(x, y)| x > 0 && y > 0)
                .filter_map(|(x, y)| {
                    let point = DVec2::new(f64::from(x), f64::from(y)) * square;
                    let (predicted, pitch) = predict(&known, point, square)?;
                    let limits = RefinementLimits {
                        window: clear.min(MAX_WINDOW) * pitch,
                        deviation: MAX_DEVIATION * pitch,
                    };
                    refined(point, predicted, limits)
                })
                .collect()
        }
    }
}

/// Returns the limits for a tag's corner on an AprilGrid: the window excludes the tag's code and
/// the far edges of the adjacent black square.
fn tag_corner_limits(tag: &DetectedTag, gap: f64, family: Family) -> RefinementLimits {
    let [a, b, c, d] = tag.corners;
    let longest = [b - a, c - b, d - c, a - d]
        .iter()
        .map(|side| side.length())
        .fold(1e-9, f64::max);
    // The smaller dimension of a foreshortened tag.
    let depth = 0.5 * (c - a).perp_dot(d - b).abs() / longest;
    let border = f64::from(family.border()) / f64::from(family.modules());
    RefinementLimits {
        window: depth * (0.9 * border).min(0.7 * gap),
        deviation: (0.1 * depth).max(1.5),
    }
}

/// Returns the tag's corners on the board.
fn on_board(
    board: &Board,
    layout: Layout,
    tag: &DetectedTag,
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

/// Predicts undetected tags next to detected ones. On an AprilGrid their corners are refined to
/// where black squares meet, as in [`correspondences`].
pub(super) fn predict_missing_tags(
    board: &Board,
    layout: Layout,
    tags: &[DetectedTag],
    refine: impl Fn(DVec2, f64) -> Option<DVec2>,
) -> Vec<DetectedTag> {
    let missing = (0..board.tag_count()).filter(|id| tags.iter().all(|tag| tag.id != *id));
    let predicted = missing.filter_map(|id| {
        let cell = layout.cell(id)?;
        let within = |steps: i32| -> Vec<(DVec2, DVec2)> {
            let is_near = |tag: &&DetectedTag| {
                let other = layout.cell(tag.id);
                other.is_some_and(|other| (other - cell).abs().max_element() <= steps)
            };
            let near = tags.iter().filter(is_near);
            let points = near.flat_map(|tag| on_board(board, layout, tag));
            points.map(|c| (c.point, c.pixel)).collect()
        };
        // Lens distortion excludes farther tags, and one tag alone predicts too inaccurately.
        let known = (1..=2).map(within).find(|known| known.len() >= 8)?;
        let h = homography::from_pixels(&known)?;
        let blank = DetectedTag {
            id,
            corners: [DVec2::ZERO; 4],
        };
        let mut corners = [DVec2::ZERO; 4];
        for (corner, c) in corners.iter_mut().zip(on_board(board, layout, &blank)) {
            let image = h * c.point.extend(1.0);
            *corner = image.truncate() / image.z;
        }
        let tag = DetectedTag { id, corners };
        corners.iter().all(|c| c.is_finite()).then(|| match *board {
            Board::AprilGrid { gap, family, .. } => {
                let window = tag_corner_limits(&tag, gap, family).window;
                let found = |c: DVec2| refine(c, window).unwrap_or(c);
                DetectedTag {
                    id,
                    corners: corners.map(found),
                }
            }
            _ => tag,
        })
    });
    predicted.collect()
}

/// Predicts a point from the adjacent markers; also returns the distance of rows there, pixels.
/// Lens distortion excludes farther markers.
fn predict(known: &[Correspondence], point: DVec2, square: f64) -> Option<(DVec2, f64)> {
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
    // In oblique views the next row is nearer than its corners.
    let pitch = u.perp_dot(v).abs() / u.length().max(v.length()).max(1e-9);
    Some((here, pitch))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Projects a plane in perspective.
    fn projected(p: DVec2) -> DVec2 {
        let w = 1.0 + 0.8 * p.x - 0.5 * p.y;
        DVec2::new(
            100.0 + 2000.0 * p.x + 150.0 * p.y,
            80.0 - 100.0 * p.x + 1900.0 * p.y,
        ) / w
    }

    fn tag(id: u32, corner: DVec2, size: f64) -> DetectedTag {
        let around = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        DetectedTag {
            id,
            corners: around.map(|step| projected(corner + step * size)),
        }
    }

    #[test]
    fn april_grid_points_are_tag_corners() {
        let board = Board::parse("aprilgrid:3x2:0.04:0.25").unwrap();
        // Tag 1 is the middle one of the lower row.
        let tags = [
            tag(1, DVec2::new(0.05, 0.05), 0.04),
            tag(9, DVec2::ZERO, 0.04),
        ];
        let layout = Layout::from_board(&board).unwrap();
        let points = correspondences(&board, layout, &tags, |p, _| Some(p));
        assert_eq!(points.len(), 4);
        assert!(points[2].point.distance(DVec2::new(0.09, 0.09)) < 1e-12);
        assert!(points[2].pixel.distance(projected(points[2].point)) < 1e-9);
    }

    #[test]
    fn charuco_points_lie_between_markers() {
        let board = Board::parse("charuco:4x3:0.03:0.02").unwrap();
        // White squares in order: (1, 0), (3, 0), (0, 1), (2, 1), ...
        let corner = |x: f64, y: f64| DVec2::new(x, y) * 0.03 + 0.005;
        let tags = [
            tag(0, corner(1.0, 0.0), 0.02),
            tag(2, corner(0.0, 1.0), 0.02),
        ];
        let layout = Layout::from_board(&board).unwrap();
        let points = correspondences(&board, layout, &tags, |p, _| Some(p));
        let first = points
            .iter()
            .find(|c| c.point == DVec2::splat(0.03))
            .unwrap();
        assert!(first.pixel.distance(projected(first.point)) < 1e-6);
        assert!(
            points
                .iter()
                .all(|c| c.pixel.distance(projected(c.point)) < 1e-6)
        );
        assert!(correspondences(&board, layout, &tags, |_, _| None).is_empty());
        let far = correspondences(&board, layout, &tags, |p, window| Some(p + window));
        assert!(far.is_empty());
    }
}
