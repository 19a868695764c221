//! The homography from a tag's square to its four corners.

use glam::{DMat3, DVec2, DVec3};

/// Returns the homography from the square of half side `half` about (0, 0), corners clockwise on
/// the screen from the top left, to `corners` (Heckbert, "Fundamentals of Texture Mapping and
/// Image Warping", 1989, section 2.2.3); `None` if the corners are degenerate.
pub(super) fn from_square(half: f64, corners: &[DVec2; 4]) -> Option<DMat3> {
    let [a, b, c, d] = *corners;
    // From the unit square to the corners.
    let (e, f) = (b - c, d - c);
    let sum = a - b + c - d;
    let det = e.perp_dot(f);
    if det.abs() < 1e-9 * (e.length() * f.length()).max(f64::MIN_POSITIVE) {
        return None;
    }
    let (g, h) = (sum.perp_dot(f) / det, e.perp_dot(sum) / det);
    let unit = DMat3::from_cols(
        (b - a + g * b).extend(g),
        (d - a + h * d).extend(h),
        a.extend(1.0),
    );
    let scale = 0.5 / half;
    let unit_from_square = DMat3::from_cols(
        DVec3::new(scale, 0.0, 0.0),
        DVec3::new(0.0, scale, 0.0),
        DVec3::new(0.5, 0.5, 1.0),
    );
    let map = unit * unit_from_square;
    map.is_finite().then_some(map)
}

/// Maps a point.
pub(super) fn apply(map: &DMat3, p: DVec2) -> DVec2 {
    let q = *map * p.extend(1.0);
    q.truncate() / q.z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_corners_to_corners_and_centre_to_intersection_of_diagonals() {
        let corners = [(3.0, 4.0), (40.0, 9.0), (37.0, 61.0), (-5.0, 30.0)].map(DVec2::from);
        let map = from_square(2.0, &corners).unwrap();
        let square = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)].map(DVec2::from);
        for (from, to) in square.into_iter().zip(corners) {
            assert!(apply(&map, from).distance(to) < 1e-10);
        }
        let diagonal = |a: usize, b: usize| (corners[a], (corners[b] - corners[a]).normalize());
        let middle = super::super::quad::intersection(diagonal(0, 2), diagonal(1, 3)).unwrap();
        assert!(apply(&map, DVec2::ZERO).distance(middle) < 1e-9);
        assert!(from_square(1.0, &[DVec2::ZERO, DVec2::X, 2.0 * DVec2::X, DVec2::Y]).is_some());
        assert_eq!(
            from_square(
                1.0,
                &[DVec2::ZERO, DVec2::X, 2.0 * DVec2::X, 3.0 * DVec2::X]
            ),
            None
        );
    }
}
