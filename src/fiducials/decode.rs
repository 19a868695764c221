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

/// Most modules a side, the white ones round the border among them.
const MOST_SIDE: usize = 12;
/// How much of what a module has above its neighbours is put on top of it where a tag cannot be
/// read as it is: blur took about as much from a module of two pixels. As in the AprilTag library.
const SHARPENING: f64 = 0.25;

/// Reads a tag; the map is from ±1 within the black border to pixels. Also how clearly it
/// stood out: 1 where every module is as black or white as the borders.
pub(super) fn read(grey: &Grey, map: &DMat3, family: Family) -> Option<(Word, f32)> {
    let levels = Levels::of(grey, map, family)?;
    let word = |sharpening: f64| family.look_up(levels.word(family, sharpening));
    Some((
        word(0.0).or_else(|| word(SHARPENING))?,
        levels.margin(family),
    ))
}

/// The same before it is known whether the family has such a word.
pub(super) fn bits(grey: &Grey, map: &DMat3, family: Family) -> Option<(u64, f32)> {
    let levels = Levels::of(grey, map, family)?;
    Some((levels.word(family, 0.0), levels.margin(family)))
}

/// Light in the middles of all modules and of the white ones round them, row after row: 0 as black
/// as the border, 1 as white as what is round it.
struct Levels {
    side: usize,
    each: [f64; MOST_SIDE * MOST_SIDE],
}

impl Levels {
    /// `None` where no such border is.
    fn of(grey: &Grey, map: &DMat3, family: Family) -> Option<Self> {
        let n = family.modules();
        let module = 2.0 / f64::from(n);
        let white = ring(grey, map, -0.5 * module - 1.0, n)?;
        let black = ring(grey, map, 0.5 * module - 1.0, n)?;
        let contrast = white.middle - black.middle;
        let bordered = || (0..family.border()).all(|r| has_border(grey, map, (n, r), white, black));
        let side = n as usize + 2;
        if contrast < LEAST_CONTRAST || side > MOST_SIDE || !bordered() {
            return None;
        }
        let mut each = [1.0; MOST_SIDE * MOST_SIDE];
        for (i, level) in each[..side * side].iter_mut().enumerate() {
            let place = DVec2::new((i % side) as f64, (i / side) as f64);
            let p = module * (place - 0.5) - 1.0;
            let (low, high) = (black.at(p), white.at(p));
            match grey.at(apply(map, p)) {
                Some(value) => *level = (value - low) / (high - low).max(1e-6),
                None if p.abs().max_element() < 1.0 => return None,
                // White beyond the picture's edge is taken for granted.
                None => (),
            }
        }
        Some(Self { side, each })
    }

    /// Where a bit's module stands among all.
    fn place(&self, family: Family, bit: u32) -> usize {
        let (x, y) = family.module(bit);
        (y as usize + 1) * self.side + x as usize + 1
    }

    /// Bits by what is lighter than half.
    fn word(&self, family: Family, sharpening: f64) -> u64 {
        (0..family.bits()).fold(0, |word, bit| {
            let i = self.place(family, bit);
            let round = [i - 1, i + 1, i - self.side, i + self.side].map(|k| self.each[k]);
            let above = 4.0 * self.each[i] - round.iter().sum::<f64>();
            (word << 1) | u64::from(self.each[i] + sharpening * above > 0.5)
        })
    }

    /// How clearly black and white stand apart.
    fn margin(&self, family: Family) -> f32 {
        let clear = |bit| (2.0 * (self.each[self.place(family, bit)] - 0.5).abs()).min(1.0);
        let sum: f64 = (0..family.bits()).map(clear).sum();
        (sum / f64::from(family.bits())) as f32
    }
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
