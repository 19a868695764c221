//! How much a picture moved since the one before, without knowing what it shows.

use crate::intrinsics::Grey;
use glam::{DMat2, DVec2};
use penumbra_numerics::median;

/// Patches across and down.
const PATCHES: (usize, usize) = (6, 4);
/// All of them.
pub const MOST_PATCHES: usize = PATCHES.0 * PATCHES.1;
/// Pictures are halved until they are no longer than this, pixels.
const LONGEST: usize = 160;
/// Further halvings at which a motion is looked for first.
const LEVELS: usize = 3;
/// Refinements at each size.
const ITERATIONS: usize = 8;
/// Least mean square of the weaker gradient, codes per pixel: flat patches tell nothing.
const TEXTURE: f64 = 0.3;
/// Patches that must have been followed: of fewer the median is one of them.
const LEAST_PATCHES: usize = 5;

/// Rounds of weighing patches by how well they follow the whole.
const ROUNDS: usize = 6;

/// How a picture moved as a whole since the one before: shift, turn and growth about its middle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flow {
    /// Median length of the patches' shifts, pixels of the full picture.
    pub length: f64,
    /// Shift of the middle, in the same pixels.
    pub shift: DVec2,
    /// Growth, as a share.
    pub growth: f64,
    /// Turn, radians.
    pub turn: f64,
    /// The patches that could be followed.
    pub patches: [Option<Patch>; MOST_PATCHES],
}

/// A patch of the picture in both pictures: its middle, as a share of width and height from the
/// picture's upper left corner, so that a smaller copy says the same.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patch {
    /// In the picture before.
    pub from: DVec2,
    /// In this one.
    pub to: DVec2,
}

/// Follows a stream of pictures by the shift of patches (Lucas & Kanade 1981, from coarse to
/// fine).
#[derive(Clone, Debug, Default)]
pub struct ImageMotion {
    before: Vec<Grey>,
}

impl ImageMotion {
    /// What moved since the picture before; `None` of the first one, of another size, and where
    /// too few patches have texture or can be followed.
    pub fn next(&mut self, picture: &Grey) -> Option<Flow> {
        let mut level = picture.clone();
        let mut scale = 1.0;
        while level.width.max(level.height) > LONGEST {
            level = level.halved();
            scale *= 2.0;
        }
        let mut levels = vec![level.blurred(0.8)];
        for _ in 1..LEVELS {
            let half = levels[levels.len() - 1].halved();
            levels.push(half);
        }
        let before = std::mem::replace(&mut self.before, levels);
        let same = |a: &Grey, b: &Grey| (a.width, a.height) == (b.width, b.height);
        if !before.first().is_some_and(|b| same(b, &self.before[0])) {
            return None;
        }
        let finest = &self.before[0];
        let size = DVec2::new(finest.width as f64, finest.height as f64);
        let cell = size / DVec2::new(PATCHES.0 as f64, PATCHES.1 as f64);
        let followed: [Option<(DVec2, DVec2)>; MOST_PATCHES] = std::array::from_fn(|i| {
            let at = DVec2::new((i % PATCHES.0) as f64, (i / PATCHES.0) as f64);
            let middle = (at + 0.5) * cell;
            Some((middle, self.shift(&before, middle, cell.min_element())?))
        });
        let each = followed.iter().flatten();
        let shifts: Vec<_> = each.map(|(at, by)| (*at - 0.5 * size, *by)).collect();
        if shifts.len() < LEAST_PATCHES {
            return None;
        }
        let length = median(shifts.iter().map(|s| s.1.length()))?;
        let (shift, growth, turn) = whole(&shifts)?;
        Some(Flow {
            length: length * scale,
            shift: shift * scale,
            growth,
            turn,
            patches: followed.map(|patch| {
                let (at, by) = patch?;
                Some(Patch {
                    from: (at + 0.5) / size,
                    to: (at + by + 0.5) / size,
                })
            }),
        })
    }

    /// How the patch about a place moved, in pixels of the finest level, if it could be followed.
    fn shift(&self, before: &[Grey], middle: DVec2, cell: f64) -> Option<DVec2> {
        let mut shift = DVec2::ZERO;
        for level in (0..LEVELS).rev() {
            let size = 0.5_f64.powi(level as i32);
            // Coarse levels see more of the surroundings.
            let half = (0.6 * cell).max(5.0) * if level == 0 { 1.0 } else { 0.8 };
            let followed = follow(
                &before[level],
                &self.before[level],
                middle * size,
                half.min(12.0),
                shift * size,
            );
            match followed {
                Some(found) => shift = found / size,
                None if level == 0 => return None,
                None => {}
            }
        }
        Some(shift)
    }
}

// ┌ A patch at p shifts by t + g p + a p⊥: least squares for t, g, a, with weights 1 / (1 + r²/m²) ┐
// └ (Cauchy's), m = the median of |r|: patches on what stands nearer must not turn the whole.      ┘
fn whole(shifts: &[(DVec2, DVec2)]) -> Option<(DVec2, f64, f64)> {
    let mut weights = vec![1.0; shifts.len()];
    let mut found = (DVec2::ZERO, 0.0, 0.0);
    for _ in 0..ROUNDS {
        let sum: f64 = weights.iter().sum();
        let each = || shifts.iter().zip(&weights);
        let middle = each().map(|((p, _), w)| *p * *w).sum::<DVec2>() / sum;
        let mean = each().map(|((_, s), w)| *s * *w).sum::<DVec2>() / sum;
        let (mut along, mut across, mut spread) = (0.0, 0.0, 0.0);
        for ((p, s), w) in each() {
            let (p, s) = (*p - middle, *s - mean);
            along += w * p.dot(s);
            across += w * p.perp_dot(s);
            spread += w * p.length_squared();
        }
        if spread <= 0.0 {
            return None;
        }
        let (growth, turn) = (along / spread, across / spread);
        found = (mean - growth * middle - turn * middle.perp(), growth, turn);
        let off = |(p, s): &(DVec2, DVec2)| (*s - found.0 - growth * *p - turn * p.perp()).length();
        let usual = median(shifts.iter().map(off))?.max(1e-3);
        for (weight, patch) in weights.iter_mut().zip(shifts) {
            *weight = 1.0 / (1.0 + (off(patch) / usual).powi(2));
        }
    }
    Some(found)
}

/// The shift of a patch of `half` pixels to each side, from a guess.
fn follow(a: &Grey, b: &Grey, middle: DVec2, half: f64, guess: DVec2) -> Option<DVec2> {
    let reach = half as i32;
    let points = || {
        (-reach..=reach).flat_map(move |y| {
            (-reach..=reach).map(move |x| middle + DVec2::new(f64::from(x), f64::from(y)))
        })
    };
    let samples: Vec<(DVec2, f64, DVec2)> = points()
        .filter(|p| a.contains(*p, 1.0))
        .map(|p| (p, a.sample(p), gradient(a, p)))
        .collect();
    let mut normal = DMat2::ZERO;
    for (_, _, g) in &samples {
        normal += DMat2::from_cols(*g * g.x, *g * g.y);
    }
    // The smaller eigenvalue of the mean.
    let n = samples.len().max(1) as f64;
    let (trace, det) = (normal.x_axis.x + normal.y_axis.y, normal.determinant());
    let weaker = 0.5 * trace - (0.25 * trace * trace - det).max(0.0).sqrt();
    if weaker / n < TEXTURE {
        return None;
    }
    let inverse = normal.inverse();
    let mut shift = guess;
    for _ in 0..ITERATIONS {
        let mut right = DVec2::ZERO;
        for (p, value, g) in &samples {
            right += *g * (value - b.sample(*p + shift));
        }
        let step = inverse * right;
        shift += step;
        if step.length() < 0.005 {
            break;
        }
    }
    let lost = (shift - guess).length() > half || !b.contains(middle + shift, 0.0);
    (!lost).then_some(shift)
}

fn gradient(g: &Grey, p: DVec2) -> DVec2 {
    0.5 * DVec2::new(
        g.sample(p + DVec2::X) - g.sample(p - DVec2::X),
        g.sample(p + DVec2::Y) - g.sample(p - DVec2::Y),
    )
}
