//! Outlines with four straight sides.

use glam::DVec2;

/// Pixels of the shortest side of use.
const SHORTEST_SIDE: f64 = 8.0;
/// Least share of the outline's circumference, squared, that it encloses: a square seen straight
/// has a sixteenth, one on its corner along cracks a thirty-second.
const LEAST_AREA: f64 = 1.0 / 160.0;

/// Corners of the convex quadrilateral that an outline goes round, clockwise on the screen as
/// the outline itself; pixels.
pub(super) fn quad(outline: &[DVec2]) -> Option<[DVec2; 4]> {
    let n = outline.len();
    let area = area(outline);
    if area < SHORTEST_SIDE * SHORTEST_SIDE || area < LEAST_AREA * (n * n) as f64 {
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
    let true_to = |k: usize| corners[k].distance(outline[at[k]]) < 3.0 + 0.1 * (n as f64 / 4.0);
    ((0..4).all(true_to) && is_convex(&corners)).then_some(corners)
}

/// Enclosed, pixels squared; above zero clockwise on the screen.
fn area(points: &[DVec2]) -> f64 {
    let next = points.iter().cycle().skip(1);
    points
        .iter()
        .zip(next)
        .map(|(a, b)| a.perp_dot(*b))
        .sum::<f64>()
        / 2.0
}

/// Places of the four corners in the outline, in its order: the point farthest from the
/// middle, the one farthest from that, and twice the one farthest off the polygon so far
/// (Ramer–Douglas–Peucker).
fn split(outline: &[DVec2]) -> Option<[usize; 4]> {
    let middle = outline.iter().sum::<DVec2>() / outline.len() as f64;
    let first = farthest(outline, middle);
    let mut at = [first, farthest(outline, outline[first]), 0, 0];
    for known in 2..4 {
        at[..known].sort_unstable();
        let sides = (0..known).map(|k| farthest_off(outline, at[k], at[(k + 1) % known]));
        let (off, i) = sides.max_by(|a, b| a.0.total_cmp(&b.0))?;
        if off < 0.25 * SHORTEST_SIDE {
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

/// Between two places, round the end where need be.
fn between(n: usize, from: usize, to: usize) -> impl Iterator<Item = usize> {
    let count = (to + n - from) % n;
    (1..count).map(move |k| (from + k) % n)
}

/// The point farthest off the chord of a stretch, and how far, pixels.
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

/// A line (a point, a unit vector) through a stretch of the outline by least squares, less a
/// tenth at either end; `None` where it is not straight.
fn side(outline: &[DVec2], from: usize, to: usize) -> Option<(DVec2, DVec2)> {
    let n = outline.len();
    let count = (to + n - from) % n;
    let margin = (count / 10).max(1);
    if count < 6 + 2 * margin {
        return None;
    }
    let stretch = || (margin..=count - margin).map(|k| outline[(from + k) % n]);
    let used = (count - 2 * margin + 1) as f64;
    let mean = stretch().sum::<DVec2>() / used;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in stretch() {
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
    // The smaller eigenvalue: the mean square off the line.
    let off = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt()) / used;
    let allowed = 0.7 + 0.015 * chord.length();
    (off < allowed * allowed).then_some((mean, along))
}

pub(super) fn intersection((p, u): (DVec2, DVec2), (q, v): (DVec2, DVec2)) -> Option<DVec2> {
    let det = u.perp_dot(v);
    (det.abs() > 0.1).then(|| p + u * ((q - p).perp_dot(v) / det))
}

/// Clockwise on the screen, every side long enough.
pub(super) fn is_convex(corners: &[DVec2; 4]) -> bool {
    (0..4).all(|k| {
        let (a, b) = (
            corners[(k + 1) % 4] - corners[k],
            corners[(k + 2) % 4] - corners[(k + 1) % 4],
        );
        a.length() >= SHORTEST_SIDE && a.perp_dot(b) > 0.05 * a.length() * b.length()
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    /// Points a pixel apart round a polygon.
    fn round(corners: &[DVec2]) -> Vec<DVec2> {
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
        let outline: Vec<DVec2> = round(&corners).into_iter().map(bow).collect();
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
    fn a_slanted_quadrilateral_is_found_and_other_shapes_are_not() {
        let corners = [(10.0, 12.0), (93.0, 5.0), (80.0, 44.0), (25.0, 60.0)].map(DVec2::from);
        let found = quad(&round(&corners)).unwrap();
        for corner in corners {
            let nearest = found
                .iter()
                .map(|f| f.distance(corner))
                .fold(f64::MAX, f64::min);
            assert!(nearest < 0.2, "{corner} {found:?}");
        }
        let polygon = |n: usize| -> Vec<DVec2> {
            let at = |k: usize| DVec2::from_angle(std::f64::consts::TAU * k as f64 / n as f64);
            round(&(0..n).map(|k| 30.0 * at(k) + 40.0).collect::<Vec<_>>())
        };
        assert!(quad(&polygon(4)).is_some());
        assert_eq!(quad(&polygon(3)), None);
        assert_eq!(quad(&polygon(5)), None);
        assert_eq!(quad(&polygon(60)), None);
        let tiny = [(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (0.0, 6.0)].map(DVec2::from);
        assert_eq!(quad(&round(&tiny)), None);
    }
}
