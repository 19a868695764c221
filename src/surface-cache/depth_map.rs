//! Orthographic depth maps of casters as a distant light sees them, rasterised on the processor.

use crate::disc::{Eight, LANES};
use crate::layout::Bounds;
use crate::ranges::Ranges;
use glam::{Vec2, Vec3};
use pulp::Simd;

/// Depth where there is no caster, metres.
pub const FAR: f32 = f32::INFINITY;

/// A view along a direction, fitted to casters.
#[derive(Clone, Copy, Debug)]
pub struct View {
    right: Vec3,
    up: Vec3,
    /// Unit vector to the light.
    to_light: Vec3,
    /// Coordinates of the first texel's corner along right and up, metres.
    low: Vec2,
    /// Texels per metre.
    scale: f32,
}

impl View {
    /// Fits a view of `size` texels a side to all `points` (world); `None` without points.
    pub fn fitted(
        mut points: impl Iterator<Item = Vec3>,
        to_light: Vec3,
        size: usize,
    ) -> Option<Self> {
        let (right, up) = to_light.any_orthonormal_pair();
        let flat = |p: Vec3| Vec2::new(p.dot(right), p.dot(up));
        let first = flat(points.next()?);
        let (low, high) = points.fold((first, first), |(lo, hi), p| {
            (lo.min(flat(p)), hi.max(flat(p)))
        });
        // A border of two texels keeps filtering at the edge free of casters.
        let side = (high - low).max_element().max(1e-4) * (1.0 + 6.0 / size as f32);
        let centre = 0.5 * (low + high);
        Some(Self {
            right,
            up,
            to_light,
            low: centre - 0.5 * side,
            scale: size as f32 / side,
        })
    }

    /// Texel coordinates of a point, and its distance away from the light, metres.
    #[inline(always)]
    pub fn project(&self, p: Vec3) -> (Vec2, f32) {
        let flat = Vec2::new(p.dot(self.right), p.dot(self.up)) - self.low;
        (flat * self.scale, -p.dot(self.to_light))
    }

    /// Length of a texel, metres.
    #[inline(always)]
    pub fn texel(&self) -> f32 {
        1.0 / self.scale
    }

    /// Change of distance per texel on a surface with normal `n`, along both axes of the map.
    #[inline(always)]
    pub fn slope(&self, n: Vec3) -> Vec2 {
        let towards = n.dot(self.to_light).max(1e-3);
        let across = Vec2::new(n.dot(self.right), n.dot(self.up)) / towards;
        across.clamp(Vec2::splat(-4.0), Vec2::splat(4.0)) / self.scale
    }

    /// Range of texel coordinates and of distances of a box.
    #[inline(always)]
    pub fn project_bounds(&self, b: &Bounds) -> (Vec2, Vec2, f32, f32) {
        let centre = 0.5 * (b.low + b.high);
        let half = 0.5 * (b.high - b.low);
        let (at, away) = self.project(centre);
        let reach = Vec2::new(half.dot(self.right.abs()), half.dot(self.up.abs())) * self.scale;
        let deep = half.dot(self.to_light.abs());
        (at - reach, at + reach, away - deep, away + deep)
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
    pub fn clear(&mut self) {
        self.texels.fill(FAR);
    }

    /// Draws triangles given by their corners' texel coordinates and distances.
    pub fn draw(&mut self, corners: &[(Vec2, f32)], indices: &[u32]) {
        for t in indices.chunks_exact(3) {
            self.triangle([t[0], t[1], t[2]].map(|i| corners[i as usize]));
        }
    }

    fn triangle(&mut self, [(a, za), (b, zb), (c, zc)]: [(Vec2, f32); 3]) {
        let area = (b - a).perp_dot(c - a);
        let last = (self.size - 1) as f32;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let first_row = ceil(low.y - 0.5).max(0);
        let last_row = floor(high.y.min(last + 0.5) - 0.5);
        if area == 0.0 || last_row < first_row || high.x < 0.5 || low.x > last + 0.5 {
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
                    from = from.min(x);
                    to = to.max(x);
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
                *texel = texel.min(k as f32 * dx + z);
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

    /// Distance in the texel that contains `at`.
    #[inline(always)]
    pub fn nearest(&self, at: Vec2) -> f32 {
        // The outermost texels are empty, as is what lies beyond.
        let last = (self.size as i32 - 1) as f32;
        let whole = |x: f32| x.max(0.0).min(last) as i32;
        self.texels[(whole(at.y) * self.size as i32 + whole(at.x)) as usize]
    }

    /// Distances at eight points, `scale` times as far about `at`.
    #[inline(always)]
    pub fn nearest_of_eight<S: Simd>(
        &self,
        simd: S,
        at: Vec2,
        points: &Eight,
        scale: f32,
    ) -> [f32; LANES] {
        // Adding these rounds to whole numbers, and leaves a whole number in the lowest bits.
        const ROUND: f32 = 12_582_912.0;
        const BITS: f32 = 8_388_608.0;
        let (half, last) = (simd.splat_f32s(0.5), simd.splat_f32s((self.size as i32 - 1) as f32));
        let (zero, scale) = (simd.splat_f32s(0.0), simd.splat_f32s(scale));
        let (round, bits) = (simd.splat_f32s(ROUND), simd.splat_f32s(BITS));
        let whole = |point: S::f32s, at: f32| {
            let x = simd.add_f32s(simd.mul_f32s(point, scale), simd.splat_f32s(at));
            let x = simd.sub_f32s(simd.min_f32s(simd.max_f32s(x, zero), last), half);
            simd.sub_f32s(simd.add_f32s(x, round), round)
        };
        let size = simd.splat_f32s(self.size as i32 as f32);
        let mut index = [0.0; LANES];
        let (x, y) = (S::as_simd_f32s(&points.x).0, S::as_simd_f32s(&points.y).0);
        for ((x, y), index) in x.iter().zip(y).zip(S::as_mut_simd_f32s(&mut index).0) {
            let first = simd.mul_f32s(whole(*y, at.y), size);
            *index = simd.add_f32s(simd.add_f32s(first, whole(*x, at.x)), bits);
        }
        let mut depths = [0.0; LANES];
        for (depth, index) in depths.iter_mut().zip(index) {
            *depth = self.texels[(index.to_bits() & 0x7f_ffff) as usize];
        }
        depths
    }

    /// Share of the four texels about `at`, bilinearly weighted, that are not nearer to the light
    /// than `depth`.
    #[inline(always)]
    pub fn seen(&self, at: Vec2, depth: f32) -> f32 {
        let last = (self.size as i32 - 2) as f32;
        let corner = (at - 0.5).max(Vec2::ZERO).min(Vec2::splat(last));
        let (x, y) = (corner.x as i32, corner.y as i32);
        let f = corner - Vec2::new(x as f32, y as f32);
        let first = (y * self.size as i32 + x) as usize;
        let open = |k: usize| f32::from(u8::from(self.texels[k] >= depth));
        let top = open(first) * (1.0 - f.x) + open(first + 1) * f.x;
        let first = first + self.size;
        let bottom = open(first) * (1.0 - f.x) + open(first + 1) * f.x;
        top * (1.0 - f.y) + bottom * f.y
    }
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
        map.draw(&corners, &[0, 1, 2, 0, 2, 3]);
        map.finish();
        for y in 0..16 {
            for x in 0..16 {
                let centre = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let z = map.nearest(centre);
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
        let to_light = Vec3::new(0.3, -0.5, 0.8).normalize();
        let view = View::fitted(points.iter().copied(), to_light, 128).expect("points");
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
        let change = view.slope(n).dot(to.0 - from.0);
        assert!((change - (to.1 - from.1)).abs() < 1e-4);
    }
}
