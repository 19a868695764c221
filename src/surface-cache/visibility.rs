//! How much of a distant light each texel of a page sees past a set of casters: percentage-closer
//! soft shadows (Fernando 2005) over a depth map.

use crate::depth_map::{DepthMap, View};
use crate::disc::{Disc, Eight, LANES};
use crate::lattice::Lattice;
use crate::layout::Bounds;
use crate::receivers::Extent;
use crate::texels::PageTexels;
use glam::{Vec2, Vec3};
use pulp::Simd;

/// A light with the map of its casters.
pub struct LitMap<'a> {
    /// The map.
    pub map: &'a DepthMap,
    /// Its view.
    pub view: View,
    /// Unit vector to the light.
    pub to_light: Vec3,
    /// Tangent of the light's angular radius.
    pub spread: f32,
    /// Points of a disc.
    pub disc: &'a Disc,
}

/// How a surface is kept from shadowing itself in a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offset {
    /// The surface is not in the map.
    None,
    /// Points are lifted along their normal by about a texel of the map.
    Lift,
    /// Points are moved towards the light by the change of depth of their plane across a texel:
    /// lifting would move the rims of real shadows.
    Shift,
}

/// What a light does on a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// All texels see it entirely.
    Open,
    /// Some texels do not; their visibility is in the result.
    Partial,
}

/// Width of the penumbra where no blocker was found, metres: larger than any.
pub const FREE: f32 = 1e9;

/// How a texel is looked at.
pub struct How<'a> {
    /// Distance of the nearest caster that matters anywhere on the page, metres.
    pub nearest: f32,
    /// Distance about the texel for which certainty is wanted, metres.
    pub reach: f32,
    pub disc: &'a [Eight],
}

/// The visibility at a texel.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    pub share: f32,
    /// Width of the penumbra, metres; 0 where nothing is known, infinite where the share is certain
    /// to hold for the texels around, too.
    pub width: f32,
}

impl Look {
    /// Of a texel that does not matter.
    pub const UNKNOWN: Self = Self {
        share: 1.0,
        width: 0.0,
    };
}

impl LitMap<'_> {
    /// Writes the visible share of the light, in 255ths, for each texel of a page that faces it;
    /// others count as open. `length`: that of a texel, metres.
    #[inline(always)]
    pub fn look<S: Simd>(
        &self,
        simd: S,
        page: &PageTexels,
        (extent, length): (&Extent, f32),
        offset: Offset,
        seen: &mut [u8],
    ) -> Reach {
        let is_behind = page.plane.is_some_and(|n| n.dot(self.to_light) <= 0.0);
        if is_behind || extent.normals.is_behind(self.to_light) {
            return Reach::Open;
        }
        let Some(nearest) = self.nearest_blocker(&extent.bounds, offset) else {
            return Reach::Open;
        };
        let mut lattice = Lattice {
            simd,
            lit: self,
            page,
            nearest,
            length,
            offset,
            looks: [[None; 5]; 5],
        };
        lattice.fill(seen);
        if seen.iter().all(|seen| *seen == 255) {
            Reach::Open
        } else {
            Reach::Partial
        }
    }

    /// Whether the light's centre is hidden from a texel.
    #[inline(always)]
    pub fn is_blocked(&self, page: &PageTexels, k: usize, offset: Offset) -> bool {
        let n = page.normals[k];
        let cosine = n.dot(self.to_light);
        if !page.is_used[k] || cosine <= 0.0 {
            return false;
        }
        let point = self.receiver(page.positions[k], n, cosine, offset);
        self.map.nearest(point.at) < point.depth
    }

    #[inline(always)]
    pub fn at<S: Simd>(&self, simd: S, page: &PageTexels, k: usize, how: &How<'_>, offset: Offset) -> Look {
        let n = page.normals[k];
        let cosine = n.dot(self.to_light);
        if !page.is_used[k] || cosine <= 0.0 {
            return Look::UNKNOWN;
        }
        let point = self.receiver(page.positions[k], n, cosine, offset);
        self.share(simd, &point, how)
    }

    /// Distance of the nearest caster that may stand between the light and a box, metres.
    #[inline(always)]
    fn nearest_blocker(&self, bounds: &Bounds, offset: Offset) -> Option<f32> {
        let (low, high, _, farthest) = self.view.project_bounds(bounds);
        let lift = if offset == Offset::Lift { 2.0 } else { 0.0 };
        let high_in_map = farthest - self.map.ranges().nearest_of_all();
        if high_in_map <= 0.0 {
            return None;
        }
        let wide = self.spread * high_in_map / self.view.texel() + 1.5 + lift;
        let nearest = self.map.ranges().of(low - wide, high + wide).nearest;
        (nearest < farthest).then_some(nearest)
    }

    #[inline(always)]
    fn receiver(&self, p: Vec3, n: Vec3, cosine: f32, offset: Offset) -> Receiving {
        let texel = self.view.texel();
        let slope = self.view.slope(n);
        let lift = match offset {
            Offset::Lift => texel * (0.5 + 1.5 * (1.0 - cosine * cosine).max(0.0).sqrt()),
            Offset::None | Offset::Shift => 0.0,
        };
        let (at, depth) = self.view.project(p + n * lift);
        let shift = match offset {
            Offset::Shift => slope.x.abs() + slope.y.abs() + 0.5 * texel,
            Offset::None | Offset::Lift => 0.05 * texel,
        };
        Receiving {
            at,
            depth: depth - shift,
            slope,
        }
    }

    #[inline(always)]
    fn share<S: Simd>(&self, simd: S, p: &Receiving, how: &How<'_>) -> Look {
        let (nearest, disc) = (how.nearest, how.disc);
        let around = how.reach / self.view.texel();
        // Casters at a height h above the point block it if they lie within h times the spread.
        let per_metre = self.spread / self.view.texel();
        let first = (per_metre * (p.depth - nearest)).max(1.0);
        let wide = first + around;
        let range = self.map.ranges().of(p.at - wide - 0.5, p.at + wide + 0.5);
        let certain = |share| Look {
            share,
            width: f32::INFINITY,
        };
        if range.nearest >= p.depth + p.rise(wide) {
            return certain(1.0);
        }
        if range.farthest < p.depth - p.rise(wide) {
            return certain(0.0);
        }
        let radius = (per_metre * (p.depth - range.nearest)).clamp(1.0, first);
        let (blockers, sum) = self.blockers(simd, p, radius, disc);
        if blockers == 0.0 {
            let share = self.map.seen(p.at, p.depth);
            return Look {
                share,
                width: if share == 1.0 { FREE } else { 0.0 },
            };
        }
        let width = (per_metre * (sum / blockers)).max(0.7);
        Look {
            share: self.filtered(simd, p, width, disc),
            width: width * self.view.texel(),
        }
    }

    /// Number of blockers on a disc of `radius` texels, and the sum of their heights above the
    /// surface, metres.
    #[inline(always)]
    fn blockers<S: Simd>(&self, simd: S, p: &Receiving, radius: f32, disc: &[Eight]) -> (f32, f32) {
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let (mut count, mut sum) = (zero, zero);
        for points in disc {
            let depths = self.map.nearest_of_eight(simd, p.at, points, radius);
            for (i, depth) in S::as_simd_f32s(&depths).0.iter().enumerate() {
                let height = simd.sub_f32s(p.depths(simd, points, i, radius), *depth);
                let is_blocked = simd.greater_than_f32s(height, zero);
                count = simd.add_f32s(count, simd.select_f32s(is_blocked, one, zero));
                sum = simd.add_f32s(sum, simd.max_f32s(height, zero));
            }
        }
        (simd.reduce_sum_f32s(count), simd.reduce_sum_f32s(sum))
    }

    /// The mean over a disc of `width` texels.
    #[inline(always)]
    fn filtered<S: Simd>(&self, simd: S, p: &Receiving, width: f32, disc: &[Eight]) -> f32 {
        let count = (LANES * disc.len()) as f32;
        if width < 2.0 {
            let mut seen = 0.0;
            for points in disc {
                for (x, y) in points.x.iter().zip(&points.y) {
                    let o = Vec2::new(*x, *y) * width;
                    seen += self.map.seen(p.at + o, p.depth + p.slope.dot(o));
                }
            }
            return seen / count;
        }
        // Between so widely spread samples, interpolation makes no difference.
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let mut seen = zero;
        for points in disc {
            let depths = self.map.nearest_of_eight(simd, p.at, points, width);
            for (i, depth) in S::as_simd_f32s(&depths).0.iter().enumerate() {
                let surface = p.depths(simd, points, i, width);
                let is_open = simd.greater_than_or_equal_f32s(*depth, surface);
                seen = simd.add_f32s(seen, simd.select_f32s(is_open, one, zero));
            }
        }
        simd.reduce_sum_f32s(seen) / count
    }
}

/// A point of a surface on a map.
struct Receiving {
    /// Texel coordinates.
    at: Vec2,
    /// Distance from the light, offset, metres.
    depth: f32,
    /// Change of distance per texel on its surface.
    slope: Vec2,
}

impl Receiving {
    /// Change of distance on the surface within `radius` texels.
    #[inline(always)]
    fn rise(&self, radius: f32) -> f32 {
        (self.slope.x.abs() + self.slope.y.abs()) * radius
    }

    /// Distances of the surface at the `i`th register of eight points, `radius` times as far.
    #[inline(always)]
    fn depths<S: Simd>(&self, simd: S, points: &Eight, i: usize, radius: f32) -> S::f32s {
        let (x, y) = (S::as_simd_f32s(&points.x).0[i], S::as_simd_f32s(&points.y).0[i]);
        let slope = self.slope * radius;
        let x = simd.mul_f32s(x, simd.splat_f32s(slope.x));
        let y = simd.mul_f32s(y, simd.splat_f32s(slope.y));
        simd.add_f32s(simd.add_f32s(x, y), simd.splat_f32s(self.depth))
    }
}
