//! The smallest rectangle around points in a plane.

use super::{Layer, Receiver, ShadowingPlane};
use glam::{DVec2, DVec3};

/// Axes of a plane; `right × up` is the normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axes {
    pub right: DVec3,
    pub up: DVec3,
    pub normal: DVec3,
}

impl Axes {
    /// Returns the axes of `normal` with `up` nearest to the world's +Z (+Y for level planes).
    pub fn around(normal: DVec3) -> Self {
        let hint = if normal.z.abs() > 0.95 {
            DVec3::Y
        } else {
            DVec3::Z
        };
        let right = hint.cross(normal).normalize_or(DVec3::X);
        Self {
            right,
            up: normal.cross(right),
            normal,
        }
    }

    /// Coordinates of a point along the axes.
    pub fn flat(&self, p: DVec3) -> DVec2 {
        DVec2::new(p.dot(self.right), p.dot(self.up))
    }

    /// The axes rotated by `angle` (radians) about the normal.
    fn rotated(self, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let right = self.right * cos + self.up * sin;
        Self {
            right,
            up: self.normal.cross(right),
            normal: self.normal,
        }
    }
}

/// Returns the plane with the smallest rectangle around `points`, at `front` metres along its normal,
/// with the depth `depth`.
pub(super) fn plane_around(
    axes: Axes,
    points: &[DVec3],
    front: f64,
    depth: f64,
    layer: Layer,
) -> ShadowingPlane {
    let flat: Vec<DVec2> = points.iter().map(|p| axes.flat(*p)).collect();
    let axes = axes.rotated(best_angle(&hull(flat)));
    let (low, high) = points
        .iter()
        .map(|p| axes.flat(*p))
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        });
    let middle = low.midpoint(high);
    let half = (high - low) / 2.0;
    ShadowingPlane {
        centre: axes.right * middle.x + axes.up * middle.y + axes.normal * front,
        right: axes.right,
        up: axes.up,
        // Margin of 1.5 of 128 texels on each side for filters; never zero.
        half_size: half * 1.025 + DVec2::splat(half.max_element() * 1e-3 + 1e-6),
        depth,
        layer,
        receiver: Receiver::Surface,
        parts: Vec::new(),
    }
}

/// Corners of the convex hull, counter-clockwise (Andrew 1979).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut out = half_hull(points.iter());
    out.extend(half_hull(points.iter().rev()));
    out
}

/// Lower or upper half of the hull, without its last corner.
fn half_hull<'a>(points: impl Iterator<Item = &'a DVec2>) -> Vec<DVec2> {
    let mut chain: Vec<DVec2> = Vec::new();
    for p in points {
        while let [.., a, b] = chain.as_slice()
            && (*b - *a).perp_dot(*p - *b) <= 0.0
        {
            chain.pop();
        }
        chain.push(*p);
    }
    chain.pop();
    chain
}

/// Angle of the smallest box around `hull`, −45° to 45°, radians: one side lies along an edge
/// (Freeman and Shapira 1975).
fn best_angle(hull: &[DVec2]) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut best = (area(hull, 0.0), 0.0);
    for (i, a) in hull.iter().enumerate() {
        let b = hull[(i + 1) % hull.len()];
        let angle = (b - *a).to_angle();
        let angle = angle - (angle / quarter).round() * quarter;
        let area = area(hull, angle);
        // Upright unless a rotation reduces the area by more than 2 %.
        if area < best.0 * 0.98 || (best.1 != 0.0 && area < best.0) {
            best = (area, angle);
        }
    }
    best.1
}

fn area(hull: &[DVec2], angle: f64) -> f64 {
    let rotation = DVec2::from_angle(-angle);
    let (low, high) = hull
        .iter()
        .map(|p| rotation.rotate(*p))
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        });
    let size = high - low;
    size.x * size.y
}
