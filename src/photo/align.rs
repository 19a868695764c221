//! The shift between two photographs of the same place that a hand or a touched tripod has caused.
//!
//! Median threshold bitmaps (Ward, Journal of Graphics Tools 8, 2003) do not depend on the exposure:
//! each picture is cut at its own median, pixels near the median are left out, and the shift with the
//! fewest differing pixels is found from coarse to fine.

use glam::IVec2;
use penumbra_picture::Picture;

/// Levels of the pyramid at most; the coarsest has 32 pixels at least along its shorter side.
const LEVELS: u32 = 6;
/// Pixels that are searched to either side at the coarsest level, which shifts of up to
/// 2^(LEVELS - 1) × this can reach, and at the others, whose start is coarse.
const REACH: [i32; 2] = [3, 2];
/// Maximum distance from the median that is noise, codes; an eighth of the range in which half of the
/// pixels are, if that is less.
const MAX_MARGIN: i32 = 4;

/// The shift of one picture to another, and how well they agree there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// The content of the second picture lies this many pixels right of and below that of the first.
    pub pixels: IVec2,
    /// Share of the compared pixels that differ, 0 to 1: half of them differ by chance.
    pub differing: f64,
}

/// Returns the shift between two pictures of the same size. `None` if their sizes differ, or if they
/// are too small or too uniform to compare.
#[must_use]
pub fn shift(first: &Picture, second: &Picture) -> Option<Shift> {
    if (first.width, first.height) != (second.width, second.height) {
        return None;
    }
    let (a, b) = (pyramid(first), pyramid(second));
    let mut best = Shift {
        pixels: IVec2::ZERO,
        differing: 1.0,
    };
    for (k, (a, b)) in a.iter().zip(&b).rev().enumerate() {
        let (a, b) = (a.bits(), b.bits());
        let (centre, reach) = (best.pixels * 2, REACH[k.min(1)]);
        let side = -reach..=reach;
        let near = side
            .clone()
            .flat_map(|y| side.clone().map(move |x| centre + IVec2::new(x, y)));
        let judged = near.filter_map(|pixels| {
            let differing = a.differing(&b, pixels)?;
            Some(Shift { pixels, differing })
        });
        let judged: Vec<Shift> = judged.collect();
        let least = judged.iter().map(|s| s.differing).reduce(f64::min)?;
        // Smooth pictures agree over several shifts: the middle one is the most likely.
        let ties = judged.iter().filter(|s| s.differing <= least);
        let (sum, count) = ties.fold((IVec2::ZERO, 0), |(sum, n), s| (sum + s.pixels, n + 1));
        best = Shift {
            pixels: (sum.as_dvec2() / f64::from(count)).round().as_ivec2(),
            differing: least,
        };
    }
    Some(best)
}

/// A grey picture.
struct Grey {
    width: usize,
    height: usize,
    codes: Vec<u8>,
}

/// One pyramid level, cut at its median: 1 above, −1 below, 0 near it.
struct Bits {
    width: usize,
    height: usize,
    signs: Vec<i8>,
}

fn pyramid(picture: &Picture) -> Vec<Grey> {
    let luma =
        |p: &[u8]| (54 * u32::from(p[0]) + 183 * u32::from(p[1]) + 19 * u32::from(p[2])) / 256;
    let mut levels = vec![Grey {
        width: picture.width as usize,
        height: picture.height as usize,
        codes: picture
            .rgba
            .chunks_exact(4)
            .map(|p| luma(p) as u8)
            .collect(),
    }];
    while let Some(last) = levels.last()
        && levels.len() < LEVELS as usize
        && last.width.min(last.height) >= 32
    {
        let half = last.half();
        levels.push(half);
    }
    levels
}

impl Grey {
    fn half(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let at = |x: usize, y: usize| u32::from(self.codes[y * self.width + x]);
        let codes = (0..width * height).map(|i| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            ((at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4) as u8
        });
        Self {
            width,
            height,
            codes: codes.collect(),
        }
    }

    fn bits(&self) -> Bits {
        let mut counts = [0usize; 256];
        for &code in &self.codes {
            counts[usize::from(code)] += 1;
        }
        let quantile = |share: f64| {
            let mut below = 0;
            let found = counts.iter().position(|n| {
                below += n;
                below as f64 >= share * self.codes.len() as f64
            });
            found.unwrap_or(0) as i32
        };
        let median = quantile(0.5);
        let margin = ((quantile(0.75) - quantile(0.25)) / 8).clamp(1, MAX_MARGIN);
        let sign = |code: &u8| {
            let above = i32::from(*code) - median;
            if above.abs() <= margin {
                0
            } else {
                above.signum() as i8
            }
        };
        Bits {
            width: self.width,
            height: self.height,
            signs: self.codes.iter().map(sign).collect(),
        }
    }
}

impl Bits {
    /// Returns the share of differing pixels if `other` is shifted by `shift`; `None` if fewer than a
    /// tenth of the pixels can be compared.
    fn differing(&self, other: &Self, shift: IVec2) -> Option<f64> {
        let range = |size: usize, shift: i32| {
            let low = (-shift).max(0);
            let high = (size as i32 - shift).min(size as i32);
            (low as usize)..(high.max(low) as usize)
        };
        let (columns, rows) = (range(self.width, shift.x), range(self.height, shift.y));
        let (mut compared, mut differing) = (0usize, 0usize);
        for y in rows {
            let row = y * self.width;
            let moved = (y as i64 + i64::from(shift.y)) as usize * self.width;
            for x in columns.clone() {
                let there = (x as i64 + i64::from(shift.x)) as usize;
                let (a, b) = (self.signs[row + x], other.signs[moved + there]);
                compared += usize::from(a != 0 && b != 0);
                differing += usize::from(a * b < 0);
            }
        }
        (10 * compared > self.signs.len()).then(|| differing as f64 / compared as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A blotchy texture, brighter by `gain`, shifted.
    fn texture(shift: IVec2, gain: f64) -> Picture {
        let (width, height) = (320, 240);
        let shade = |x: f64, y: f64| {
            let waves = (x * 0.05).sin() + (y * 0.07 + x * 0.011).sin() + (0.13 * (x - y)).sin();
            (90.0 + 28.0 * waves) * gain
        };
        let rgba = (0..width * height).flat_map(|i| {
            let (x, y) = (f64::from(i % width), f64::from(i / width));
            let code = shade(x - f64::from(shift.x), y - f64::from(shift.y));
            [code as u8, code as u8, code as u8, 255]
        });
        Picture {
            width: width as u32,
            height: height as u32,
            rgba: rgba.collect(),
        }
    }

    #[test]
    fn finds_shifts_whatever_the_exposure() {
        for pixels in [(0, 0), (1, -1), (-13, 7), (22, 17)] {
            for gain in [1.0, 0.4, 1.3] {
                let pixels = IVec2::from(pixels);
                let found = shift(&texture(IVec2::ZERO, 1.0), &texture(pixels, gain)).unwrap();
                // At the lowest contrast, rounding of codes hides a pixel.
                let error = (found.pixels - pixels).abs().max_element();
                assert!(error <= 1, "{found:?} for {pixels}, gain {gain}");
                assert!(found.differing < 0.02, "{found:?}");
            }
        }
    }

    #[test]
    fn uniform_pictures_have_no_shift() {
        let grey = Picture {
            width: 64,
            height: 64,
            rgba: vec![128; 4 * 64 * 64],
        };
        assert_eq!(shift(&grey, &grey), None);
        assert_eq!(shift(&grey, &texture(IVec2::ZERO, 1.0)), None);
    }
}
