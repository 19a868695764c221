//! The smallest rectangle around points of a plane.

use super::{Layer, Receiver, ShadowingPlane};
use glam::{DVec2, DVec3};

/// Axes of a plane before its rectangle is known: `right × up` is the normal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axes {
    pub right: DVec3,
    pub up: DVec3,
    pub normal: DVec3,
}

impl Axes {
    /// Axes around `normal`, `up` as near the world's +Z (for level planes +Y) as can be.
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

    /// The axes turned by `angle` about the normal.
    fn turned(self, angle: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let right = self.right * cos + self.up * sin;
        Self {
            right,
            up: self.normal.cross(right),
            normal: self.normal,
        }
    }
}

/// The plane whose rectangle is the smallest around `points`, `front` metres along its
/// normal, and as deep as `depth`.
pub(super) fn plane_around(
    axes: Axes,
    points: &[DVec3],
    front: f64,
    depth: f64,
    layer: Layer,
) -> ShadowingPlane {
    let flat: Vec<DVec2> = points.iter().map(|p| axes.flat(*p)).collect();
    let axes = axes.turned(best_turn(&hull(flat)));
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
        // A texel and a half of 128 more on each side, so that filters stay inside, and never
        // nothing.
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

/// One half of the hull, without its last corner.
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

/// By how much to turn so that the box around `hull` is smallest: one of its sides lies
/// along an edge (Freeman & Shapira 1975). Between −45° and 45°.
fn best_turn(hull: &[DVec2]) -> f64 {
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut best = (area(hull, 0.0), 0.0);
    for (i, a) in hull.iter().enumerate() {
        let b = hull[(i + 1) % hull.len()];
        let angle = (b - *a).to_angle();
        let angle = angle - (angle / quarter).round() * quarter;
        let area = area(hull, angle);
        // Upright unless turning gains something.
        if area < best.0 * 0.98 || (best.1 != 0.0 && area < best.0) {
            best = (area, angle);
        }
    }
    best.1
}

fn area(hull: &[DVec2], angle: f64) -> f64 {
    let turn = DVec2::from_angle(-angle);
    let (low, high) = hull
        .iter()
        .map(|p| turn.rotate(*p))
        .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(low, high), p| {
            (low.min(p), high.max(p))
        });
    let size = high - low;
    size.x * size.y
}
