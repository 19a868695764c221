//! How much of a light each texel of a page sees past a set of casters.

use crate::depth_map::{DepthMap, View};
use crate::disc::Disc;
use crate::lanes::{MOST, any, dot, dot_each, each, lanes, load};
use crate::lattice::Lattice;
use crate::layout::Bounds;
use crate::receivers::Extent;
use crate::sampling::{Receiving, steepness};
use crate::texels::PageTexels;
use glam::{Vec2, Vec3};
use pulp::Simd;

/// A light with the map of its casters.
pub struct LitMap<'a> {
    /// The map.
    pub map: &'a DepthMap,
    /// Its view.
    pub view: View,
    /// Tangent of the light's angular radius.
    pub spread: f32,
    /// Points of a disc.
    pub disc: &'a Disc,
}

/// How far a surface that is in a map is lifted: texels for curvature, and texels for each unit of the
/// sine between its normal and the light. The middle of a texel lies up to 0.71 texels from the points
/// of a plane in it. More makes narrow shadows, as in a groove, narrower.
const LIFT: (f32, f32) = (0.3, 0.7);

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

/// How texels are looked at.
#[derive(Clone, Copy)]
pub struct How {
    /// Distance of the nearest caster that matters anywhere on the page, metres.
    pub nearest: f32,
    /// Distance about a texel for which certainty is wanted, metres.
    pub reach: f32,
    /// Least radius of what is averaged, metres: a shadow that is narrower than a texel would be seen
    /// by every other texel.
    pub least: f32,
    /// Whether texels use the larger disc, which is not turned.
    pub many: bool,
    pub offset: Offset,
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
    /// Writes the visible share of the light, as a number from 0 to 255, for each texel of a page
    /// that faces it; others count as open. `length`: that of a texel, metres.
    #[inline(always)]
    pub fn look<S: Simd>(
        &self,
        simd: S,
        page: &PageTexels,
        (extent, length): (&Extent, f32),
        offset: Offset,
        seen: &mut [u8],
    ) -> Reach {
        // Most pages end here; their texels need not be fetched.
        if self.is_behind(extent) {
            return Reach::Open;
        }
        let Some(nearest) = self.nearest_blocker(&extent.bounds, offset) else {
            return Reach::Open;
        };
        if page
            .plane
            .is_some_and(|n| !self.is_before(page.positions[0], n))
        {
            return Reach::Open;
        }
        Lattice::new(simd, self, page, (nearest, length), offset).fill(seen);
        if seen.iter().all(|seen| *seen == 255) {
            Reach::Open
        } else {
            Reach::Partial
        }
    }

    /// Whether a texel is used and faces the light, as a page in a plane does.
    #[inline(always)]
    pub fn is_facing(&self, page: &PageTexels, k: usize) -> bool {
        let is_before = || self.is_before(page.positions[k], page.normals[k]);
        page.is_used[k] && (page.plane.is_some() || is_before())
    }

    /// Whether a surface faces the light.
    #[inline(always)]
    fn is_before(&self, point: Vec3, n: Vec3) -> bool {
        n.dot(self.view.light.towards(point)) > 0.0
    }

    /// Whether no texel of a page faces the light.
    #[inline(always)]
    fn is_behind(&self, extent: &Extent) -> bool {
        if !self.view.is_near() {
            return extent.normals.is_behind(self.view.light.direction);
        }
        // A surface that faces a light from somewhere in a box does so from one of its corners.
        let mut corners = extent.bounds.corners();
        corners.all(|p| {
            extent
                .normals
                .is_behind(self.view.light.towards(p).normalize_or_zero())
        })
    }

    /// Distance of the nearest caster that may stand between the light and a box, metres.
    #[inline(always)]
    fn nearest_blocker(&self, bounds: &Bounds, offset: Offset) -> Option<f32> {
        let (low, high, _, farthest) = self.view.project_bounds(bounds);
        let lift = if offset == Offset::Lift {
            LIFT.0 + LIFT.1
        } else {
            0.0
        };
        let high_in_map = farthest - self.map.ranges().nearest_of_all();
        if high_in_map <= 0.0 {
            return None;
        }
        let wide = self.spread * high_in_map / self.view.texel() + 1.5 + lift;
        let nearest = self.map.ranges().of(low - wide, high + wide).nearest;
        (nearest < farthest).then_some(nearest)
    }

    /// Whether a caster may stand anywhere between the light's centre and the part of a plane page
    /// between four texels.
    #[inline(always)]
    pub fn may_be_blocked<S: Simd>(
        &self,
        simd: S,
        page: &PageTexels,
        corners: &[u16; 4],
        offset: Offset,
    ) -> bool {
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        let mut farthest = f32::NEG_INFINITY;
        for group in corners.chunks(S::F32_LANES) {
            let points = self.receive(simd, page, group, offset);
            let [x, y] = &points.at;
            low = low.min(Vec2::new(
                simd.reduce_min_f32s(*x),
                simd.reduce_min_f32s(*y),
            ));
            high = high.max(Vec2::new(
                simd.reduce_max_f32s(*x),
                simd.reduce_max_f32s(*y),
            ));
            farthest = farthest.max(simd.reduce_max_f32s(points.depth));
        }
        self.map.ranges().of(low, high).nearest < farthest
    }

    /// Whether the light's centre is hidden from any of some texels that face it.
    #[inline(always)]
    pub fn is_blocked<S: Simd>(
        &self,
        simd: S,
        page: &PageTexels,
        texels: &[u16],
        offset: Offset,
    ) -> bool {
        for group in texels.chunks(S::F32_LANES) {
            let points = self.receive(simd, page, group, offset);
            let nearest = self.map.nearest(simd, points.at);
            if any(simd, simd.less_than_f32s(nearest, points.depth)) {
                return true;
            }
        }
        false
    }

    /// The visibility at some texels that face the light, one for each lane or fewer.
    #[inline(always)]
    pub fn at<S: Simd>(
        &self,
        simd: S,
        page: &PageTexels,
        group: &[u16],
        how: &How,
        to: &mut [Look],
    ) {
        let points = self.receive(simd, page, group, how.offset);
        let turn = if how.many {
            None
        } else {
            let cos = each(simd, |lane| self.disc.turn(texel(group, lane)).x);
            let sin = each(simd, |lane| self.disc.turn(texel(group, lane)).y);
            Some([cos, sin])
        };
        let (share, width) = self.share(simd, &points, how, turn);
        let (share, width) = (lanes(simd, &share), lanes(simd, &width));
        for (lane, to) in to.iter_mut().take(group.len()).enumerate() {
            *to = Look {
                share: share[lane],
                width: width[lane],
            };
        }
    }

    #[inline(always)]
    fn receive<S: Simd>(
        &self,
        simd: S,
        page: &PageTexels,
        group: &[u16],
        offset: Offset,
    ) -> Receiving<S> {
        let p = vectors(simd, &page.positions, group);
        let n = if let Some(n) = page.plane {
            [
                simd.splat_f32s(n.x),
                simd.splat_f32s(n.y),
                simd.splat_f32s(n.z),
            ]
        } else {
            vectors(simd, &page.normals, group)
        };
        let near = self.view.is_near();
        let towards = near.then(|| self.view.towards_each(simd, p));
        let unit = self.view.texel();
        let slope = self.view.slopes(simd, n, towards);
        let p = if offset == Offset::Lift {
            let cosine = match towards {
                Some(v) => {
                    let length = simd.sqrt_f32s(dot_each(simd, v, v));
                    simd.div_f32s(dot_each(simd, n, v), length)
                }
                None => dot(simd, n, self.view.light.direction),
            };
            let one = simd.splat_f32s(1.0);
            let rest = simd.sub_f32s(one, simd.mul_f32s(cosine, cosine));
            let sine = simd.sqrt_f32s(simd.max_f32s(rest, simd.splat_f32s(0.0)));
            let lift = simd.mul_f32s(sine, simd.splat_f32s(LIFT.1 * unit));
            let lift = simd.add_f32s(lift, simd.splat_f32s(LIFT.0 * unit));
            [
                simd.add_f32s(p[0], simd.mul_f32s(n[0], lift)),
                simd.add_f32s(p[1], simd.mul_f32s(n[1], lift)),
                simd.add_f32s(p[2], simd.mul_f32s(n[2], lift)),
            ]
        } else {
            p
        };
        let (at, depth) = self.view.project_each(simd, p);
        let shift = if offset == Offset::Shift {
            simd.add_f32s(steepness(simd, slope), simd.splat_f32s(0.5 * unit))
        } else {
            simd.splat_f32s(0.05 * unit)
        };
        Receiving {
            at,
            depth: simd.sub_f32s(depth, shift),
            slope,
        }
    }
}

/// The texel of a lane; lanes without one repeat the first.
#[inline(always)]
fn texel(group: &[u16], lane: usize) -> usize {
    usize::from(group[if lane < group.len() { lane } else { 0 }])
}

/// The vectors at some texels.
#[inline(always)]
fn vectors<S: Simd>(simd: S, from: &[Vec3], group: &[u16]) -> [S::f32s; 3] {
    let mut all = [[0.0; MOST]; 3];
    for lane in 0..S::F32_LANES {
        let v = from[texel(group, lane)];
        all[0][lane] = v.x;
        all[1][lane] = v.y;
        all[2][lane] = v.z;
    }
    [
        load(simd, &all[0]),
        load(simd, &all[1]),
        load(simd, &all[2]),
    ]
}
