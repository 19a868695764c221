//! Merges bracketed 8-bit pictures into one linear picture.

use glam::Vec3;
use penumbra_camera::Response;
use penumbra_picture::Picture;

/// Codes from which the weight of a pixel falls, and at which it is zero. Compression and noise
/// lower a saturated 255 to about 250.
const FADE_FROM: f32 = 225.0;
const CLIPPED: f32 = 248.0;
/// Minimum code of the darkest channel of a clipped pixel.
const NEARLY_CLIPPED: f32 = 250.0;

/// One exposure of an instant.
#[derive(Clone, Copy, Debug)]
pub struct Bracket<'a> {
    /// The picture as the camera encoded it.
    pub picture: &'a Picture,
    /// Stops relative to the base exposure: −4 is sixteen times darker.
    pub ev: f64,
}

/// Merges exposures of one instant, the brightest first, into linear values in units of
/// the base exposure.
///
/// Every pixel is read from the longest exposure that does not clip it, because shot noise, read
/// noise, quantisation and compression are smallest there; the next shorter one is blended in over
/// the top codes so that the transition shows no edge. The weights depend on the *longer*
/// exposure's code alone: weights that depended on the short exposure's noisy code would prefer its
/// positive errors, and its zero would be biased by the noise clipped at zero.
#[derive(Clone, Debug)]
pub struct BracketMerger {
    linear_from_code: [f32; 256],
    share_of_longer: [f32; 256],
    /// Factor on each pixel; empty without vignetting.
    corrections: Vec<f32>,
}

impl BracketMerger {
    /// Creates a merger for a camera with the given tone curve.
    #[must_use]
    pub fn new(response: &Response) -> Self {
        Self {
            linear_from_code: *response.linear_from_code(),
            share_of_longer: std::array::from_fn(|code| {
                1.0 - ((code as f32 - FADE_FROM) / (CLIPPED - FADE_FROM)).clamp(0.0, 1.0)
            }),
            corrections: Vec::new(),
        }
    }

    /// Replaces the tone curve.
    pub fn set_response(&mut self, response: &Response) {
        self.linear_from_code = *response.linear_from_code();
    }

    /// Corrects vignetting: `corrections` holds one factor per pixel, row-major
    /// ([`Vignetting::corrections`](penumbra_camera::Vignetting)).
    pub fn set_corrections(&mut self, corrections: Vec<f32>) {
        self.corrections = corrections;
    }

    /// Returns the linear value of pixel `i` (row-major) and whether even the shortest exposure
    /// clips it. `brackets` must be sorted from long to short, and their pictures must have pixel
    /// `i`.
    #[must_use]
    pub fn pixel(&self, brackets: &[Bracket], scales: &[f32], i: usize) -> (Vec3, bool) {
        let vignetting = self.corrections.get(i).copied().unwrap_or(1.0);
        let mut value = Vec3::ZERO;
        let mut remaining = 1.0;
        for (k, (bracket, &scale)) in brackets.iter().zip(scales).enumerate() {
            let codes = &bracket.picture.rgba[4 * i..4 * i + 3];
            let top = codes.iter().copied().max().unwrap_or(0);
            let last = k + 1 == brackets.len();
            let share = if last {
                remaining
            } else {
                remaining * self.share_of_longer[top as usize]
            };
            value += self.linear(codes) * (share * scale);
            remaining -= share;
            if last {
                // One saturated channel is colour (a blue sky, a red lamp); an overexposed source
                // saturates all three.
                let bottom = codes.iter().copied().min().unwrap_or(0);
                let clipped = f32::from(top) >= CLIPPED && f32::from(bottom) >= NEARLY_CLIPPED;
                return (value * vignetting, clipped);
            }
            if remaining <= 0.0 {
                break;
            }
        }
        (value * vignetting, false)
    }

    fn linear(&self, codes: &[u8]) -> Vec3 {
        let at = |c: usize| self.linear_from_code[codes[c] as usize];
        Vec3::new(at(0), at(1), at(2))
    }
}

/// Returns the factors that convert each bracket's linear values to the base exposure's units.
#[must_use]
pub fn scales(brackets: &[Bracket]) -> Vec<f32> {
    brackets.iter().map(|b| (-b.ev).exp2() as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_camera::srgb_from_linear;

    fn flat(linear: f32, noise: &[i32]) -> Picture {
        let code = (srgb_from_linear(linear) * 255.0).round() as i32;
        let rgba = noise
            .iter()
            .flat_map(|n| {
                let c = (code + n).clamp(0, 255) as u8;
                [c, c, c, 255]
            })
            .collect();
        Picture {
            width: noise.len() as u32,
            height: 1,
            rgba,
        }
    }

    fn merged(radiance: f32, noise: &[i32]) -> (f32, bool) {
        let evs = [0.0, -4.0, -8.0];
        let pictures = evs.map(|ev: f64| flat(radiance * ev.exp2() as f32, noise));
        let brackets: Vec<Bracket> = pictures
            .iter()
            .zip(evs)
            .map(|(picture, ev)| Bracket { picture, ev })
            .collect();
        let merger = BracketMerger::new(&Response::srgb());
        let values: Vec<(Vec3, bool)> = (0..noise.len())
            .map(|i| merger.pixel(&brackets, &scales(&brackets), i))
            .collect();
        let mean = values.iter().map(|(v, _)| v.x).sum::<f32>() / noise.len() as f32;
        (mean, values.iter().any(|v| v.1))
    }

    #[test]
    fn vignetting_is_corrected_per_pixel() {
        let picture = flat(0.25, &[0, 0, 0]);
        let brackets = [Bracket {
            picture: &picture,
            ev: 0.0,
        }];
        let mut merger = BracketMerger::new(&Response::srgb());
        let (before, _) = merger.pixel(&brackets, &[1.0], 2);
        merger.set_corrections(vec![1.0, 1.25, 2.0]);
        let after: Vec<Vec3> = (0..3)
            .map(|i| merger.pixel(&brackets, &[1.0], i).0)
            .collect();
        assert_eq!(after, [before, before * 1.25, before * 2.0]);
    }

    #[test]
    fn radiance_is_unbiased_at_every_level() {
        let noise = [-2, -1, 0, 0, 1, 2, 1, -1];
        for radiance in [0.1, 0.2, 0.75, 0.85, 1.0, 3.0, 13.0, 15.0, 30.0, 200.0] {
            let (mean, clipped) = merged(radiance, &noise);
            assert!((mean / radiance - 1.0).abs() < 0.02, "{radiance}: {mean}");
            assert!(!clipped, "{radiance}");
        }
    }

    #[test]
    fn pixels_clipped_in_shortest_exposure_are_flagged() {
        assert!(merged(300.0, &[0]).1);
        let one = flat(2.0, &[0]);
        let merger = BracketMerger::new(&Response::srgb());
        let base = [Bracket {
            picture: &one,
            ev: 0.0,
        }];
        assert_eq!(merger.pixel(&base, &[1.0], 0), (Vec3::ONE, true));
    }
}
