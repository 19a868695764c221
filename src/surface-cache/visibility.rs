//! How much of a distant light each texel of a page sees past a set of casters: percentage-closer
//! soft shadows (Fernando 2005) over a depth map.

use crate::depth_map::{DepthMap, View};
use crate::layout::{BORDERED, Bounds};
use crate::texels::PageTexels;
use glam::{Vec2, Vec3};

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

/// Evenly distributed points of the unit disc (Vogel 1979).
pub struct Disc {
    /// For texels, in several rotations.
    points: [Vec<Vec2>; ROTATIONS],
    /// For texels between which visibility is interpolated: an error there would be seen on a
    /// whole patch.
    many: Vec<Vec2>,
}

/// Rotations of the disc; texels use them in turn.
const ROTATIONS: usize = 16;

impl Disc {
    /// Computes discs of `few` and of `many` points.
    pub fn new([few, many]: [usize; 2]) -> Self {
        let points = |count: usize, turn: f32| {
            let point = move |k: usize| {
                let radius = ((k as f32 + 0.5) / count as f32).sqrt();
                Vec2::from_angle(2.399_963_2 * k as f32 + turn) * radius
            };
            (0..count).map(point).collect()
        };
        let turn = |r: usize| std::f32::consts::TAU * r as f32 / ROTATIONS as f32;
        Self {
            points: std::array::from_fn(|r| points(few, turn(r))),
            many: points(many, 0.0),
        }
    }

    /// The points for texel `index`; neighbouring texels get different rotations.
    fn rotated(&self, index: usize) -> &[Vec2] {
        // A permutation that spreads the rotations over any 4×4 texels.
        let (x, y) = (index % BORDERED, index / BORDERED);
        &self.points[((x & 3) * 5 + (y & 3) * 7 + ((x ^ y) & 1) * 2) % ROTATIONS]
    }
}

/// What a light does on a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reach {
    /// All texels see it entirely.
    Open,
    /// Some texels do not; their visibility is in the result.
    Partial,
}

/// Texels of a page, along each axis, between which visibility may be interpolated: the corners of
/// 4×4 small patches, of which every other one is a corner of 2×2 large ones.
const LATTICE: [usize; 5] = [0, 4, 8, 12, BORDERED - 1];
/// Width of a penumbra, in texels of the page, from which on visibility is interpolated over a
/// small patch, and over a large one.
const SMOOTH: [f32; 2] = [8.0, 60.0];
/// Radius in texels, about each corner, for which certainty is wanted: the circles about its four
/// corners cover a small patch, or a large one.
const AROUND: [f32; 2] = [4.0, 6.5];

/// Width of the penumbra where no blocker was found, metres: larger than any.
const FREE: f32 = 1e9;

/// How a texel is looked at.
struct How<'a> {
    /// Distance of the nearest caster that matters anywhere on the page, metres.
    nearest: f32,
    /// Distance about the texel for which certainty is wanted, metres.
    reach: f32,
    disc: &'a [Vec2],
}

/// The visibility at a texel.
#[derive(Clone, Copy, Debug)]
struct Look {
    share: f32,
    /// Width of the penumbra, metres; 0 where nothing is known, infinite where the share is certain
    /// to hold for the texels around, too.
    width: f32,
}

impl LitMap<'_> {
    /// Writes the visible share of the light, as a number from 0 to 255, for each texel of a page
    /// that faces it; others count as open. `length`: that of a texel, metres.
    pub fn look(
        &self,
        page: &PageTexels,
        (bounds, length): (&Bounds, f32),
        offset: Offset,
        seen: &mut [u8],
    ) -> Reach {
        let is_behind = page.plane.is_some_and(|n| n.dot(self.to_light) <= 0.0);
        let nearest = self.nearest_blocker(bounds, offset);
        let Some(nearest) = nearest.filter(|_| !is_behind) else {
            return Reach::Open;
        };
        let mut lattice = Lattice {
            lit: self,
            page,
            nearest,
            length,
            offset,
            looks: [[None; 5]; 5],
        };
        for (y, x) in [(0, 0), (0, 2), (2, 0), (2, 2)] {
            let large = lattice.patch([x, y], 1);
            if large.width() >= SMOOTH[1] * length && !large.is_free() {
                large.fill(seen, |_, share| share);
                continue;
            }
            for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let small = lattice.patch([x + dx, y + dy], 0);
                lattice.fill(&small, seen);
            }
        }
        if seen.iter().all(|seen| *seen == 255) {
            Reach::Open
        } else {
            Reach::Partial
        }
    }

    /// Whether the light's centre is hidden from a texel.
    #[inline]
    fn is_blocked(&self, page: &PageTexels, k: usize, offset: Offset) -> bool {
        let n = page.normals[k];
        let cosine = n.dot(self.to_light);
        if !page.is_used[k] || cosine <= 0.0 {
            return false;
        }
        let point = self.receiver(page.positions[k], n, cosine, offset);
        self.map.nearest(point.at) < point.depth
    }

    #[inline]
    fn at(&self, page: &PageTexels, k: usize, how: &How<'_>, offset: Offset) -> Look {
        let n = page.normals[k];
        let cosine = n.dot(self.to_light);
        if !page.is_used[k] || cosine <= 0.0 {
            return Look {
                share: 1.0,
                width: 0.0,
            };
        }
        let point = self.receiver(page.positions[k], n, cosine, offset);
        self.share(&point, how)
    }

    /// Distance of the nearest caster that may stand between the light and a box, metres.
    fn nearest_blocker(&self, bounds: &Bounds, offset: Offset) -> Option<f32> {
        let (low, high, _, farthest) = self.view.project_bounds(bounds);
        let lift = if offset == Offset::Lift { 2.0 } else { 0.0 };
        let high_in_map = farthest - self.map.nearest_of_all();
        if high_in_map <= 0.0 {
            return None;
        }
        let wide = self.spread * high_in_map / self.view.texel() + 1.5 + lift;
        let nearest = self.map.range(low - wide, high + wide).nearest;
        (nearest < farthest).then_some(nearest)
    }

    #[inline]
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

    #[inline]
    fn share(&self, p: &Receiving, how: &How<'_>) -> Look {
        let (nearest, disc) = (how.nearest, how.disc);
        let around = how.reach / self.view.texel();
        // Casters at a height h above the point block it if they lie within h times the spread.
        let per_metre = self.spread / self.view.texel();
        let first = (per_metre * (p.depth - nearest)).max(1.0);
        let wide = first + around;
        let range = self.map.range(p.at - wide - 0.5, p.at + wide + 0.5);
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
        let (mut blockers, mut sum) = (0.0, 0.0);
        for o in disc {
            let o = *o * radius;
            let surface = p.depth + p.slope.dot(o);
            let z = self.map.nearest(p.at + o);
            if z < surface {
                blockers += 1.0;
                sum += surface - z;
            }
        }
        if blockers == 0.0 {
            let share = self.map.seen(p.at, p.depth);
            return Look {
                share,
                width: if share == 1.0 { FREE } else { 0.0 },
            };
        }
        let width = (per_metre * (sum / blockers)).max(0.7);
        Look {
            share: self.filtered(p, width, disc),
            width: width * self.view.texel(),
        }
    }

    /// The mean over a disc of `width` texels.
    #[inline]
    fn filtered(&self, p: &Receiving, width: f32, disc: &[Vec2]) -> f32 {
        let mut seen = 0.0;
        for o in disc {
            let o = *o * width;
            let depth = p.depth + p.slope.dot(o);
            seen += if width < 2.0 {
                self.map.seen(p.at + o, depth)
            } else if self.map.nearest(p.at + o) >= depth {
                // Between so widely spread samples, interpolation makes no difference.
                1.0
            } else {
                0.0
            };
        }
        seen / disc.len() as f32
    }
}

/// Visibility at some texels of a page.
struct Lattice<'a> {
    lit: &'a LitMap<'a>,
    page: &'a PageTexels,
    /// Distance of the nearest caster that matters on the page, metres.
    nearest: f32,
    /// Length of a texel, metres.
    length: f32,
    offset: Offset,
    looks: [[Option<Look>; 5]; 5],
}

impl Lattice<'_> {
    /// The patch from corner `[x, y]` on: a small one at scale 0, a large one at scale 1.
    fn patch(&mut self, [x, y]: [usize; 2], scale: usize) -> Patch {
        let step = 1 << scale;
        let mut corner = |x: usize, y: usize| {
            *self.looks[y][x].get_or_insert_with(|| {
                let how = How {
                    nearest: self.nearest,
                    reach: AROUND[scale] * self.length,
                    disc: &self.lit.disc.many,
                };
                let k = LATTICE[y] * BORDERED + LATTICE[x];
                self.lit.at(self.page, k, &how, self.offset)
            })
        };
        let corners = [
            [corner(x, y), corner(x + step, y)],
            [corner(x, y + step), corner(x + step, y + step)],
        ];
        Patch {
            low: [LATTICE[x], LATTICE[y]],
            high: [LATTICE[x + step], LATTICE[y + step]],
            corners,
        }
    }

    /// Fills a small patch, texel by texel where that makes a difference.
    fn fill(&self, patch: &Patch, seen: &mut [u8]) {
        let width = patch.width();
        let at = |k: usize| {
            let how = How {
                nearest: self.nearest,
                reach: self.length,
                disc: self.lit.disc.rotated(k),
            };
            self.lit.at(self.page, k, &how, self.offset).share
        };
        let is_interpolated = if patch.is_free() && width == FREE {
            // Something slender may stand between the samples.
            !patch
                .texels()
                .any(|k| self.lit.is_blocked(self.page, k, self.offset))
        } else {
            width >= SMOOTH[0] * self.length
        };
        if is_interpolated {
            patch.fill(seen, |_, share| share);
        } else {
            patch.fill(seen, |k, _| at(k));
        }
    }
}

/// The texels between four of the lattice, corners included.
struct Patch {
    low: [usize; 2],
    high: [usize; 2],
    corners: [[Look; 2]; 2],
}

impl Patch {
    /// The smallest width of the penumbra at its corners, metres.
    fn width(&self) -> f32 {
        let all = self.corners.iter().flatten();
        all.fold(f32::INFINITY, |w, c| w.min(c.width))
    }

    /// Whether no blocker was found at its corners, though there may be one between them.
    fn is_free(&self) -> bool {
        let mut all = self.corners.iter().flatten();
        self.width() < f32::INFINITY && all.all(|c| c.width >= FREE && c.share == 1.0)
    }

    /// Indices of its texels.
    fn texels(&self) -> impl Iterator<Item = usize> {
        let ([x0, y0], [x1, y1]) = (self.low, self.high);
        (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| y * BORDERED + x))
    }

    /// Fills the patch; `share` gets each texel's index and the share interpolated from the
    /// corners.
    #[inline]
    fn fill(&self, seen: &mut [u8], share: impl Fn(usize, f32) -> f32) {
        let [x0, y0] = self.low;
        let [x1, y1] = self.high;
        let [top, bottom] = self.corners.map(|row| row.map(|look| look.share));
        for y in y0..=y1 {
            let fy = (y - y0) as f32 / (y1 - y0) as f32;
            let left = top[0] + (bottom[0] - top[0]) * fy;
            let right = top[1] + (bottom[1] - top[1]) * fy;
            for x in x0..=x1 {
                let fx = (x - x0) as f32 / (x1 - x0) as f32;
                let k = y * BORDERED + x;
                seen[k] = (share(k, left + (right - left) * fx) * 255.0 + 0.5) as u8;
            }
        }
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
    fn rise(&self, radius: f32) -> f32 {
        (self.slope.x.abs() + self.slope.y.abs()) * radius
    }
}
