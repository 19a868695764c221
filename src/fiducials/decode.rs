//! Reads the number of a tag in the centres of its modules.

use super::Family;
use super::edge::Grey;
use super::family::Word;
use super::homography::apply;
use glam::{DMat3, DVec2};

/// Minimum difference of white and black, linear light.
const MIN_CONTRAST: f64 = 0.02;
/// Maximum share of the border's modules that look white, e.g. by a reflection or a finger's edge.
const MAX_WHITE_BORDER: f64 = 0.12;

/// Linear light over a tag, affine in the tag's coordinates (−1 to 1 within the border).
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

/// Maximum number of modules along a side, including the white ones around the border.
const MAX_SIDE: usize = 12;
/// Factor of the Laplacian that is added to each module where a tag cannot be read directly:
/// compensates blur of modules of about two pixels. As in the AprilTag library.
const SHARPENING: f64 = 0.25;

/// Reads a tag and its margin: 1 where every module is as black or white as the borders. `map`
/// maps ±1 (within the black border) to pixels.
pub(super) fn read(grey: &Grey, map: &DMat3, family: Family) -> Option<(Word, f32)> {
    let levels = Levels::sample(grey, map, family)?;
    let word = |sharpening: f64| family.look_up(levels.word(family, sharpening));
    Some((
        word(0.0).or_else(|| word(SHARPENING))?,
        levels.margin(family),
    ))
}

/// Returns the raw word and the margin, without looking the word up in the family.
pub(super) fn bits(grey: &Grey, map: &DMat3, family: Family) -> Option<(u64, f32)> {
    let levels = Levels::sample(grey, map, family)?;
    Some((levels.word(family, 0.0), levels.margin(family)))
}

/// Levels in the centres of all modules and of the white ones around the border, row by row: 0 is as
/// black as the border, 1 as white as the margin around it.
struct Levels {
    side: usize,
    each: [f64; MAX_SIDE * MAX_SIDE],
}

impl Levels {
    /// Samples the levels; `None` if there is no black border within a white one.
    fn sample(grey: &Grey, map: &DMat3, family: Family) -> Option<Self> {
        let n = family.modules();
        let module = 2.0 / f64::from(n);
        let white = ring(grey, map, -0.5 * module - 1.0, n)?;
        let black = ring(grey, map, 0.5 * module - 1.0, n)?;
        let contrast = white.middle - black.middle;
        let bordered = || (0..family.border()).all(|r| has_border(grey, map, (n, r), white, black));
        let side = n as usize + 2;
        if contrast < MIN_CONTRAST || side > MAX_SIDE || !bordered() {
            return None;
        }
        let mut each = [1.0; MAX_SIDE * MAX_SIDE];
        for (i, level) in each[..side * side].iter_mut().enumerate() {
            let index = DVec2::new((i % side) as f64, (i / side) as f64);
            let p = module * (index - 0.5) - 1.0;
            let (low, high) = (black.at(p), white.at(p));
            match grey.at(apply(map, p)) {
                Some(value) => *level = (value - low) / (high - low).max(1e-6),
                None if p.abs().max_element() < 1.0 => return None,
                // White modules beyond the picture's edge are assumed to be white.
                None => (),
            }
        }
        Some(Self { side, each })
    }

    /// Index of a bit's module.
    fn index(&self, family: Family, bit: u32) -> usize {
        let (x, y) = family.module(bit);
        (y as usize + 1) * self.side + x as usize + 1
    }

    /// Returns the word: a bit is 1 where its module is lighter than halfway.
    fn word(&self, family: Family, sharpening: f64) -> u64 {
        (0..family.bits()).fold(0, |word, bit| {
            let i = self.index(family, bit);
            let ring_centres = [i - 1, i + 1, i - self.side, i + self.side].map(|k| self.each[k]);
            let above = 4.0 * self.each[i] - ring_centres.iter().sum::<f64>();
            (word << 1) | u64::from(self.each[i] + sharpening * above > 0.5)
        })
    }

    /// Returns how clearly black and white differ: the mean distance of the bits' levels from 0.5.
    fn margin(&self, family: Family) -> f32 {
        let clear = |bit| (2.0 * (self.each[self.index(family, bit)] - 0.5).abs()).min(1.0);
        let sum: f64 = (0..family.bits()).map(clear).sum();
        (sum / f64::from(family.bits())) as f32
    }
}

/// Centres of the modules along a square ring at ±`at`, without its corners.
fn ring_centres(at: f64, n: u32) -> impl Iterator<Item = DVec2> {
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

/// Fits the light over a ring by least squares. The ring is symmetric, so mean and slopes decouple.
fn ring(grey: &Grey, map: &DMat3, at: f64, n: u32) -> Option<Shade> {
    let mut shade = Shade::default();
    let (mut count, mut square) = (0.0, 0.0);
    for p in ring_centres(at, n) {
        // A tag at the picture's edge may lack part of its white margin.
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

/// Returns whether the border's ring `within` modules from its outside is black.
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
    let bad = ring_centres(at, n).filter(is_white).count();
    bad as f64 <= MAX_WHITE_BORDER * f64::from(4 * n)
}
