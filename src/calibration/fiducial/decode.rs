//! The number of a tag, read in the middles of its modules.

use super::Family;
use super::edge::Grey;
use super::family::Word;
use super::homography::apply;
use glam::{DMat3, DVec2};

/// Least difference of white and black, linear light.
const LEAST_CONTRAST: f64 = 0.02;
/// Share of the border's modules that may look white: a reflection, a finger's edge.
const MOST_WHITE_BORDER: f64 = 0.12;

/// Light over a tag, affine in its own coordinates (−1 to 1 within the border).
#[derive(Clone, Copy, Default)]
struct Shade {
    middle: f64,
    slope: DVec2,
}

impl Shade {
    fn at(&self, p: DVec2) -> f64 {
        self.middle + self.slope.dot(p)
    }
}

/// Reads a tag; the map is from ±1 within the black border to pixels. Also how clearly it
/// stood out: 1 where every module is as black or white as the borders.
pub(super) fn read(grey: &Grey, map: &DMat3, family: Family) -> Option<(Word, f32)> {
    let (word, margin) = bits(grey, map, family)?;
    Some((family.look_up(word)?, margin))
}

/// The same before it is known whether the family has such a word.
pub(super) fn bits(grey: &Grey, map: &DMat3, family: Family) -> Option<(u64, f32)> {
    let n = family.modules();
    let module = 2.0 / f64::from(n);
    let white = ring(grey, map, -0.5 * module - 1.0, n)?;
    let black = ring(grey, map, 0.5 * module - 1.0, n)?;
    let contrast = white.middle - black.middle;
    let bordered = || (0..family.border()).all(|r| has_border(grey, map, (n, r), white, black));
    if contrast < LEAST_CONTRAST || !bordered() {
        return None;
    }
    let (mut word, mut clear) = (0, 0.0);
    for bit in 0..family.bits() {
        let (x, y) = family.module(bit);
        let p = module * (DVec2::new(f64::from(x), f64::from(y)) + 0.5) - 1.0;
        let (low, high) = (black.at(p), white.at(p));
        let level = (grey.at(apply(map, p))? - low) / (high - low).max(1e-6);
        word = (word << 1) | u64::from(level > 0.5);
        clear += (2.0 * (level - 0.5).abs()).min(1.0);
    }
    Some((word, (clear / f64::from(family.bits())) as f32))
}

/// Middles of the modules round a square whose middles lie at ±`at`, but for its corners.
fn round(at: f64, n: u32) -> impl Iterator<Item = DVec2> {
    let module = 2.0 / f64::from(n);
    (0..4 * n).map(move |i| {
        let along = module * (f64::from(i % n) + 0.5) - 1.0;
        match i / n {
            0 => DVec2::new(along, at),
            1 => DVec2::new(-at, along),
            2 => DVec2::new(along, -at),
            _ => DVec2::new(at, along),
        }
    })
}

/// Least squares over a ring, which is symmetric: mean and slopes come apart.
fn ring(grey: &Grey, map: &DMat3, at: f64, n: u32) -> Option<Shade> {
    let mut shade = Shade::default();
    let (mut count, mut square) = (0.0, 0.0);
    for p in round(at, n) {
        // A tag at the picture's edge may lack some of its white.
        let Some(value) = grey.at(apply(map, p)) else {
            continue;
        };
        shade.middle += value;
        shade.slope += value * p;
        (count, square) = (count + 1.0, square + p.x * p.x);
    }
    let whole = count == f64::from(4 * n);
    if count < f64::from(2 * n) {
        return None;
    }
    shade.middle /= count;
    shade.slope = if whole {
        shade.slope / square
    } else {
        DVec2::ZERO
    };
    Some(shade)
}

/// The border's ring `within` modules from its outside is black.
fn has_border(
    grey: &Grey,
    map: &DMat3,
    (n, within): (u32, u32),
    white: Shade,
    black: Shade,
) -> bool {
    let module = 2.0 / f64::from(n);
    let at = (f64::from(within) + 0.5) * module - 1.0;
    let is_white = |p: &DVec2| {
        let middle = 0.5 * (white.at(*p) + black.at(*p));
        grey.at(apply(map, *p)).is_none_or(|v| v > middle)
    };
    let bad = round(at, n).filter(is_white).count();
    bad as f64 <= MOST_WHITE_BORDER * f64::from(4 * n)
}
