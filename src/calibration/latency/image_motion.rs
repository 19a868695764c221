//! Image motion between successive pictures, without knowledge of the scene.

use crate::intrinsics::Grey;
use glam::{DMat2, DVec2};
use penumbra_numerics::median;

/// Number of patches across and down.
const PATCHES: (usize, usize) = (6, 4);
/// Maximum number of patches.
pub const MAX_PATCHES: usize = PATCHES.0 * PATCHES.1;
/// Pictures are halved until their longer side is at most this, pixels.
const MAX_SIDE: usize = 160;
/// Levels of the image pyramid.
const LEVELS: usize = 3;
/// Iterations at each level.
const ITERATIONS: usize = 8;
/// Minimum of the smaller eigenvalue of the mean gradient tensor, (codes per pixel)²: patches
/// without texture cannot be tracked.
const MIN_TEXTURE: f64 = 0.3;
/// Minimum number of tracked patches for a median.
const MIN_PATCHES: usize = 5;
/// Iterations of reweighted least squares.
const ROUNDS: usize = 6;

/// Motion of a picture since the one before: a similarity about its centre, and the patches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flow {
    /// Median length of the patches' displacements, pixels of the full picture.
    pub length: f64,
    /// Displacement of the centre, pixels of the full picture.
    pub shift: DVec2,
    /// Relative change of scale.
    pub growth: f64,
    /// Rotation, radians.
    pub rotation: f64,
    /// The patches; `None` where one could not be tracked.
    pub patches: [Option<Patch>; MAX_PATCHES],
}

/// Centre of a patch in both pictures, relative to width and height from the picture's upper left
/// corner, and thus independent of the resolution.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Patch {
    /// In the picture before.
    pub from: DVec2,
    /// In this one.
    pub to: DVec2,
}

/// Tracks patches through a stream of pictures (Lucas & Kanade 1981, from coarse to fine).
#[derive(Clone, Debug, Default)]
pub struct ImageMotion {
    before: Vec<Grey>,
}

impl ImageMotion {
    /// Returns the motion since the previous picture; `None` for the first picture, after a change
    /// of size, and where too few patches have texture or can be tracked.
    pub fn next(&mut self, picture: &Grey) -> Option<Flow> {
        let mut level = picture.clone();
        let mut scale = 1.0;
        while level.width.max(level.height) > MAX_SIDE {
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
        let tracked: [Option<(DVec2, DVec2)>; MAX_PATCHES] = std::array::from_fn(|i| {
            let at = DVec2::new((i % PATCHES.0) as f64, (i / PATCHES.0) as f64);
            let centre = (at + 0.5) * cell;
            Some((centre, self.shift(&before, centre, cell.min_element())?))
        });
        let each = tracked.iter().flatten();
        let shifts: Vec<_> = each.map(|(at, by)| (*at - 0.5 * size, *by)).collect();
        if shifts.len() < MIN_PATCHES {
            return None;
        }
        let length = median(shifts.iter().map(|s| s.1.length()))?;
        let (shift, growth, rotation) = similarity(&shifts)?;
        Some(Flow {
            length: length * scale,
            shift: shift * scale,
            growth,
            rotation,
            patches: tracked.map(|patch| {
                let (at, by) = patch?;
                Some(Patch {
                    from: (at + 0.5) / size,
                    to: (at + by + 0.5) / size,
                })
            }),
        })
    }

    /// Returns the displacement of the patch about a point, pixels of the finest level; `None` if it
    /// could not be tracked.
    fn shift(&self, before: &[Grey], centre: DVec2, cell: f64) -> Option<DVec2> {
        let mut shift = DVec2::ZERO;
        for level in (0..LEVELS).rev() {
            let size = 0.5_f64.powi(level as i32);
            // Coarse levels cover more of the surroundings.
            let half = (0.6 * cell).max(5.0) * if level == 0 { 1.0 } else { 0.8 };
            let tracked = track_patch(
                &before[level],
                &self.before[level],
                centre * size,
                half.min(12.0),
                shift * size,
            );
            match tracked {
                Some(found) => shift = found / size,
                None if level == 0 => return None,
                None => {}
            }
        }
        Some(shift)
    }
}

// ┌ A patch at p moves by t + g p + a p⊥: least squares for t, g, a, with weights 1 / (1 + r²/m²) ┐
// └ (Cauchy's), m = the median of |r|: patches on near objects are downweighted.                  ┘
fn similarity(shifts: &[(DVec2, DVec2)]) -> Option<(DVec2, f64, f64)> {
    let mut weights = vec![1.0; shifts.len()];
    let mut found = (DVec2::ZERO, 0.0, 0.0);
    for _ in 0..ROUNDS {
        let sum: f64 = weights.iter().sum();
        let each = || shifts.iter().zip(&weights);
        let centre = each().map(|((p, _), w)| *p * *w).sum::<DVec2>() / sum;
        let mean = each().map(|((_, s), w)| *s * *w).sum::<DVec2>() / sum;
        let (mut along, mut across, mut spread) = (0.0, 0.0, 0.0);
        for ((p, s), w) in each() {
            let (p, s) = (*p - centre, *s - mean);
            along += w * p.dot(s);
            across += w * p.perp_dot(s);
            spread += w * p.length_squared();
        }
        if spread <= 0.0 {
            return None;
        }
        let (growth, rotation) = (along / spread, across / spread);
        found = (
            mean - growth * centre - rotation * centre.perp(),
            growth,
            rotation,
        );
        let residual =
            |(p, s): &(DVec2, DVec2)| (*s - found.0 - growth * *p - rotation * p.perp()).length();
        let typical = median(shifts.iter().map(residual))?.max(1e-3);
        for (weight, patch) in weights.iter_mut().zip(shifts) {
            *weight = 1.0 / (1.0 + (residual(patch) / typical).powi(2));
        }
    }
    Some(found)
}

/// Returns the displacement of a patch of `half` pixels to each side, from an initial guess.
fn track_patch(a: &Grey, b: &Grey, centre: DVec2, half: f64, guess: DVec2) -> Option<DVec2> {
    let reach = half as i32;
    let points = || {
        (-reach..=reach).flat_map(move |y| {
            (-reach..=reach).map(move |x| centre + DVec2::new(f64::from(x), f64::from(y)))
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
    // The smaller eigenvalue of the gradient tensor.
    let n = samples.len().max(1) as f64;
    let (trace, det) = (normal.x_axis.x + normal.y_axis.y, normal.determinant());
    let weaker = 0.5 * trace - (0.25 * trace * trace - det).max(0.0).sqrt();
    if weaker / n < MIN_TEXTURE {
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
    let lost = (shift - guess).length() > half || !b.contains(centre + shift, 0.0);
    (!lost).then_some(shift)
}

fn gradient(g: &Grey, p: DVec2) -> DVec2 {
    0.5 * DVec2::new(
        g.sample(p + DVec2::X) - g.sample(p - DVec2::X),
        g.sample(p + DVec2::Y) - g.sample(p - DVec2::Y),
    )
}
