//! Depth maps of casters as a light sees them, rasterised on the processor.
//!
//! The map of a distant light is orthographic. A near one is moved to infinity together with the
//! space around it, by the projective map that keeps the plane through the light's reference
//! across its direction:
//!
//! ```text
//!   (x, y, h) → (x, y, h) / w,   w = 1 − κ h
//! ```
//!
//! with x, y across the direction and h along it, towards the light, from the reference; κ is the
//! reciprocal of its distance. Lines stay lines, and all rays from the light become parallel, so
//! its map is orthographic, too. A lamp of radius R becomes a disc of the angular radius κ R, so
//! penumbrae keep their form.

use crate::lanes::{dot, dot_each, gather, whole};
use crate::layout::Bounds;
use crate::ranges::Ranges;
use glam::{Vec2, Vec3};
use penumbra_lighting::DomeLight;
use penumbra_lighting::place::LEAST_W;
use pulp::Simd;

/// Depth where there is no caster, metres.
pub const FAR: f32 = f32::INFINITY;

/// A view along a direction, or from a place, fitted to casters.
#[derive(Clone, Copy, Debug)]
pub struct View {
    right: Vec3,
    up: Vec3,
    /// The light.
    pub light: DomeLight,
    /// Coordinates of the first texel's corner along right and up, metres.
    low: Vec2,
    /// Texels per metre.
    scale: f32,
}

impl View {
    /// Fits a view of `size` texels a side to all `points` (world) that can cast a shadow; `None`
    /// without any.
    pub fn fitted(
        points: impl Iterator<Item = Vec3>,
        light: &DomeLight,
        size: usize,
    ) -> Option<Self> {
        let (right, up) = light.direction.any_orthonormal_pair();
        let flat = |p| light.in_light_space([right, up], p).map(Vec3::truncate);
        let mut points = points.filter_map(flat);
        let first = points.next()?;
        let (low, high) = points.fold((first, first), |(lo, hi), p| (lo.min(p), hi.max(p)));
        // A border of two texels keeps filtering at the edge free of casters.
        let side = (high - low).max_element().max(1e-4) * (1.0 + 6.0 / size as f32);
        let centre = 0.5 * (low + high);
        Some(Self {
            right,
            up,
            light: *light,
            low: centre - 0.5 * side,
            scale: size as f32 / side,
        })
    }

    /// Texel coordinates of a point, and its distance away from the light, metres; NaN for a point
    /// that casts no shadow, so near to a light or behind it.
    #[inline(always)]
    pub fn project(&self, p: Vec3) -> (Vec2, f32) {
        let own = self.light.in_light_space([self.right, self.up], p);
        let own = own.unwrap_or(Vec3::NAN);
        ((own.truncate() - self.low) * self.scale, own.z)
    }

    /// Length of a texel, metres.
    #[inline(always)]
    pub fn texel(&self) -> f32 {
        1.0 / self.scale
    }

    /// Whether the light is near.
    pub fn is_near(&self) -> bool {
        !self.light.place.is_far()
    }

    /// Vectors from points to the light, in units of its distance from the reference.
    #[inline(always)]
    pub fn towards_each<S: Simd>(&self, simd: S, p: [S::f32s; 3]) -> [S::f32s; 3] {
        let fixed = self.light.towards(Vec3::ZERO);
        let nearness = simd.splat_f32s(self.light.place.inverse_distance);
        let [x, y, z] = p;
        [
            simd.sub_f32s(simd.splat_f32s(fixed.x), simd.mul_f32s(nearness, x)),
            simd.sub_f32s(simd.splat_f32s(fixed.y), simd.mul_f32s(nearness, y)),
            simd.sub_f32s(simd.splat_f32s(fixed.z), simd.mul_f32s(nearness, z)),
        ]
    }

    /// Texel coordinates of points, and their distances away from the light, metres. Points behind
    /// a near light are moved in front of it.
    #[inline(always)]
    pub fn project_each<S: Simd>(&self, simd: S, p: [S::f32s; 3]) -> ([S::f32s; 2], S::f32s) {
        let place = &self.light.place;
        // No closures: they would be compiled for the oldest processors.
        let mut x = along(simd, p, self.right, place.reference);
        let mut y = along(simd, p, self.up, place.reference);
        let mut away = along(simd, p, -self.light.direction, place.reference);
        if self.is_near() {
            let (one, least) = (simd.splat_f32s(1.0), simd.splat_f32s(LEAST_W));
            let nearness = simd.splat_f32s(place.inverse_distance);
            let w = simd.add_f32s(one, simd.mul_f32s(nearness, away));
            let inverse = simd.div_f32s(one, simd.max_f32s(w, least));
            x = simd.mul_f32s(x, inverse);
            y = simd.mul_f32s(y, inverse);
            away = simd.mul_f32s(away, inverse);
        }
        let scale = simd.splat_f32s(self.scale);
        let texel = [
            simd.mul_f32s(simd.sub_f32s(x, simd.splat_f32s(self.low.x)), scale),
            simd.mul_f32s(simd.sub_f32s(y, simd.splat_f32s(self.low.y)), scale),
        ];
        (texel, away)
    }

    /// Changes of distance per texel on surfaces with normals `n` at points from which `towards`
    /// leads to the light, along both axes of the map.
    #[inline(always)]
    pub fn slopes<S: Simd>(
        &self,
        simd: S,
        n: [S::f32s; 3],
        towards: Option<[S::f32s; 3]>,
    ) -> [S::f32s; 2] {
        let towards = match towards {
            Some(towards) => dot_each(simd, n, towards),
            None => dot(simd, n, self.light.direction),
        };
        let towards = simd.max_f32s(towards, simd.splat_f32s(1e-3));
        [
            self.slope_along(simd, dot(simd, n, self.right), towards),
            self.slope_along(simd, dot(simd, n, self.up), towards),
        ]
    }

    #[inline(always)]
    fn slope_along<S: Simd>(&self, simd: S, along: S::f32s, towards: S::f32s) -> S::f32s {
        let across = simd.div_f32s(along, towards);
        let across = simd.max_f32s(across, simd.splat_f32s(-4.0));
        let across = simd.min_f32s(across, simd.splat_f32s(4.0));
        simd.mul_f32s(across, simd.splat_f32s(self.texel()))
    }

    /// Range of texel coordinates and of distances of a box.
    #[inline(always)]
    pub fn project_bounds(&self, b: &Bounds) -> (Vec2, Vec2, f32, f32) {
        if self.is_near() {
            return self.project_bounds_near(b);
        }
        let centre = 0.5 * (b.low + b.high);
        let half = 0.5 * (b.high - b.low);
        let (at, away) = self.project(centre);
        let reach = Vec2::new(half.dot(self.right.abs()), half.dot(self.up.abs())) * self.scale;
        let deep = half.dot(self.light.direction.abs());
        (at - reach, at + reach, away - deep, away + deep)
    }

    /// The same for a near light: a projective map keeps the hull of the corners. A box that
    /// reaches behind the light may lie anywhere.
    fn project_bounds_near(&self, b: &Bounds) -> (Vec2, Vec2, f32, f32) {
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        let (mut nearest, mut farthest) = (f32::INFINITY, f32::NEG_INFINITY);
        for corner in b.corners() {
            let (at, away) = self.project(corner);
            if at.is_nan() {
                return (Vec2::splat(-1e6), Vec2::splat(1e6), -1e6, 1e6);
            }
            (low, high) = (low.min(at), high.max(at));
            (nearest, farthest) = (nearest.min(away), farthest.max(away));
        }
        (low, high, nearest, farthest)
    }
}

/// Distances of the first surfaces from a light.
#[derive(Debug)]
pub struct DepthMap {
    size: usize,
    texels: Vec<f32>,
    ranges: Ranges,
}

impl DepthMap {
    /// A map of `size` texels a side, a power of two of at least 8.
    pub fn new(size: usize) -> Self {
        Self {
            size,
            texels: vec![FAR; size * size],
            ranges: Ranges::new(size),
        }
    }

    /// Texels along a side.
    pub const fn size(&self) -> usize {
        self.size
    }

    /// Empties the map.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.texels.fill(FAR);
    }

    /// Draws triangles given by their corners' texel coordinates and distances; of those of a
    /// `closed` surface only the ones that face the light, which hide the others.
    #[inline(always)]
    pub fn draw(&mut self, corners: &[(Vec2, f32)], indices: &[u32], closed: bool) {
        for t in indices.chunks_exact(3) {
            let corners = [
                corners[t[0] as usize],
                corners[t[1] as usize],
                corners[t[2] as usize],
            ];
            self.triangle(corners, closed);
        }
    }

    #[inline(always)]
    fn triangle(&mut self, [(a, za), (b, zb), (c, zc)]: [(Vec2, f32); 3], closed: bool) {
        let area = (b - a).perp_dot(c - a);
        if area.is_nan() {
            // It reaches behind the light.
            return;
        }
        if closed && area <= 0.0 {
            return;
        }
        let last = (self.size - 1) as f32;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let first_row = ceil(low.y - 0.5).max(0);
        let last_row = floor(high.y.min(last + 0.5) - 0.5);
        let holds_no_column = floor(high.x - 0.5) < ceil(low.x - 0.5);
        if area == 0.0 || last_row < first_row || holds_no_column {
            return;
        }
        // The distance is linear over the map; edges are intersected row by row.
        let inverse = 1.0 / area;
        let (ab, ac) = (b - a, c - a);
        let dx = ((zb - za) * ac.y - (zc - za) * ab.y) * inverse;
        let dy = ((zc - za) * ab.x - (zb - za) * ac.x) * inverse;
        let edges = [(a, b), (b, c), (c, a)].map(|(u, v)| (u, v.y, (v.x - u.x) / (v.y - u.y)));
        for y in first_row as usize..=last_row as usize {
            let py = y as f32 + 0.5;
            let (mut from, mut to) = (f32::INFINITY, f32::NEG_INFINITY);
            for (u, end, slope) in edges {
                if (u.y <= py) != (end <= py) {
                    let x = u.x + slope * (py - u.y);
                    from = if x < from { x } else { from };
                    to = if x > to { x } else { to };
                }
            }
            if from > to {
                continue;
            }
            // Texels whose centres lie between both edges.
            let from = ceil(from.max(0.0) - 0.5);
            let to = floor(to.min(last + 0.5) - 0.5);
            if from > to {
                continue;
            }
            let (from, to) = (from as usize, to as usize);
            let z = za + (py - a.y) * dy + (from as f32 + 0.5 - a.x) * dx;
            let row = &mut self.texels[y * self.size + from..=y * self.size + to];
            for (k, texel) in row.iter_mut().enumerate() {
                let z = k as f32 * dx + z;
                if z < *texel {
                    *texel = z;
                }
            }
        }
    }

    /// Finds the ranges after everything was drawn.
    #[inline(always)]
    pub fn finish(&mut self) {
        self.ranges.find(&self.texels);
    }

    /// Ranges of depth in squares of the map.
    #[inline(always)]
    pub const fn ranges(&self) -> &Ranges {
        &self.ranges
    }

    /// Distances in the texels that contain points.
    #[inline(always)]
    pub fn nearest<S: Simd>(&self, simd: S, [x, y]: [S::f32s; 2]) -> S::f32s {
        // The outermost texels are empty, as is what lies beyond.
        let last = (self.size as i32 - 1) as f32;
        let x = whole(simd, within(simd, x, last));
        let y = whole(simd, within(simd, y, last));
        gather(simd, &self.texels, self.index(simd, x, y))
    }

    #[inline(always)]
    fn index<S: Simd>(&self, simd: S, x: S::f32s, y: S::f32s) -> S::f32s {
        let rows = simd.splat_f32s(self.size as i32 as f32);
        simd.add_f32s(simd.mul_f32s(y, rows), x)
    }

    /// Shares of the four texels about points, bilinearly weighted, that are not nearer to the
    /// light than `depth`.
    #[inline(always)]
    pub fn seen<S: Simd>(&self, simd: S, [x, y]: [S::f32s; 2], depth: S::f32s) -> S::f32s {
        let last = (self.size as i32 - 2) as f32;
        let half = simd.splat_f32s(0.5);
        let x = within(simd, simd.sub_f32s(x, half), last);
        let y = within(simd, simd.sub_f32s(y, half), last);
        let (x0, y0) = (below(simd, x), below(simd, y));
        let (fx, fy) = (simd.sub_f32s(x, x0), simd.sub_f32s(y, y0));
        let index = self.index(simd, x0, y0);
        let top = self.seen_in_row(simd, index, fx, depth);
        let rows = simd.splat_f32s(self.size as i32 as f32);
        let bottom = self.seen_in_row(simd, simd.add_f32s(index, rows), fx, depth);
        between(simd, top, bottom, fy)
    }

    /// The same of two texels each.
    #[inline(always)]
    fn seen_in_row<S: Simd>(&self, simd: S, index: S::f32s, f: S::f32s, depth: S::f32s) -> S::f32s {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let left = gather(simd, &self.texels, index);
        let right = gather(simd, &self.texels, simd.add_f32s(index, one));
        let left = simd.greater_than_or_equal_f32s(left, depth);
        let right = simd.greater_than_or_equal_f32s(right, depth);
        let left = simd.select_f32s(left, one, zero);
        between(simd, left, simd.select_f32s(right, one, zero), f)
    }
}

/// Coordinates of points along an axis, from those of `origin` on.
#[inline(always)]
fn along<S: Simd>(simd: S, p: [S::f32s; 3], axis: Vec3, origin: Vec3) -> S::f32s {
    simd.sub_f32s(dot(simd, p, axis), simd.splat_f32s(axis.dot(origin)))
}

/// Numbers limited to 0 to `last`.
#[inline(always)]
fn within<S: Simd>(simd: S, x: S::f32s, last: f32) -> S::f32s {
    let x = simd.max_f32s(x, simd.splat_f32s(0.0));
    simd.min_f32s(x, simd.splat_f32s(last))
}

/// The whole numbers below positive ones.
#[inline(always)]
fn below<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    simd.max_f32s(whole(simd, x), simd.splat_f32s(0.0))
}

/// Linear interpolation.
#[inline(always)]
fn between<S: Simd>(simd: S, a: S::f32s, b: S::f32s, f: S::f32s) -> S::f32s {
    let a = simd.mul_f32s(a, simd.sub_f32s(simd.splat_f32s(1.0), f));
    simd.add_f32s(a, simd.mul_f32s(b, f))
}

/// The next integer below; the library's function is slow without SSE 4.1.
#[inline(always)]
pub fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole.saturating_sub(i32::from(x < whole as f32))
}

/// The next integer above.
#[inline(always)]
fn ceil(x: f32) -> i32 {
    let whole = x as i32;
    whole.saturating_add(i32::from(x > whole as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_lighting::{LightKind, LightPlace};

    #[test]
    fn a_rectangle_covers_the_texels_whose_centres_it_holds() {
        let mut map = DepthMap::new(16);
        let p = |x, y, z| (Vec2::new(x, y), z);
        let corners = [
            p(2.2, 3.2, 1.0),
            p(9.8, 3.2, 1.0),
            p(9.8, 8.6, 2.0),
            p(2.2, 8.6, 2.0),
        ];
        map.draw(&corners, &[0, 1, 2, 0, 2, 3], false);
        map.finish();
        for y in 0..16 {
            for x in 0..16 {
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let z = map.nearest(pulp::Scalar::new(), centre.to_array());
                let inside = centre.cmpgt(Vec2::new(2.2, 3.2)).all()
                    && centre.cmplt(Vec2::new(9.8, 8.6)).all();
                if inside {
                    let expected = 1.0 + (centre.y - 3.2) / 5.4;
                    assert!((z - expected).abs() < 1e-5, "{x} {y}: {z} {expected}");
                } else {
                    assert_eq!(z, FAR, "{x} {y}");
                }
            }
        }
        let all = map.ranges().of(Vec2::splat(0.0), Vec2::splat(15.9));
        assert!((all.nearest - 1.0).abs() < 0.1 && all.farthest == FAR);
        let inner = map.ranges().of(Vec2::splat(-4.0), Vec2::splat(-1.0));
        assert_eq!((inner.nearest, inner.farthest), (FAR, FAR));
    }

    fn light_at(inverse_distance: f32) -> DomeLight {
        DomeLight {
            direction: Vec3::new(0.3, -0.5, 0.8).normalize(),
            irradiance: Vec3::ONE,
            angular_radius: 0.1,
            kind: LightKind::Cell,
            place: LightPlace {
                reference: Vec3::new(0.1, 0.2, -0.1),
                inverse_distance,
            },
        }
    }

    #[test]
    fn views_hold_all_points_and_slopes_follow_planes() {
        let points: Vec<Vec3> = (0..50)
            .map(|i| {
                Vec3::new(
                    (i as f32).sin(),
                    (i as f32 * 1.7).cos(),
                    (i as f32 * 0.3).sin(),
                )
            })
            .collect();
        for inverse_distance in [0.0, 0.3] {
            let light = light_at(inverse_distance);
            let view = View::fitted(points.iter().copied(), &light, 128).expect("points");
            for p in &points {
                let (at, _) = view.project(*p);
                assert!(at.cmpgt(Vec2::ONE).all() && at.cmplt(Vec2::splat(127.0)).all());
            }
            let n = Vec3::new(0.2, 0.1, 0.9).normalize();
            let along = n.any_orthonormal_vector();
            let (from, to) = (
                view.project(points[0]),
                view.project(points[0] + along * 0.1),
            );
            let towards = view.towards_each(pulp::Scalar::new(), points[0].to_array());
            let slope = view.slopes(pulp::Scalar::new(), n.to_array(), Some(towards));
            let change = Vec2::from_array(slope).dot(to.0 - from.0);
            assert!((change - (to.1 - from.1)).abs() < 1e-4);
        }
    }

    #[test]
    fn all_points_in_line_with_a_near_light_are_in_one_texel() {
        let light = light_at(1.5);
        let lamp = light.position().expect("near");
        let points = [Vec3::ZERO, Vec3::new(0.2, 0.1, 0.0)];
        let view = View::fitted(points.into_iter(), &light, 128).expect("points");
        for p in points {
            let (here, away) = view.project(p);
            let (there, nearer) = view.project(p.lerp(lamp, 0.6));
            assert!(here.distance(there) < 1e-3 && nearer < away);
            let (each, _) = view.project_each(pulp::Scalar::new(), p.to_array());
            assert!(here.distance(Vec2::from_array(each)) < 1e-3);
        }
        let behind = lamp + (lamp - points[0]);
        assert!(view.project(behind).0.is_nan());
    }
}
