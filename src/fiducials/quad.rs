//! Finds quadrilaterals: outlines with four straight sides.

use glam::DVec2;

/// Minimum length of a side, pixels.
const MIN_SIDE: f64 = 8.0;
/// Minimum ratio of the enclosed area to the squared length of the outline. An axis-aligned square
/// has 1/16, a square rotated by 45°, followed along cracks, 1/32.
const MIN_AREA_RATIO: f64 = 1.0 / 160.0;

/// Returns the corners (pixels) of the convex quadrilateral that an outline encloses, clockwise on
/// the screen like the outline; `None` if the outline is no such quadrilateral.
pub(super) fn quad(outline: &[DVec2]) -> Option<[DVec2; 4]> {
    let n = outline.len();
    let area = area(outline);
    if area < MIN_SIDE * MIN_SIDE || area < MIN_AREA_RATIO * (n * n) as f64 {
        return None;
    }
    let at = split(outline)?;
    let mut lines = [(DVec2::ZERO, DVec2::ZERO); 4];
    for k in 0..4 {
        lines[k] = side(outline, at[k], at[(k + 1) % 4])?;
    }
    let mut corners = [DVec2::ZERO; 4];
    for k in 0..4 {
        corners[k] = intersection(lines[(k + 3) % 4], lines[k])?;
    }
    let near_outline =
        |k: usize| corners[k].distance(outline[at[k]]) < 3.0 + 0.1 * (n as f64 / 4.0);
    ((0..4).all(near_outline) && is_convex(&corners)).then_some(corners)
}

/// Enclosed area, pixels squared; positive for clockwise order on the screen.
fn area(points: &[DVec2]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points
        .iter()
        .zip(next)
        .map(|(a, b)| a.perp_dot(*b))
        .sum::<f64>()
        / 2.0
}

/// Returns the indices of the four corners in the outline, in its order: the point farthest from the
/// centroid, the point farthest from that one, and twice the point farthest from the polygon so far
/// (Ramer–Douglas–Peucker); then each corner once more by its neighbours.
fn split(outline: &[DVec2]) -> Option<[usize; 4]> {
    let middle = outline.iter().sum::<DVec2>() / outline.len() as f64;
    let first = farthest(outline, middle);
    let mut at = [first, farthest(outline, outline[first]), 0, 0];
    for known in 2..4 {
        at[..known].sort_unstable();
        let sides = (0..known).map(|k| farthest_off(outline, at[k], at[(k + 1) % known]));
        let (off, i) = sides.max_by(|a, b| a.0.total_cmp(&b.0))?;
        if off < 0.25 * MIN_SIDE {
            return None;
        }
        at[known] = i;
    }
    at.sort_unstable();
    // The first two can be neighbours: a side of a slanted square can be longer than its
    // diagonals. The point farthest from that side lies anywhere on the opposite side, so choose
    // each corner once more between its neighbours.
    for k in [0, 1, 2, 3, 0, 1, 2, 3] {
        at[k] = farthest_off(outline, at[(k + 3) % 4], at[(k + 1) % 4]).1;
    }
    Some(at)
}

fn farthest(outline: &[DVec2], from: DVec2) -> usize {
    let mut best = (0, -1.0);
    for (i, p) in outline.iter().enumerate() {
        let off = p.distance_squared(from);
        if off > best.1 {
            best = (i, off);
        }
    }
    best.0
}

/// Indices between two indices of a closed outline.
fn between(n: usize, from: usize, to: usize) -> impl Iterator<Item = usize> {
    let count = (to + n - from) % n;
    (1..count).map(move |k| (from + k) % n)
}

/// Returns the largest distance (pixels) of a section's points from its chord, and that point.
fn farthest_off(outline: &[DVec2], from: usize, to: usize) -> (f64, usize) {
    let along = (outline[to] - outline[from]).normalize_or_zero();
    let mut best = (0.0, from);
    for i in between(outline.len(), from, to) {
        let off = along.perp_dot(outline[i] - outline[from]).abs();
        if off > best.0 {
            best = (off, i);
        }
    }
    best
}

/// Fits a line (a point, a unit vector) to a section of the outline by least squares, without a
/// tenth at either end; `None` if the section is not straight.
fn side(outline: &[DVec2], from: usize, to: usize) -> Option<(DVec2, DVec2)> {
    let n = outline.len();
    let count = (to + n - from) % n;
    let margin = (count / 10).max(1);
    if count < 6 + 2 * margin {
        return None;
    }
    let section = || (margin..=count - margin).map(|k| outline[(from + k) % n]);
    let used = (count - 2 * margin + 1) as f64;
    let mean = section().sum::<DVec2>() / used;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in section() {
        let d = p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    let along = DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy));
    let chord = outline[to] - outline[from];
    let along = if along.dot(chord) < 0.0 {
        -along
    } else {
        along
    };
    // The smaller eigenvalue is the mean squared distance from the line.
    let off = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt()) / used;
    let allowed = 0.7 + 0.015 * chord.length();
    (off < allowed * allowed).then_some((mean, along))
}

/// Returns the intersection of two lines (a point, a unit vector); `None` if they are nearly
/// parallel.
pub(super) fn intersection((p, u): (DVec2, DVec2), (q, v): (DVec2, DVec2)) -> Option<DVec2> {
    let det = u.perp_dot(v);
    (det.abs() > 0.1).then(|| p + u * ((q - p).perp_dot(v) / det))
}

/// Returns whether the corners are convex, clockwise on the screen, and every side is long enough.
pub(super) fn is_convex(corners: &[DVec2; 4]) -> bool {
    (0..4).all(|k| {
        let (a, b) = (
            corners[(k + 1) % 4] - corners[k],
            corners[(k + 2) % 4] - corners[(k + 1) % 4],
        );
        a.length() >= MIN_SIDE && a.perp_dot(b) > 0.05 * a.length() * b.length()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points along a polygon, one pixel apart.
    fn outline_of(corners: &[DVec2]) -> Vec<DVec2> {
        let next = corners.iter().cycle().skip(1);
        let sides = corners.iter().zip(next);
        sides
            .flat_map(|(a, b)| {
                let n = a.distance(*b).round() as usize;
                (0..n).map(move |k| a.lerp(*b, k as f64 / n as f64))
            })
            .collect()
    }

    /// The near side is longer than the diagonals, and pixels bow the far side outwards.
    #[test]
    fn finds_corners_of_square_whose_near_side_is_longer_than_its_diagonals() {
        let corners = [(0.0, 0.0), (90.0, 60.0), (90.0, 140.0), (0.0, 200.0)].map(DVec2::from);
        let bow = |p: DVec2| {
            p + DVec2::X
                * if p.x == 90.0 && (p.y - 100.0).abs() < 20.0 {
                    0.5
                } else {
                    0.0
                }
        };
        let outline: Vec<DVec2> = outline_of(&corners).into_iter().map(bow).collect();
        let found = quad(&outline).unwrap();
        for corner in corners {
            let nearest = found
                .iter()
                .map(|f| f.distance(corner))
                .fold(f64::MAX, f64::min);
            assert!(nearest < 0.6, "{corner} {found:?}");
        }
    }

    #[test]
    fn finds_slanted_quadrilateral_and_rejects_other_shapes() {
        let corners = [(10.0, 12.0), (93.0, 5.0), (80.0, 44.0), (25.0, 60.0)].map(DVec2::from);
        let found = quad(&outline_of(&corners)).unwrap();
        for corner in corners {
            let nearest = found
                .iter()
                .map(|f| f.distance(corner))
                .fold(f64::MAX, f64::min);
            assert!(nearest < 0.2, "{corner} {found:?}");
        }
        let polygon = |n: usize| -> Vec<DVec2> {
            let at = |k: usize| DVec2::from_angle(std::f64::consts::TAU * k as f64 / n as f64);
            outline_of(&(0..n).map(|k| 30.0 * at(k) + 40.0).collect::<Vec<_>>())
        };
        assert!(quad(&polygon(4)).is_some());
        assert_eq!(quad(&polygon(3)), None);
        assert_eq!(quad(&polygon(5)), None);
        assert_eq!(quad(&polygon(60)), None);
        let tiny = [(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)].map(DVec2::from);
        assert_eq!(quad(&outline_of(&tiny)), None);
    }
}
