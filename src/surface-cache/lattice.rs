//! Visibility on the texels of a page, interpolated where that makes no difference.

use crate::layout::BORDERED;
use crate::texels::PageTexels;
use crate::visibility::{FREE, How, LitMap, Look, Offset};
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
    pub simd: S,
    pub lit: &'a LitMap<'a>,
    pub page: &'a PageTexels,
    /// Distance of the nearest caster that matters on the page, metres.
    pub nearest: f32,
    /// Length of a texel, metres.
    pub length: f32,
    pub offset: Offset,
    /// What is known at the corners of the patches.
    pub looks: [[Option<Look>; 5]; 5],
}

impl<S: Simd> Lattice<'_, S> {
    /// Finds the visible share of the light, in 255ths, on all texels of the page.
    #[inline(always)]
    pub fn fill(&mut self, seen: &mut [u8]) {
        for (y, x) in [(0, 0), (0, 2), (2, 0), (2, 2)] {
            let large = self.patch([x, y], 1);
            if large.width() >= SMOOTH[1] * self.length && !large.is_free() {
                large.interpolate(seen);
                continue;
            }
            for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let small = self.patch([x + dx, y + dy], 0);
                self.fill_small(&small, seen);
            }
        }
    }

    /// The patch from corner `[x, y]` on: a small one at scale 0, a large one at scale 1.
    #[inline(always)]
    fn patch(&mut self, [x, y]: [usize; 2], scale: usize) -> Patch {
        let step = 1 << scale;
        let reach = AROUND[scale] * self.length;
        let mut corners = [[Look::UNKNOWN; 2]; 2];
        for (cy, row) in corners.iter_mut().enumerate() {
            for (cx, corner) in row.iter_mut().enumerate() {
                *corner = self.corner(x + step * cx, y + step * cy, reach);
            }
        }
        Patch {
            low: [LATTICE[x], LATTICE[y]],
            high: [LATTICE[x + step], LATTICE[y + step]],
            corners,
        }
    }

    #[inline(always)]
    fn corner(&mut self, x: usize, y: usize, reach: f32) -> Look {
        if let Some(known) = self.looks[y][x] {
            return known;
        }
        let how = How {
            nearest: self.nearest,
            reach,
            disc: &self.lit.disc.many,
        };
        let k = LATTICE[y] * BORDERED + LATTICE[x];
        let look = self.lit.at(self.simd, self.page, k, &how, self.offset);
        self.looks[y][x] = Some(look);
        look
    }

    /// Fills a small patch, texel by texel where that makes a difference.
    #[inline(always)]
    fn fill_small(&self, patch: &Patch, seen: &mut [u8]) {
        let width = patch.width();
        let is_interpolated = if patch.is_free() && width == FREE {
            // Something slender may stand between the samples.
            !self.is_blocked(patch)
        } else {
            width >= SMOOTH[0] * self.length
        };
        if is_interpolated {
            patch.interpolate(seen);
        } else {
            self.look(patch, seen);
        }
    }

    /// Whether the light's centre is hidden from any texel of a patch.
    #[inline(always)]
    fn is_blocked(&self, patch: &Patch) -> bool {
        let ([x0, y0], [x1, y1]) = (patch.low, patch.high);
        for y in y0..=y1 {
            for k in y * BORDERED + x0..=y * BORDERED + x1 {
                if self.lit.is_blocked(self.page, k, self.offset) {
                    return true;
                }
            }
        }
        false
    }

    /// Looks at each texel of a patch.
    #[inline(always)]
    fn look(&self, patch: &Patch, seen: &mut [u8]) {
        let ([x0, y0], [x1, y1]) = (patch.low, patch.end());
        for y in y0..y1 {
            for k in y * BORDERED + x0..y * BORDERED + x1 {
                let how = How {
                    nearest: self.nearest,
                    reach: self.length,
                    disc: self.lit.disc.rotated(k),
                };
                let look = self.lit.at(self.simd, self.page, k, &how, self.offset);
                seen[k] = in_255ths(look.share);
            }
        }
    }
}

#[inline(always)]
fn in_255ths(share: f32) -> u8 {
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
        for y in y0..end[1] {
            let fy = (y - y0) as f32 / (y1 - y0) as f32;
            let left = top[0] + (bottom[0] - top[0]) * fy;
            let right = top[1] + (bottom[1] - top[1]) * fy;
            for (x, seen) in (x0..).zip(&mut seen[y * BORDERED + x0..y * BORDERED + end[0]]) {
                let fx = (x - x0) as f32 / (x1 - x0) as f32;
                *seen = in_255ths(left + (right - left) * fx);
            }
        }
    }
}
