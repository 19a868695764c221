//! Nearest and farthest depth in any square of a map, by four look-ups.

use crate::depth_map::{FAR, floor};
use crate::lanes::{MOST, lanes, load};
use glam::Vec2;
use pulp::Simd;

/// Texels along a side of a block, the finest square for which a range is kept.
const BLOCK: usize = 4;

/// What is known of a rectangle of a map.
#[derive(Clone, Copy, Debug)]
pub struct Range {
    /// Distance of the nearest caster, metres.
    pub nearest: f32,
    /// Distance of the farthest texel, metres.
    pub farthest: f32,
}

/// Ranges of overlapping squares: on level l, of 2^l × 2^l blocks from each block on, as far as the
/// map goes. Four of them cover a square of any size between.
#[derive(Debug)]
pub struct Ranges {
    /// Blocks along a side.
    across: usize,
    nearest: Vec<Vec<f32>>,
    farthest: Vec<Vec<f32>>,
}

impl Ranges {
    /// Ranges of a map of `size` texels a side.
    pub fn new(size: usize) -> Self {
        let across = size / BLOCK;
        let levels = across.ilog2() as usize + 1;
        let empty = |value: f32| vec![vec![value; across * across]; levels];
        Self {
            across,
            nearest: empty(FAR),
            farthest: empty(FAR),
        }
    }

    /// Finds all ranges of `texels`.
    #[inline(always)]
    pub fn find(&mut self, texels: &[f32]) {
        blocks(texels, self.across, &mut self.nearest[0], FAR, f32::min);
        let farthest = &mut self.farthest[0];
        blocks(texels, self.across, farthest, f32::NEG_INFINITY, f32::max);
        join(&mut self.nearest, self.across, f32::min);
        join(&mut self.farthest, self.across, f32::max);
    }

    /// Distance of the nearest caster in the map; [`FAR`] without casters.
    pub fn nearest_of_all(&self) -> f32 {
        self.nearest.last().map_or(FAR, |level| level[0])
    }

    /// The range of distances in a rectangle of texel coordinates or a little more; beyond the map
    /// there is no caster.
    #[inline(always)]
    pub fn of(&self, low: Vec2, high: Vec2) -> Range {
        const SCALE: f32 = 1.0 / BLOCK as f32;
        let last = self.across as i32 - 1;
        let (x0, y0) = (floor(low.x * SCALE), floor(low.y * SCALE));
        let (x1, y1) = (floor(high.x * SCALE), floor(high.y * SCALE));
        let is_outside = x1 < 0 || y1 < 0 || x0 > last || y0 > last;
        if is_outside {
            return Range {
                nearest: FAR,
                farthest: FAR,
            };
        }
        let is_inside = x0 >= 0 && y0 >= 0 && x1 <= last && y1 <= last;
        let blocks = (x1.saturating_sub(x0)).max(y1.saturating_sub(y0)).min(last) + 1;
        let level = blocks.ilog2() as usize;
        let back = (1 << level) - 1;
        let clamp = |x: i32| x.max(0).min(last) as usize;
        let (columns, rows) = ([clamp(x0), clamp(x1 - back)], [clamp(y0), clamp(y1 - back)]);
        let (nearest, farthest) = (&self.nearest[level], &self.farthest[level]);
        let mut range = Range {
            nearest: FAR,
            farthest: if is_inside { f32::NEG_INFINITY } else { FAR },
        };
        for y in rows {
            for x in columns {
                let at = y * self.across + x;
                range.nearest = least(range.nearest, nearest[at]);
                range.farthest = -least(-range.farthest, -farthest[at]);
            }
        }
        range
    }
}

impl Ranges {
    /// The nearest and the farthest distances in rectangles, one a lane.
    #[inline(always)]
    pub fn each<S: Simd>(
        &self,
        simd: S,
        low: [S::f32s; 2],
        high: [S::f32s; 2],
    ) -> (S::f32s, S::f32s) {
        let (mut nearest, mut farthest) = ([0.0; MOST], [0.0; MOST]);
        let (x0, y0) = (lanes(simd, &low[0]), lanes(simd, &low[1]));
        let (x1, y1) = (lanes(simd, &high[0]), lanes(simd, &high[1]));
        for lane in 0..S::F32_LANES {
            let (low, high) = (Vec2::new(x0[lane], y0[lane]), Vec2::new(x1[lane], y1[lane]));
            let range = self.of(low, high);
            nearest[lane] = range.nearest;
            farthest[lane] = range.farthest;
        }
        (load(simd, &nearest), load(simd, &farthest))
    }
}

/// The smaller of two numbers of which neither is NaN: one instruction.
#[inline(always)]
fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Folds each block's texels.
#[inline(always)]
fn blocks(
    texels: &[f32],
    across: usize,
    to: &mut [f32],
    first: f32,
    fold: impl Fn(f32, f32) -> f32 + Copy,
) {
    let rows = texels.chunks_exact(BLOCK * BLOCK * across);
    for (to, rows) in to.chunks_exact_mut(across).zip(rows) {
        to.fill(first);
        for row in rows.chunks_exact(BLOCK * across) {
            for (to, texels) in to.iter_mut().zip(row.chunks_exact(BLOCK)) {
                let pair = [fold(texels[0], texels[1]), fold(texels[2], texels[3])];
                *to = fold(*to, fold(pair[0], pair[1]));
            }
        }
    }
}

/// Finds each level from the one before it.
#[inline(always)]
fn join(levels: &mut [Vec<f32>], across: usize, fold: impl Fn(f32, f32) -> f32 + Copy) {
    for level in 1..levels.len() {
        let (finer, coarser) = levels.split_at_mut(level);
        let (finer, half) = (&finer[level - 1], 1 << (level - 1));
        for (y, to) in coarser[0].chunks_exact_mut(across).enumerate() {
            let row = |y: usize| &finer[y * across..][..across];
            let (top, bottom) = (row(y), row((y + half).min(across - 1)));
            for ((to, a), b) in to.iter_mut().zip(top).zip(bottom) {
                *to = fold(*a, *b);
            }
            for x in 0..across - half {
                to[x] = fold(to[x], fold(top[x + half], bottom[x + half]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_all_texels_and_little_more() {
        let size = 64;
        let texels: Vec<f32> = (0..size * size)
            .map(|k| if k % 7 == 0 { FAR } else { (k * 37 % 101) as f32 })
            .collect();
        let mut ranges = Ranges::new(size);
        ranges.find(&texels);
        let fold = |low: i32, high: i32, (x, y): (i32, i32)| {
            let all = (y + low..=y + high).flat_map(|y| (x + low..=x + high).map(move |x| (x, y)));
            let depth = |(x, y): (i32, i32)| {
                let inside = (0..64).contains(&x) && (0..64).contains(&y);
                if inside { texels[(y * 64 + x) as usize] } else { FAR }
            };
            let all = all.map(depth);
            all.fold((FAR, f32::NEG_INFINITY), |(a, b), z| (a.min(z), b.max(z)))
        };
        for (x, y, side) in (0..900).map(|i| (i * 7 % 90 - 12, i * 11 % 90 - 12, i % 40)) {
            let low = Vec2::new(x as f32, y as f32) + 0.3;
            let found = ranges.of(low, low + side as f32);
            let (nearest, farthest) = fold(0, side, (x, y));
            let (lowest, highest) = fold(-5, side + 5, (x, y));
            assert!(found.nearest <= nearest && found.farthest >= farthest);
            assert!(found.nearest >= lowest && found.farthest <= highest);
        }
        assert_eq!(ranges.nearest_of_all(), 0.0);
    }
}
