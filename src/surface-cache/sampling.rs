//! Percentage-closer soft shadows (Fernando 2005) on several texels at a time, in the lanes of the
//! processor's registers.

use crate::lanes::any;
use crate::ranges::Squares;
use crate::visibility::{How, LitMap};
use glam::Vec2;
use pulp::Simd;

/// Width of the penumbra where no blocker was found, metres: larger than any.
pub const FREE: f32 = 1e9;
/// Width of a penumbra, in texels of the map, below which samples are interpolated: between more
/// widely spread ones, that makes no difference.
const NARROW: f32 = 2.0;

/// Least radius of what is averaged, in texels of the map.
const NARROWEST: f32 = 0.7;

impl LitMap<'_> {
    /// The visible shares, and the widths of the penumbrae, metres.
    #[inline(always)]
    pub fn share<S: Simd>(
        &self,
        simd: S,
        p: &Receiving<S>,
        how: &How,
        turn: Option<[S::f32s; 2]>,
    ) -> (S::f32s, S::f32s) {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let infinite = simd.splat_f32s(f32::INFINITY);
        let around = simd.splat_f32s(how.reach / self.view.texel());
        // Casters at a height h above the point block it if they lie within h times the spread.
        let per_metre = simd.splat_f32s(self.spread / self.view.texel());
        let first = simd.sub_f32s(p.depth, simd.splat_f32s(how.nearest));
        let least = simd.splat_f32s((how.least / self.view.texel()).max(NARROWEST));
        let widest = simd.max_f32s(least, one);
        let first = simd.max_f32s(simd.mul_f32s(per_metre, first), widest);
        let wide = simd.add_f32s(first, around);
        let squares = self.squares(simd, p, wide);
        let nearest = self.map.ranges().nearest(simd, &squares);
        let rise = simd.mul_f32s(steepness(simd, p.slope), wide);
        let is_open = simd.greater_than_or_equal_f32s(nearest, simd.add_f32s(p.depth, rise));
        let mut is_certain = is_open;
        if how.many {
            let farthest = self.map.ranges().farthest(simd, &squares);
            let is_shut = simd.less_than_f32s(farthest, simd.sub_f32s(p.depth, rise));
            is_certain = simd.or_m32s(is_open, is_shut);
        }
        let certain = simd.select_f32s(is_open, one, zero);
        if !any(simd, simd.not_m32s(is_certain)) {
            return (certain, infinite);
        }
        let disc: &[_] = if how.many {
            &self.disc.many
        } else {
            &self.disc.few
        };
        let disc = Turned { simd, disc, turn };
        let above = simd.mul_f32s(per_metre, simd.sub_f32s(p.depth, nearest));
        let radius = simd.min_f32s(simd.max_f32s(above, widest), first);
        let (blockers, sum) = self.blockers(p, radius, &disc);
        let is_blocked = simd.greater_than_f32s(blockers, zero);
        let mean = simd.div_f32s(sum, simd.max_f32s(blockers, one));
        let texels = simd.max_f32s(simd.mul_f32s(per_metre, mean), least);
        let (mut share, mut width) = (one, zero);
        if any(simd, is_blocked) {
            let narrow = simd.less_than_f32s(texels, simd.splat_f32s(NARROW));
            let narrow =
                simd.and_m32s(simd.and_m32s(narrow, is_blocked), simd.not_m32s(is_certain));
            share = self.filtered(p, texels, narrow, &disc);
            width = simd.mul_f32s(texels, simd.splat_f32s(self.view.texel()));
        }
        let is_free = simd.and_m32s(simd.not_m32s(is_blocked), simd.not_m32s(is_certain));
        if any(simd, is_free) {
            let alone = self.map.seen(simd, p.at, p.depth);
            let free = simd.select_f32s(simd.equal_f32s(alone, one), simd.splat_f32s(FREE), zero);
            share = simd.select_f32s(is_blocked, share, alone);
            width = simd.select_f32s(is_blocked, width, free);
        }
        (
            simd.select_f32s(is_certain, certain, share),
            simd.select_f32s(is_certain, infinite, width),
        )
    }

    /// The squares that cover the map within `wide` texels.
    #[inline(always)]
    fn squares<S: Simd>(&self, simd: S, p: &Receiving<S>, wide: S::f32s) -> Squares<S> {
        let wide = simd.add_f32s(wide, simd.splat_f32s(0.5));
        let [x, y] = p.at;
        let low = [simd.sub_f32s(x, wide), simd.sub_f32s(y, wide)];
        let high = [simd.add_f32s(x, wide), simd.add_f32s(y, wide)];
        self.map.ranges().squares(simd, low, high)
    }

    /// Numbers of blockers on discs of `radius` texels, and the sums of their heights above the
    /// surface, metres.
    #[inline(always)]
    fn blockers<S: Simd>(
        &self,
        p: &Receiving<S>,
        radius: S::f32s,
        disc: &Turned<'_, S>,
    ) -> (S::f32s, S::f32s) {
        let simd = disc.simd;
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let (mut count, mut sum) = (zero, zero);
        for k in 0..disc.disc.len() {
            let (at, depth) = p.beside(simd, disc.point(k, radius));
            let height = simd.sub_f32s(depth, self.map.nearest(simd, at));
            let is_blocked = simd.greater_than_f32s(height, zero);
            count = simd.add_f32s(count, simd.select_f32s(is_blocked, one, zero));
            sum = simd.add_f32s(sum, simd.max_f32s(height, zero));
        }
        (count, sum)
    }

    /// The means over discs of `width` texels, interpolated where they are `narrow`.
    #[inline(always)]
    fn filtered<S: Simd>(
        &self,
        p: &Receiving<S>,
        width: S::f32s,
        narrow: S::m32s,
        disc: &Turned<'_, S>,
    ) -> S::f32s {
        let simd = disc.simd;
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let any_narrow = any(simd, narrow);
        let mut seen = zero;
        for k in 0..disc.disc.len() {
            let (at, depth) = p.beside(simd, disc.point(k, width));
            let nearest = self.map.nearest(simd, at);
            let is_open = simd.greater_than_or_equal_f32s(nearest, depth);
            let mut share = simd.select_f32s(is_open, one, zero);
            if any_narrow {
                share = simd.select_f32s(narrow, self.map.seen(simd, at, depth), share);
            }
            seen = simd.add_f32s(seen, share);
        }
        simd.mul_f32s(seen, simd.splat_f32s(1.0 / disc.disc.len() as f32))
    }
}

/// The largest change of distance per texel in any direction along the axes.
#[inline(always)]
pub fn steepness<S: Simd>(simd: S, [x, y]: [S::f32s; 2]) -> S::f32s {
    simd.add_f32s(simd.abs_f32s(x), simd.abs_f32s(y))
}

/// A disc, turned in each lane.
struct Turned<'a, S: Simd> {
    simd: S,
    disc: &'a [Vec2],
    /// Cosines and sines.
    turn: Option<[S::f32s; 2]>,
}

impl<S: Simd> Turned<'_, S> {
    /// Point `k`, `radius` times as far from the centre.
    #[inline(always)]
    fn point(&self, k: usize, radius: S::f32s) -> [S::f32s; 2] {
        let simd = self.simd;
        let (x, y) = (
            simd.splat_f32s(self.disc[k].x),
            simd.splat_f32s(self.disc[k].y),
        );
        let [x, y] = if let Some([cos, sin]) = self.turn {
            [
                simd.sub_f32s(simd.mul_f32s(cos, x), simd.mul_f32s(sin, y)),
                simd.add_f32s(simd.mul_f32s(sin, x), simd.mul_f32s(cos, y)),
            ]
        } else {
            [x, y]
        };
        [simd.mul_f32s(x, radius), simd.mul_f32s(y, radius)]
    }
}

/// Points of a surface on a map.
pub struct Receiving<S: Simd> {
    /// Texel coordinates.
    pub at: [S::f32s; 2],
    /// Distance from the light, offset, metres.
    pub depth: S::f32s,
    /// Change of distance per texel on its surface.
    pub slope: [S::f32s; 2],
}

impl<S: Simd> Receiving<S> {
    /// The points beside these on the surface, by offsets in texels, and their distances.
    #[inline(always)]
    fn beside(&self, simd: S, [x, y]: [S::f32s; 2]) -> ([S::f32s; 2], S::f32s) {
        let rise = simd.add_f32s(
            simd.mul_f32s(self.slope[0], x),
            simd.mul_f32s(self.slope[1], y),
        );
        let at = [simd.add_f32s(self.at[0], x), simd.add_f32s(self.at[1], y)];
        (at, simd.add_f32s(self.depth, rise))
    }
}
