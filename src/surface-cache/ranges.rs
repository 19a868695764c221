//! Nearest and farthest depth in any square of a map, by four look-ups.

use crate::depth_map::{FAR, floor};
use crate::lanes::{gather, whole};
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
    /// Level after level, row by row.
    nearest: Vec<f32>,
    farthest: Vec<f32>,
}

impl Ranges {
    /// Ranges of a map of `size` texels a side.
    pub fn new(size: usize) -> Self {
        let across = size / BLOCK;
        let levels = across.ilog2() as usize + 1;
        let empty = vec![FAR; levels * across * across];
        Self {
            across,
            nearest: empty.clone(),
            farthest: empty,
        }
    }

    /// Finds all ranges of `texels`.
    #[inline(always)]
    pub fn find(&mut self, texels: &[f32]) {
        let lowest = f32::NEG_INFINITY;
        blocks(texels, self.across, &mut self.nearest, FAR, f32::min);
        blocks(texels, self.across, &mut self.farthest, lowest, f32::max);
        join(&mut self.nearest, self.across, f32::min);
        join(&mut self.farthest, self.across, f32::max);
    }

    /// Distance of the nearest caster in the map; [`FAR`] without casters.
    pub fn nearest_of_all(&self) -> f32 {
        let level = self.across * self.across;
        let top = self.nearest.rchunks_exact(level).next();
        top.map_or(FAR, |level| level[0])
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
        let first = level * self.across * self.across;
        let mut range = Range {
            nearest: FAR,
            farthest: if is_inside { f32::NEG_INFINITY } else { FAR },
        };
        for y in rows {
            for x in columns {
                let at = first + y * self.across + x;
                range.nearest = least(range.nearest, self.nearest[at]);
                range.farthest = -least(-range.farthest, -self.farthest[at]);
            }
        }
        range
    }
}

/// Squares that cover a rectangle in each lane.
pub struct Squares<S: Simd> {
    /// Places of the four in the table.
    at: [S::f32s; 4],
    is_inside: S::m32s,
}

impl Ranges {
    /// The squares that cover rectangles of texel coordinates.
    #[inline(always)]
    pub fn squares<S: Simd>(&self, simd: S, low: [S::f32s; 2], high: [S::f32s; 2]) -> Squares<S> {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let last = simd.splat_f32s(self.across as i32 as f32 - 1.0);
        let (x0, x0_inside) = block(simd, low[0], last);
        let (y0, y0_inside) = block(simd, low[1], last);
        let (x1, x1_inside) = block(simd, high[0], last);
        let (y1, y1_inside) = block(simd, high[1], last);
        let longest = simd.max_f32s(simd.sub_f32s(x1, x0), simd.sub_f32s(y1, y0));
        let longest = simd.transmute_u32s_f32s(simd.add_f32s(longest, one));
        // The largest power of two within has the same exponent.
        let side = simd.and_u32s(longest, simd.splat_u32s(0x7f80_0000));
        let exponent = simd.wrapping_dyn_shr_u32s(side, simd.splat_u32s(23));
        let level = simd.transmute_f32s_u32s(simd.or_u32s(exponent, simd.splat_u32s(0x4b00_0000)));
        let level = simd.sub_f32s(level, simd.splat_f32s(8_388_608.0 + 127.0));
        let back = simd.sub_f32s(simd.transmute_f32s_u32s(side), one);
        let across = simd.splat_f32s(self.across as i32 as f32);
        let first = simd.mul_f32s(simd.mul_f32s(level, across), across);
        let top = simd.add_f32s(first, simd.mul_f32s(y0, across));
        let y1 = simd.max_f32s(simd.sub_f32s(y1, back), zero);
        let bottom = simd.add_f32s(first, simd.mul_f32s(y1, across));
        let x1 = simd.max_f32s(simd.sub_f32s(x1, back), zero);
        let x_inside = simd.and_m32s(x0_inside, x1_inside);
        Squares {
            at: [
                simd.add_f32s(top, x0),
                simd.add_f32s(top, x1),
                simd.add_f32s(bottom, x0),
                simd.add_f32s(bottom, x1),
            ],
            is_inside: simd.and_m32s(x_inside, simd.and_m32s(y0_inside, y1_inside)),
        }
    }

    /// The nearest distances in squares.
    #[inline(always)]
    pub fn nearest<S: Simd>(&self, simd: S, squares: &Squares<S>) -> S::f32s {
        let [a, b, c, d] = squares.at;
        let top = simd.min_f32s(
            gather(simd, &self.nearest, a),
            gather(simd, &self.nearest, b),
        );
        let bottom = simd.min_f32s(
            gather(simd, &self.nearest, c),
            gather(simd, &self.nearest, d),
        );
        simd.min_f32s(top, bottom)
    }

    /// The farthest distances in squares; beyond the map there is no caster.
    #[inline(always)]
    pub fn farthest<S: Simd>(&self, simd: S, squares: &Squares<S>) -> S::f32s {
        let [a, b, c, d] = squares.at;
        let top = simd.max_f32s(
            gather(simd, &self.farthest, a),
            gather(simd, &self.farthest, b),
        );
        let bottom = simd.max_f32s(
            gather(simd, &self.farthest, c),
            gather(simd, &self.farthest, d),
        );
        let farthest = simd.max_f32s(top, bottom);
        simd.select_f32s(squares.is_inside, farthest, simd.splat_f32s(FAR))
    }
}

/// The blocks that hold coordinates, or the nearest ones, and whether they do.
#[inline(always)]
fn block<S: Simd>(simd: S, x: S::f32s, last: S::f32s) -> (S::f32s, S::m32s) {
    let zero = simd.splat_f32s(0.0);
    let x = simd.mul_f32s(x, simd.splat_f32s(1.0 / BLOCK as f32));
    let above = simd.greater_than_or_equal_f32s(x, zero);
    let end = simd.add_f32s(last, simd.splat_f32s(1.0));
    let inside = simd.and_m32s(above, simd.less_than_f32s(x, end));
    let x = simd.min_f32s(
        simd.max_f32s(x, zero),
        simd.add_f32s(last, simd.splat_f32s(0.5)),
    );
    (simd.max_f32s(whole(simd, x), zero), inside)
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
fn join(levels: &mut [f32], across: usize, fold: impl Fn(f32, f32) -> f32 + Copy) {
    let size = across * across;
    for level in 1..levels.len() / size {
        let (finer, coarser) = levels.split_at_mut(level * size);
        let (finer, half) = (&finer[(level - 1) * size..], 1 << (level - 1));
        for (y, to) in coarser[..size].chunks_exact_mut(across).enumerate() {
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
            .map(|k| {
                if k % 7 == 0 {
                    FAR
                } else {
                    (k * 37 % 101) as f32
                }
            })
            .collect();
        let mut ranges = Ranges::new(size);
        ranges.find(&texels);
        let fold = |low: i32, high: i32, (x, y): (i32, i32)| {
            let all = (y + low..=y + high).flat_map(|y| (x + low..=x + high).map(move |x| (x, y)));
            let depth = |(x, y): (i32, i32)| {
                let inside = (0..64).contains(&x) && (0..64).contains(&y);
                if inside {
                    texels[(y * 64 + x) as usize]
                } else {
                    FAR
                }
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
