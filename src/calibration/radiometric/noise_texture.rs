//! Correlation of a camera's noise between neighbouring pixels and between channels, from the
//! differences of pictures of a static scene: what demosaicing, denoising and the codec left of
//! independent noise.

use penumbra_camera::NoiseTexture;
use penumbra_camera::look::{NOISE_LAGS, OPPONENT_FROM_RGB};
use penumbra_picture::Picture;

/// Interval between the pixels that are compared with their neighbours, each way.
const STEP: usize = 3;
/// Maximum difference between a pixel's code and that of its neighbours: at edges and in texture the
/// slightest motion exceeds noise.
const MAX_EDGE: i32 = 14;
/// Codes at which noise is not clipped.
const UNCLIPPED: std::ops::RangeInclusive<i32> = 12..=240;
/// Maximum difference of two pictures' codes that counts as noise.
const MAX_DIFFERENCE: i32 = 31;
/// Minimum number of pixels.
const MIN_PIXELS: f64 = 2000.0;
/// Minimum variance of luma, codes², of a difference: below it rounding hides the correlation.
const MIN_VARIANCE: f64 = 0.25;
/// Variance of the difference of two codes by rounding.
const ROUNDING: f64 = 1.0 / 6.0;

/// Sums of products of differences.
#[derive(Clone, Debug, Default)]
pub struct NoiseTextureGatherer {
    /// Number of pixels, sums of the channels' differences and of their products.
    pixels: f64,
    sums: [f64; 3],
    products: [[f64; 3]; 3],
    /// By direction and lag: number of pairs; by component, sum of products.
    pairs: [[f64; NOISE_LAGS]; 2],
    lagged: [[[f64; 3]; NOISE_LAGS]; 2],
}

/// Two pictures of a static scene.
struct Pair<'a> {
    first: &'a Picture,
    second: &'a Picture,
}

impl Pair<'_> {
    /// Differences of the channels at a pixel; `None` at edges and where codes are clipped.
    fn difference(&self, x: usize, y: usize) -> Option<[f64; 3]> {
        let width = self.first.width as usize;
        let i = 4 * (y * width + x);
        let mut out = [0.0; 3];
        for (c, out) in out.iter_mut().enumerate() {
            let mean =
                |k: usize| i32::from(self.first.rgba[k + c]) + i32::from(self.second.rgba[k + c]);
            let centre = mean(i);
            let around = [
                mean(i - 4),
                mean(i + 4),
                mean(i - 4 * width),
                mean(i + 4 * width),
            ];
            let difference = i32::from(self.first.rgba[i + c]) - i32::from(self.second.rgba[i + c]);
            let is_even = around.iter().all(|v| (v - centre).abs() < 2 * MAX_EDGE);
            if !is_even || !UNCLIPPED.contains(&(centre / 2)) || difference.abs() > MAX_DIFFERENCE {
                return None;
            }
            *out = f64::from(difference);
        }
        Some(out)
    }
}

fn opponent(rgb: [f64; 3]) -> [f64; 3] {
    OPPONENT_FROM_RGB.map(|row| (0..3).map(|c| row[c] * rgb[c]).sum())
}

impl NoiseTextureGatherer {
    /// Adds two successive pictures of a static scene; pictures of different sizes are ignored.
    pub fn add(&mut self, first: &Picture, second: &Picture) {
        let (width, height) = (first.width as usize, first.height as usize);
        if (second.width, second.height) != (first.width, first.height) {
            return;
        }
        let pair = Pair { first, second };
        let reach = NOISE_LAGS + 1;
        for y in (1..height.saturating_sub(reach)).step_by(STEP) {
            for x in (1..width.saturating_sub(reach)).step_by(STEP) {
                if let Some(own) = pair.difference(x, y) {
                    self.add_pixel(&pair, (x, y), own);
                }
            }
        }
    }

    fn add_pixel(&mut self, pair: &Pair<'_>, (x, y): (usize, usize), own: [f64; 3]) {
        self.pixels += 1.0;
        for c in 0..3 {
            self.sums[c] += own[c];
            for d in 0..3 {
                self.products[c][d] += own[c] * own[d];
            }
        }
        let here = opponent(own);
        for lag in 0..NOISE_LAGS {
            let places = [(x + lag + 1, y), (x, y + lag + 1)];
            for (direction, (u, v)) in places.into_iter().enumerate() {
                let Some(there) = pair.difference(u, v).map(opponent) else {
                    continue;
                };
                self.pairs[direction][lag] += 1.0;
                for i in 0..3 {
                    self.lagged[direction][lag][i] += here[i] * there[i];
                }
            }
        }
    }

    /// Returns the correlation; `None` for too few pixels, or if rounding hides it.
    #[must_use]
    pub fn finish(&self) -> Option<NoiseTexture> {
        if self.pixels < MIN_PIXELS {
            return None;
        }
        let mean = self.sums.map(|s| s / self.pixels);
        let rounding = |c: usize, d: usize| if c == d { ROUNDING } else { 0.0 };
        let covariance: [[f64; 3]; 3] = std::array::from_fn(|c| {
            std::array::from_fn(|d| {
                self.products[c][d] / self.pixels - mean[c] * mean[d] - rounding(c, d)
            })
        });
        let variances = transformed(&covariance);
        if variances[0][0] < MIN_VARIANCE || (0..3).any(|c| covariance[c][c] <= 0.0) {
            return None;
        }
        // Flicker of the light shifts all pixels alike; it is no noise.
        let shift = opponent(mean);
        let lags = |direction: usize, i: usize| {
            std::array::from_fn(|lag| {
                let pairs = self.pairs[direction][lag].max(1.0);
                let product = self.lagged[direction][lag][i] / pairs - shift[i] * shift[i];
                (product / variances[i][i].max(1e-3)).clamp(-1.0, 1.0)
            })
        };
        let correlation: [[f64; 3]; 3] = std::array::from_fn(|c| {
            std::array::from_fn(|d| {
                let scale = (covariance[c][c] * covariance[d][d]).sqrt();
                (covariance[c][d] / scale).clamp(-1.0, 1.0)
            })
        });
        Some(NoiseTexture {
            across: [0, 1, 2].map(|i| lags(0, i)),
            down: [0, 1, 2].map(|i| lags(1, i)),
            covariance: transformed(&correlation),
        })
    }
}

/// Covariance of luma and colour differences from that of the channels: T C Tᵀ.
fn transformed(covariance: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let t = &OPPONENT_FROM_RGB;
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let terms = (0..9).map(|k| t[i][k / 3] * covariance[k / 3][k % 3] * t[j][k % 3]);
            terms.sum()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_numerics::Random;

    /// Even grey with noise of 4 codes that is averaged with its right neighbour, colours apart.
    fn picture(seed: u64, grey: f64) -> Picture {
        let (width, height) = (240_u32, 180_u32);
        let mut random = Random::new(seed);
        let count = (width * height) as usize + 1;
        let white: Vec<[f64; 3]> = (0..count)
            .map(|_| {
                let common = random.normal();
                [0; 3].map(|_| grey * common + (1.0 - grey * grey).sqrt() * random.normal())
            })
            .collect();
        let mut rgba = Vec::new();
        for pair in white.windows(2) {
            for (own, next) in pair[0].iter().zip(pair[1]) {
                let value = (own + next) * 0.5_f64.sqrt();
                rgba.push((120.0 + 2.0 * value).round() as u8);
            }
            rgba.push(255);
        }
        Picture {
            width,
            height,
            rgba,
        }
    }

    #[test]
    fn measures_correlation_over_pixels_and_channels() {
        let mut gatherer = NoiseTextureGatherer::default();
        for i in 0..3 {
            gatherer.add(&picture(2 * i, 0.8), &picture(2 * i + 1, 0.8));
        }
        let found = gatherer.finish().unwrap();
        for i in 0..3 {
            assert!((found.across[i][0] - 0.5).abs() < 0.05, "{found:?}");
            assert!(found.across[i][1].abs() < 0.05, "{found:?}");
            assert!(found.down[i][0].abs() < 0.05, "{found:?}");
        }
        // Channels correlated by 0.64: Y has 0.64 + 0.36 (0.299² + 0.587² + 0.114²).
        assert!((found.covariance[0][0] - 0.801).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn independent_noise_is_white_and_hidden_noise_is_unknown() {
        let mut gatherer = NoiseTextureGatherer::default();
        gatherer.add(&picture(1, 0.0), &picture(2, 0.0));
        let found = gatherer.finish().unwrap();
        let white = NoiseTexture::WHITE.covariance;
        for i in 0..9 {
            let difference = found.covariance[i / 3][i % 3] - white[i / 3][i % 3];
            assert!(difference.abs() < 0.04, "{found:?}");
        }
        let mut gatherer = NoiseTextureGatherer::default();
        let even = picture(1, 0.0);
        gatherer.add(&even, &even);
        assert_eq!(gatherer.finish(), None);
        assert_eq!(NoiseTextureGatherer::default().finish(), None);
    }
}
