//! A camera's shot and read noise in linear values, from pairs of pictures of a static scene.

use penumbra_camera::Response;
use penumbra_picture::Picture;

/// Number of codes in a bin.
const BIN: usize = 8;
/// Number of bins.
const BINS: usize = 256 / BIN;
/// Maximum difference of a pixel's neighbours, codes: on an edge the slightest motion exceeds noise.
const MAX_EDGE: i32 = 14;
/// Bins in which noise is not clipped at black or white.
const UNCLIPPED_BINS: std::ops::RangeInclusive<usize> = 1..=29;
/// Minimum number of differences in a bin.
const MIN_COUNT: f64 = 200.0;
/// Differences of more than this number of standard deviations are motion.
const OUTLIER_SIGMAS: f64 = 4.0;

/// Histogram of differences between the pixels of two pictures.
#[derive(Clone, Debug)]
pub struct NoiseGatherer {
    /// Counts by channel, bin of the mean code, and difference −32 to 31.
    counts: Box<[[[u32; 64]; BINS]; 3]>,
    /// Number of pairs of pictures.
    pub pairs: usize,
}

impl Default for NoiseGatherer {
    fn default() -> Self {
        Self {
            counts: Box::new([[[0; 64]; BINS]; 3]),
            pairs: 0,
        }
    }
}

/// Noise model: the variance of a pixel is read + shot × value, linear, full scale 1 (the photon
/// transfer curve, Janesick 2007).
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// Variance of the read noise by channel.
    pub read: [f64; 3],
    /// Standard error of `read`.
    pub read_sigma: [f64; 3],
    /// Variance of the shot noise per linear value, by channel.
    pub shot: [f64; 3],
    /// Standard error of `shot`.
    pub shot_sigma: [f64; 3],
    /// Measured linear values and standard deviations by channel, for the report.
    pub points: [Vec<(f64, f64)>; 3],
}

impl NoiseGatherer {
    /// Adds two successive pictures of a static scene; pictures of different sizes are ignored.
    pub fn add(&mut self, first: &Picture, second: &Picture) {
        let (w, h) = (first.width as usize, first.height as usize);
        if (second.width, second.height) != (first.width, first.height) || w < 3 || h < 3 {
            return;
        }
        self.pairs += 1;
        // Neighbours are correlated by compression: every third pixel suffices.
        for y in (1..h - 1).step_by(3) {
            for x in (1..w - 1).step_by(3) {
                let i = 4 * (y * w + x);
                for c in 0..3 {
                    self.add_pixel(first, second, i + c, 4 * w, c);
                }
            }
        }
    }

    fn add_pixel(&mut self, first: &Picture, second: &Picture, i: usize, row: usize, c: usize) {
        let mean = |k: usize| i32::from(first.rgba[k]) + i32::from(second.rgba[k]);
        let around = [mean(i - 4), mean(i + 4), mean(i - row), mean(i + row)];
        let centre = mean(i);
        // Sums of two pictures: twice the codes.
        let level: i32 = around.iter().sum::<i32>() / 4;
        let flat = (around[0] - around[1])
            .abs()
            .max((around[2] - around[3]).abs())
            < 2 * MAX_EDGE
            && (level - centre).abs() < 2 * MAX_EDGE;
        let difference = i32::from(first.rgba[i]) - i32::from(second.rgba[i]);
        if flat && (-32..32).contains(&difference) {
            // The neighbours' mean is independent of the difference, so that binning by it is unbiased.
            let bin = (level / 2) as usize / BIN;
            self.counts[c][bin.min(BINS - 1)][(difference + 32) as usize] += 1;
        }
    }

    /// Fits the model; `None` for too few pictures or too little variation of brightness, and for
    /// identical pictures, which have no noise.
    #[must_use]
    pub fn finish(&self, response: &Response) -> Option<Noise> {
        let mut noise = Noise {
            read: [0.0; 3],
            read_sigma: [0.0; 3],
            shot: [0.0; 3],
            shot_sigma: [0.0; 3],
            points: Default::default(),
        };
        for c in 0..3 {
            let points = self.points(c, response);
            let line = line(&points)?;
            noise.read[c] = line.at.0;
            noise.read_sigma[c] = line.sigma.0;
            noise.shot[c] = line.at.1;
            noise.shot_sigma[c] = line.sigma.1;
            noise.points[c] = points
                .iter()
                .map(|p| (p.value, p.variance.sqrt()))
                .collect();
        }
        Some(noise)
    }

    fn points(&self, channel: usize, response: &Response) -> Vec<Point> {
        let bins = self.counts[channel].iter().enumerate();
        bins.filter(|(bin, _)| UNCLIPPED_BINS.contains(bin))
            .filter_map(|(bin, counts)| point(bin, counts, response))
            .collect()
    }
}

struct Point {
    value: f64,
    variance: f64,
    /// Standard deviation of `variance`.
    sigma: f64,
}

/// Returns value and variance of a bin, linear, without outliers; `None` for too few differences.
fn point(bin: usize, counts: &[u32; 64], response: &Response) -> Option<Point> {
    let at = |k: usize| k as f64 - 32.0;
    let mut limit = 32.0;
    let (mut n, mut mean, mut variance) = (0.0, 0.0, 0.0);
    for _ in 0..6 {
        let within = || (0..64).filter(|k| (at(*k) - mean).abs() <= limit);
        n = within().map(|k| f64::from(counts[k])).sum();
        if n < MIN_COUNT {
            return None;
        }
        let new_mean = within().map(|k| f64::from(counts[k]) * at(k)).sum::<f64>() / n;
        variance = within()
            .map(|k| f64::from(counts[k]) * (at(k) - new_mean).powi(2))
            .sum::<f64>()
            / n;
        mean = new_mean;
        limit = (OUTLIER_SIGMAS * variance.sqrt()).max(2.0);
    }
    // Half of the difference's variance for each picture, less that of rounding.
    let code_variance = 0.5 * variance - 1.0 / 12.0;
    if variance <= 0.0 || code_variance <= 0.0 {
        return None;
    }
    let code = (bin * BIN + BIN / 2) as u8;
    let step = f64::from(response.step(code));
    let value = f64::from(response.linear_from_code()[usize::from(code)]);
    // Compression correlates neighbours: far fewer than n are independent.
    let relative = (2.0 / (n / 16.0)).sqrt().hypot(0.02);
    // Noise that reaches black is clipped and its variance underestimated.
    (f64::from(code) > 2.5 * code_variance.sqrt()).then_some(Point {
        value,
        variance: code_variance * step * step,
        sigma: relative * 0.5 * variance * step * step,
    })
}

struct Line {
    at: (f64, f64),
    sigma: (f64, f64),
}

/// Fits a line by weighted least squares with non-negative coefficients.
fn line(points: &[Point]) -> Option<Line> {
    if points.len() < 4 {
        return None;
    }
    let (mut s, mut sx, mut sxx, mut sy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points {
        let w = 1.0 / (p.sigma * p.sigma);
        s += w;
        sx += w * p.value;
        sxx += w * p.value * p.value;
        sy += w * p.variance;
        sxy += w * p.value * p.variance;
    }
    let determinant = s * sxx - sx * sx;
    let mut at = (
        (sxx * sy - sx * sxy) / determinant,
        (s * sxy - sx * sy) / determinant,
    );
    if at.0 < 0.0 {
        at = (0.0, sxy / sxx);
    } else if at.1 < 0.0 {
        at = (sy / s, 0.0);
    }
    let residual = |p: &Point| (p.variance - at.0 - at.1 * p.value) / p.sigma;
    let chi = points.iter().map(|p| residual(p).powi(2)).sum::<f64>() / (points.len() - 2) as f64;
    let inflate = chi.max(1.0).sqrt();
    let sigma = (
        inflate * (sxx / determinant).sqrt(),
        inflate * (s / determinant).sqrt(),
    );
    (at.0.is_finite() && at.1.is_finite() && sigma.0.is_finite()).then_some(Line { at, sigma })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radiometric::synthetic::normal;

    /// A ramp with noise, brighter to the right.
    fn ramp(read: f64, shot: f64, seed: u64, response: &Response) -> Picture {
        let (width, height) = (360, 240);
        let mut rgba = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let value = 0.95 * f64::from(x) / f64::from(width);
                for c in 0..3 {
                    let i = u64::from(4 * (y * width + x) + c);
                    let sigma = (read + shot * value).sqrt();
                    rgba.push(response.code_from_linear((value + sigma * normal(seed, i)) as f32));
                }
                rgba.push(255);
            }
        }
        Picture {
            width,
            height,
            rgba,
        }
    }

    #[test]
    fn separates_read_and_shot_noise() {
        for response in [Response::srgb(), Response::gamma(1.8)] {
            let (read, shot) = (2e-5, 1.5e-4);
            let mut gatherer = NoiseGatherer::default();
            for seed in 0..4 {
                let first = ramp(read, shot, 2 * seed + 1, &response);
                gatherer.add(&first, &ramp(read, shot, 2 * seed + 2, &response));
            }
            let found = gatherer.finish(&response).unwrap();
            for c in 0..3 {
                assert!((found.shot[c] / shot - 1.0).abs() < 0.1, "{found:?}");
                let error = (found.read[c] - read).abs();
                assert!(
                    error < 4.0 * found.read_sigma[c].max(0.15 * read),
                    "{found:?}"
                );
            }
        }
    }

    #[test]
    fn ignores_motion_and_refuses_identical_pictures() {
        let response = Response::srgb();
        let first = ramp(2e-5, 1.5e-4, 1, &response);
        let mut second = ramp(2e-5, 1.5e-4, 2, &response);
        for y in 100..140 {
            second.rgba[4 * 360 * y + 400..4 * 360 * y + 600].fill(90);
        }
        let mut gatherer = NoiseGatherer::default();
        gatherer.add(&first, &second);
        let found = gatherer.finish(&response).unwrap();
        assert!((found.shot[1] / 1.5e-4 - 1.0).abs() < 0.2, "{found:?}");
        let mut gatherer = NoiseGatherer::default();
        gatherer.add(&first, &first);
        assert_eq!(gatherer.finish(&response), None);
        assert_eq!(NoiseGatherer::default().finish(&response), None);
    }
}
