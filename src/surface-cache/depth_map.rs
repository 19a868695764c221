//! Orthographic depth maps of casters as a distant light sees them, rasterised on the processor.

use crate::layout::Bounds;
use glam::{Vec2, Vec3};

/// Texels along a side of a block, for which the nearest and the farthest depth are kept.
const BLOCK: usize = 8;
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
    #[inline]
    pub fn project(&self, p: Vec3) -> (Vec2, f32) {
        let flat = Vec2::new(p.dot(self.right), p.dot(self.up)) - self.low;
        (flat * self.scale, -p.dot(self.to_light))
    }

    /// Length of a texel, metres.
    pub fn texel(&self) -> f32 {
        1.0 / self.scale
    }

    /// Change of distance per texel on a surface with normal `n`, along both axes of the map.
    pub fn slope(&self, n: Vec3) -> Vec2 {
        let towards = n.dot(self.to_light).max(1e-3);
        let across = Vec2::new(n.dot(self.right), n.dot(self.up)) / towards;
        across.clamp(Vec2::splat(-4.0), Vec2::splat(4.0)) / self.scale
    }

    /// Range of texel coordinates and of distances of a box.
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
    /// Nearest and farthest distance in each block, then in blocks twice as long, and so on.
    levels: Vec<Vec<[f32; 2]>>,
    nearest_of_all: f32,
}

/// The range of no texels.
const EMPTY: [f32; 2] = [FAR, f32::NEG_INFINITY];

/// Joins 2×2 blocks each; the coarser level has `across` blocks a side.
fn join(finer: &[[f32; 2]], coarser: &mut [[f32; 2]], across: usize) {
    for (i, block) in coarser.iter_mut().enumerate() {
        let (x, y) = (2 * (i % across), 2 * (i / across));
        let first = y * 2 * across + x;
        let four = [first, first + 1, first + 2 * across, first + 2 * across + 1];
        *block = four.iter().fold(EMPTY, |[lo, hi], k| {
            let [a, b] = finer[*k];
            [lo.min(a), hi.max(b)]
        });
    }
}

/// What is known of a rectangle of a map from its blocks.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    /// Distance of the nearest caster, metres.
    pub nearest: f32,
    /// Distance of the farthest texel, metres.
    pub farthest: f32,
}

impl DepthMap {
    /// A map of `size` texels a side, a power of two of at least 8.
    pub fn new(size: usize) -> Self {
        let across = size / BLOCK;
        let levels = (0..=across.ilog2()).map(|l| vec![EMPTY; (across >> l) * (across >> l)]);
        Self {
            size,
            texels: vec![FAR; size * size],
            levels: levels.collect(),
            nearest_of_all: FAR,
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

    /// Finds the ranges of the blocks after everything was drawn.
    pub fn finish(&mut self) {
        let across = self.size / BLOCK;
        let finest = &mut self.levels[0];
        for by in 0..across {
            let row = &mut finest[by * across..(by + 1) * across];
            row.fill(EMPTY);
            for y in by * BLOCK..(by + 1) * BLOCK {
                let texels = &self.texels[y * self.size..(y + 1) * self.size];
                for (block, texels) in row.iter_mut().zip(texels.chunks_exact(BLOCK)) {
                    let depths = |(lo, hi): (f32, f32), z: &f32| (lo.min(*z), hi.max(*z));
                    let (lo, hi) = texels.iter().fold((block[0], block[1]), depths);
                    *block = [lo, hi];
                }
            }
        }
        for level in 1..self.levels.len() {
            let (finer, coarser) = self.levels.split_at_mut(level);
            join(&finer[level - 1], &mut coarser[0], across >> level);
        }
        let top = self.levels.last().map_or(EMPTY, |level| level[0]);
        self.nearest_of_all = top[0];
    }

    /// Distance of the nearest caster in the map; [`FAR`] without casters.
    pub const fn nearest_of_all(&self) -> f32 {
        self.nearest_of_all
    }

    /// The range of distances in a rectangle or a little more; beyond the map there is no caster.
    #[inline]
    pub fn range(&self, low: Vec2, high: Vec2) -> Range {
        // The finest level of which the rectangle touches at most 3×3 blocks.
        let widest = (high - low).max_element() * (0.5 / BLOCK as f32);
        let level = (widest as u32 + 1).next_power_of_two().trailing_zeros() as usize;
        let level = level.min(self.levels.len() - 1);
        let blocks = &self.levels[level];
        let across = ((self.size / BLOCK) >> level) as i32;
        let scale = 1.0 / (BLOCK << level) as f32;
        let block = |x: f32| floor(x * scale);
        let (x0, x1) = (block(low.x), block(high.x));
        let (y0, y1) = (block(low.y), block(high.y));
        let is_inside = x0 >= 0 && y0 >= 0 && x1 < across && y1 < across;
        let mut range = Range {
            nearest: FAR,
            farthest: if is_inside { f32::NEG_INFINITY } else { FAR },
        };
        for y in y0.max(0)..=y1.min(across - 1) {
            for x in x0.max(0)..=x1.min(across - 1) {
                let [nearest, farthest] = blocks[(y * across + x) as usize];
                range.nearest = range.nearest.min(nearest);
                range.farthest = range.farthest.max(farthest);
            }
        }
        range
    }

    /// Distance in the texel that contains `at`.
    #[inline]
    pub fn nearest(&self, at: Vec2) -> f32 {
        // The outermost texels are empty, so rounding towards zero is as good as down.
        let (x, y) = (at.x as i32 as usize, at.y as i32 as usize);
        if x >= self.size || y >= self.size {
            return FAR;
        }
        self.texels[y * self.size + x]
    }

    /// Share of the four texels about `at`, bilinearly weighted, that are not nearer to the light
    /// than `depth`.
    #[inline]
    pub fn seen(&self, at: Vec2, depth: f32) -> f32 {
        let corner = at - 0.5;
        let (x, y) = (floor(corner.x), floor(corner.y));
        let f = corner - Vec2::new(x as f32, y as f32);
        let size = self.size as i32;
        let open = |x: i32, y: i32| {
            let inside = x >= 0 && y >= 0 && x < size && y < size;
            let z = if inside {
                self.texels[(y * size + x) as usize]
            } else {
                FAR
            };
            if z >= depth { 1.0 } else { 0.0 }
        };
        let top = open(x, y) * (1.0 - f.x) + open(x + 1, y) * f.x;
        let bottom = open(x, y + 1) * (1.0 - f.x) + open(x + 1, y + 1) * f.x;
        top * (1.0 - f.y) + bottom * f.y
    }
}

/// The next integer below; the library's function is slow without SSE 4.1.
#[inline]
fn floor(x: f32) -> i32 {
    let whole = x as i32;
    whole.saturating_sub(i32::from(x < whole as f32))
}

/// The next integer above.
#[inline]
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
        let all = map.range(Vec2::splat(0.0), Vec2::splat(15.9));
        assert!((all.nearest - 1.0).abs() < 0.1 && all.farthest == FAR);
        let inner = map.range(Vec2::splat(-4.0), Vec2::splat(-1.0));
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
