//! Visibility on the texels of a page, interpolated where that makes no difference.

use crate::lanes::MOST;
use crate::layout::{BORDERED, TEXELS};
use crate::sampling::FREE;
use crate::texels::PageTexels;
use crate::visibility::{How, LitMap, Look, Offset};
use pulp::Simd;

/// Texels of a page, along each axis, between which visibility may be interpolated: the corners of
/// 4×4 small patches, of which every other one is a corner of 2×2 large ones.
const LATTICE: [usize; 5] = [0, 4, 8, 12, BORDERED - 1];
/// Width of a penumbra, in texels of the page, from which on visibility is interpolated over a
/// small patch, and over a large one.
const SMOOTH: [f32; 2] = [8.0, 60.0];
/// Radius in texels, about each corner, for which certainty is wanted: the circles about its four
/// corners cover a small patch, or a large one.
const AROUND: [f32; 2] = [4.0, 6.5];

/// Visibility at some texels of a page.
pub struct Lattice<'a, S> {
    simd: S,
    lit: &'a LitMap<'a>,
    page: &'a PageTexels,
    /// Distance of the nearest caster that matters on the page, metres.
    nearest: f32,
    /// Length of a texel, metres.
    length: f32,
    offset: Offset,
    /// What is known at the corners of the patches.
    looks: [[Look; 5]; 5],
    /// Texels that must be looked at one by one.
    pending: [u16; TEXELS],
    pending_count: usize,
}

/// Radius of the part of a surface whose mean a texel has, in lengths of texels.
const LEAST_WIDTH: f32 = 0.5;

/// Large patches, by their first corner.
const LARGE: [[usize; 2]; 4] = [[0, 0], [2, 0], [0, 2], [2, 2]];

impl<'a, S: Simd> Lattice<'a, S> {
    /// Nothing is known yet. `nearest`: distance of the nearest caster that matters; `length`: that
    /// of a texel, metres.
    #[inline(always)]
    pub const fn new(
        simd: S,
        lit: &'a LitMap<'a>,
        page: &'a PageTexels,
        (nearest, length): (f32, f32),
        offset: Offset,
    ) -> Self {
        Self {
            simd,
            lit,
            page,
            nearest,
            length,
            offset,
            looks: [[Look::UNKNOWN; 5]; 5],
            pending: [0; TEXELS],
            pending_count: 0,
        }
    }

    /// Finds the visible share of the light, as a number from 0 to 255, on all texels of the page.
    #[inline(always)]
    pub fn fill(&mut self, seen: &mut [u8]) {
        self.corners(|x, y| x % 2 == 0 && y % 2 == 0, 1);
        let large = LARGE.map(|first| self.patch(first, 1));
        let smooth = SMOOTH[1] * self.length;
        let is_whole = large
            .each_ref()
            .map(|l| l.width() >= smooth && !l.is_free());
        let is_inside = |x: usize, [x0, y0]: [usize; 2], y: usize| {
            (x0..=x0 + 2).contains(&x) && (y0..=y0 + 2).contains(&y)
        };
        self.corners(
            |x, y| {
                let divided = LARGE.iter().zip(is_whole).filter(|(_, whole)| !whole);
                let mut divided = divided.map(|(first, _)| is_inside(x, *first, y));
                (x % 2 == 1 || y % 2 == 1) && divided.any(|inside| inside)
            },
            0,
        );
        for (([x, y], large), is_whole) in LARGE.iter().zip(&large).zip(is_whole) {
            if is_whole {
                large.interpolate(seen);
                continue;
            }
            for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let small = self.patch([x + dx, y + dy], 0);
                self.fill_small(&small, seen);
            }
        }
        self.look_at_pending(seen);
    }

    /// Looks at the corners that are wanted for patches of a scale.
    #[inline(always)]
    fn corners(&mut self, is_wanted: impl Fn(usize, usize) -> bool, scale: usize) {
        let (mut texels, mut corners, mut count) = ([0; 25], [(0, 0); 25], 0);
        for (x, y) in (0..25).map(|i| (i % 5, i / 5)) {
            let k = LATTICE[y] * BORDERED + LATTICE[x];
            if is_wanted(x, y) && self.lit.is_facing(self.page, k) {
                texels[count] = k as u16;
                corners[count] = (x, y);
                count += 1;
            }
        }
        let how = self.how(AROUND[scale], true);
        let mut looks = [Look::UNKNOWN; MOST];
        let groups = texels[..count].chunks(S::F32_LANES);
        for (group, corners) in groups.zip(corners.chunks(S::F32_LANES)) {
            self.lit.at(self.simd, self.page, group, &how, &mut looks);
            for ((x, y), look) in corners.iter().zip(looks).take(group.len()) {
                self.looks[*y][*x] = look;
            }
        }
    }

    #[inline(always)]
    const fn how(&self, texels: f32, many: bool) -> How {
        How {
            nearest: self.nearest,
            reach: texels * self.length,
            least: LEAST_WIDTH * self.length,
            many,
            offset: self.offset,
        }
    }

    /// The patch from corner `[x, y]` on: a small one at scale 0, a large one at scale 1.
    #[inline(always)]
    const fn patch(&self, [x, y]: [usize; 2], scale: usize) -> Patch {
        let step = 1 << scale;
        Patch {
            low: [LATTICE[x], LATTICE[y]],
            high: [LATTICE[x + step], LATTICE[y + step]],
            corners: [
                [self.looks[y][x], self.looks[y][x + step]],
                [self.looks[y + step][x], self.looks[y + step][x + step]],
            ],
        }
    }

    /// Fills a small patch, or notes its texels where interpolation would make a difference.
    #[inline(always)]
    fn fill_small(&mut self, patch: &Patch, seen: &mut [u8]) {
        let width = patch.width();
        let is_interpolated = if patch.is_free() && width == FREE {
            // Something slender may stand between the samples.
            !self.is_blocked(patch)
        } else {
            width >= SMOOTH[0] * self.length
        };
        if is_interpolated {
            patch.interpolate(seen);
            return;
        }
        let ([x0, y0], [x1, y1]) = (patch.low, patch.end());
        for y in y0..y1 {
            let row = y * BORDERED + x0..y * BORDERED + x1;
            seen[row.clone()].fill(255);
            self.pending_count = self.append(row, self.pending_count);
        }
    }

    /// Appends those of some texels that face the light to the pending ones; returns their number.
    #[inline(always)]
    fn append(&mut self, texels: std::ops::Range<usize>, mut count: usize) -> usize {
        for k in texels {
            if let Some(next) = self.pending.get_mut(count) {
                *next = k as u16;
            }
            count += usize::from(self.lit.is_facing(self.page, k));
        }
        count
    }

    /// Whether the light's centre is hidden from any texel of a patch.
    #[inline(always)]
    fn is_blocked(&mut self, patch: &Patch) -> bool {
        let ([x0, y0], [x1, y1]) = (patch.low, patch.high);
        if self.page.plane.is_some() {
            let corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)];
            let corners = corners.map(|(x, y)| (y * BORDERED + x) as u16);
            let (lit, offset) = (self.lit, self.offset);
            if !lit.may_be_blocked(self.simd, self.page, &corners, offset) {
                return false;
            }
        }
        let mut count = 0;
        let mut texels = [0; 36];
        for y in y0..=y1 {
            for k in y * BORDERED + x0..=y * BORDERED + x1 {
                if let Some(next) = texels.get_mut(count) {
                    *next = k as u16;
                }
                count += usize::from(self.lit.is_facing(self.page, k));
            }
        }
        let texels = &texels[..count];
        self.lit
            .is_blocked(self.simd, self.page, texels, self.offset)
    }

    /// Looks at the texels that were noted.
    #[inline(always)]
    fn look_at_pending(&self, seen: &mut [u8]) {
        let how = self.how(1.0, false);
        let mut looks = [Look::UNKNOWN; MOST];
        for group in self.pending[..self.pending_count].chunks(S::F32_LANES) {
            self.lit.at(self.simd, self.page, group, &how, &mut looks);
            for (k, look) in group.iter().zip(looks) {
                seen[usize::from(*k)] = in_bytes(look.share);
            }
        }
    }
}

#[inline(always)]
fn in_bytes(share: f32) -> u8 {
    (share * 255.0 + 0.5) as u8
}

/// The texels between four of the lattice, corners included.
struct Patch {
    low: [usize; 2],
    high: [usize; 2],
    corners: [[Look; 2]; 2],
}

impl Patch {
    /// The smallest width of the penumbra at its corners, metres.
    #[inline(always)]
    fn width(&self) -> f32 {
        let [[a, b], [c, d]] = self.corners.map(|row| row.map(|look| look.width));
        a.min(b).min(c.min(d))
    }

    /// Whether no blocker was found at its corners, though there may be one between them.
    #[inline(always)]
    fn is_free(&self) -> bool {
        let [[a, b], [c, d]] = self
            .corners
            .map(|row| row.map(|c| c.width >= FREE && c.share == 1.0));
        self.width() < f32::INFINITY && a && b && c && d
    }

    /// Where the next patches begin: of texels that belong to several patches, the last one writes.
    #[inline(always)]
    fn end(&self) -> [usize; 2] {
        self.high
            .map(|last| last + usize::from(last == BORDERED - 1))
    }

    /// Fills the patch between its corners.
    #[inline(always)]
    fn interpolate(&self, seen: &mut [u8]) {
        let ([x0, y0], [x1, y1], end) = (self.low, self.high, self.end());
        let [top, bottom] = self.corners.map(|row| row.map(|look| look.share));
        if top == bottom && top[0] == top[1] {
            let share = in_bytes(top[0]);
            for y in y0..end[1] {
                seen[y * BORDERED + x0..y * BORDERED + end[0]].fill(share);
            }
            return;
        }
        for y in y0..end[1] {
            let fy = (y - y0) as f32 / (y1 - y0) as f32;
            let left = top[0] + (bottom[0] - top[0]) * fy;
            let right = top[1] + (bottom[1] - top[1]) * fy;
            for (x, seen) in (x0..).zip(&mut seen[y * BORDERED + x0..y * BORDERED + end[0]]) {
                let fx = (x - x0) as f32 / (x1 - x0) as f32;
                *seen = in_bytes(left + (right - left) * fx);
            }
        }
    }
}
