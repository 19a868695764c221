//! Gains from the same chart in the same light, photographed by both cameras.

use super::colour::delta_e_linear;
use super::colour_matrix::{self, ColourPair};
use super::gains::GainEstimate;
use super::robust_mean::{LogRatio, RobustMean, robust_mean};
use glam::{DMat3, DVec3};
use penumbra_camera::Response;
use penumbra_picture::Picture;
use thiserror::Error;

/// The same chart in the same light, photographed by both cameras.
#[derive(Clone, Debug)]
pub struct PhotometricChart {
    /// Name of the attachment with the scene camera's picture.
    pub scene_picture: String,
    /// Name of the attachment with the environment camera's picture.
    pub environment_picture: String,
    /// Patch rectangles x, y, width, height in pixels, the same in both.
    pub patches: Vec<[u32; 4]>,
    /// Linear reflectance of each patch, if known.
    pub reflectance: Vec<[f32; 3]>,
}

/// A picture and how its codes are to be read.
#[derive(Clone, Copy, Debug)]
pub struct Photograph<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// Its camera's tone curve.
    pub response: &'a Response,
}

/// Gains from two photographs of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartMatch {
    /// The gains.
    pub estimate: GainEstimate,
    /// `scene = matrix × environment`, linear; only on request and where it predicts patches to
    /// which it was not fitted better than the gains do.
    pub matrix: Option<DMat3>,
    /// Number of patches used for each channel's gain, without outliers.
    pub patches: [usize; 3],
    /// Mean over patches of the CIEDE2000 that remains between the two pictures of a patch.
    pub residual_delta_e: f64,
    /// The same for the worst patch.
    pub worst_delta_e: f64,
}

/// Why a chart yields no gains.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum ChartError {
    /// A patch rectangle is not inside the picture.
    #[error(
        "chart patch {patch} at {rect:?} is not inside the {camera} camera's chart picture \
         of {width}×{height}; correct `patches_xywh`"
    )]
    Outside {
        /// Index in the list.
        patch: usize,
        /// x, y, width, height.
        rect: [u32; 4],
        /// "scene" or "environment".
        camera: &'static str,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Not enough patches are between too dark and saturated in both pictures.
    #[error(
        "only {usable} chart patches are well exposed in {channel} in both pictures, 3 are \
         needed; photograph the chart again with another exposure"
    )]
    TooFew {
        /// Number of usable patches.
        usable: usize,
        /// "red", "green" or "blue".
        channel: &'static str,
    },
}

/// Lowest code that counts as clipped.
const SATURATED: u8 = 253;
/// Maximum share of clipped pixels in a patch; more would bias its mean.
const MAX_CLIPPED: f64 = 0.002;
/// Minimum ratio of a patch's mean to a pixel's standard deviation; below it, noise is clipped at
/// black and the mean is too high.
const MIN_SIGNAL_TO_NOISE: f64 = 3.0;
/// Relative difference between two photographs of a patch by uneven light and flare.
const UNEVENNESS: f64 = 0.003;

const CHANNELS: [&str; 3] = ["red", "green", "blue"];

/// Compares two photographs of a chart patch by patch. `want_matrix` also tries a 3×3 matrix.
///
/// # Errors
/// A patch is not inside a picture, or fewer than three patches are well exposed in both.
pub fn match_chart(
    chart: &PhotometricChart,
    scene: Photograph,
    environment: Photograph,
    want_matrix: bool,
) -> Result<ChartMatch, ChartError> {
    let scene = read_patches(&chart.patches, scene, "scene")?;
    let environment = read_patches(&chart.patches, environment, "environment")?;
    let patches: Vec<(Patch, Patch)> = scene.into_iter().zip(environment).collect();
    match_patches(&patches, want_matrix)
}

/// Compares patches that have been read already, (scene, environment) each. `want_matrix` also
/// tries a 3×3 matrix.
///
/// # Errors
/// Fewer than three patches are well exposed in both.
pub fn match_patches(
    patches: &[(Patch, Patch)],
    want_matrix: bool,
) -> Result<ChartMatch, ChartError> {
    let mut channels = [const { None::<RobustMean> }; 3];
    for (c, slot) in channels.iter_mut().enumerate() {
        *slot = Some(match_channel(patches, c)?);
    }
    let channels = channels.map(|mean| mean.unwrap_or(UNKNOWN));
    let by_channel =
        |f: fn(&RobustMean) -> f64| DVec3::from_array([0, 1, 2].map(|c| f(&channels[c])));
    let estimate = GainEstimate {
        gains: by_channel(|m| m.mean.exp()),
        relative_sd: by_channel(|m| m.sd),
    };
    let pairs: Vec<ColourPair> = patches.iter().filter_map(colour_pair).collect();
    let matrix = want_matrix
        .then(|| colour_matrix::fit(&pairs, estimate.gains))
        .flatten();
    let (residual_delta_e, worst_delta_e) = residuals(&pairs, estimate.gains, matrix);
    Ok(ChartMatch {
        estimate,
        matrix,
        patches: channels.map(|m| m.inliers),
        residual_delta_e,
        worst_delta_e,
    })
}

const UNKNOWN: RobustMean = RobustMean {
    mean: 0.0,
    sd: f64::INFINITY,
    spread: f64::INFINITY,
    inliers: 0,
    clusters: 0,
};

fn match_channel(patches: &[(Patch, Patch)], channel: usize) -> Result<RobustMean, ChartError> {
    let ratios: Vec<LogRatio> = patches
        .iter()
        .enumerate()
        .filter_map(|(i, (scene, environment))| {
            let (s, e) = (scene.0[channel]?, environment.0[channel]?);
            Some(LogRatio {
                value: (s.mean / e.mean).ln(),
                variance: s.relative_variance() + e.relative_variance() + UNEVENNESS.powi(2),
                cluster: i as u32,
            })
        })
        .collect();
    let too_few = |usable| ChartError::TooFew {
        usable,
        channel: CHANNELS[channel],
    };
    let mean = robust_mean(&ratios).ok_or_else(|| too_few(0))?;
    if mean.inliers < 3 {
        return Err(too_few(mean.inliers));
    }
    Ok(mean)
}

fn residuals(pairs: &[ColourPair], gains: DVec3, matrix: Option<DMat3>) -> (f64, f64) {
    let matrix = matrix.unwrap_or(DMat3::from_diagonal(gains));
    let errors = pairs
        .iter()
        .map(|p| delta_e_linear(p.scene, matrix * p.environment));
    let (sum, worst) = errors.fold((0.0, 0.0f64), |(sum, worst), e| (sum + e, worst.max(e)));
    (sum / pairs.len().max(1) as f64, worst)
}

fn colour_pair((scene, environment): &(Patch, Patch)) -> Option<ColourPair> {
    let means = |patch: &Patch| {
        let [r, g, b] = patch.0;
        Some(DVec3::new(r?.mean, g?.mean, b?.mean))
    };
    Some(ColourPair {
        scene: means(scene)?,
        environment: means(environment)?,
    })
}

/// Values of a patch per channel; `None` where it is too dark or clipped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch(pub [Option<Reading>; 3]);

/// Linear values of an even surface's pixels in one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Mean.
    pub mean: f64,
    /// Variance of the mean.
    pub variance_of_mean: f64,
    /// Variance of a pixel.
    pub variance: f64,
}

impl Reading {
    fn relative_variance(&self) -> f64 {
        self.variance_of_mean / (self.mean * self.mean)
    }
}

fn read_patches(
    rects: &[[u32; 4]],
    photograph: Photograph,
    camera: &'static str,
) -> Result<Vec<Patch>, ChartError> {
    let (width, height) = (photograph.picture.width, photograph.picture.height);
    let read = |(patch, &rect): (usize, &[u32; 4])| {
        let inside = |start: u32, length: u32, limit: u32| {
            length > 0 && start.checked_add(length).is_some_and(|end| end <= limit)
        };
        if !inside(rect[0], rect[2], width) || !inside(rect[1], rect[3], height) {
            return Err(ChartError::Outside {
                patch,
                rect,
                camera,
                width,
                height,
            });
        }
        Ok(Patch([0, 1, 2].map(|c| read_channel(photograph, rect, c))))
    };
    rects.iter().enumerate().map(read).collect()
}

fn read_channel(photograph: Photograph, rect: [u32; 4], channel: usize) -> Option<Reading> {
    let codes = inner_codes(photograph.picture, rect, channel);
    read_codes(&codes, photograph.response)
}

/// Averages the pixels of an even surface without outliers (dust); `None` where it is clipped or
/// too dark.
#[must_use]
pub fn read_codes(codes: &[u8], response: &Response) -> Option<Reading> {
    let clipped = codes.iter().filter(|&&code| code >= SATURATED).count();
    if codes.is_empty() || clipped as f64 > MAX_CLIPPED * codes.len() as f64 {
        return None;
    }
    let table = response.linear_from_code();
    let mut linear: Vec<f64> = codes
        .iter()
        .map(|&code| f64::from(table[usize::from(code)]))
        .collect();
    linear.sort_by(f64::total_cmp);
    let kept = without_dust(&linear, response);
    let n = kept.len() as f64;
    let mean = kept.iter().sum::<f64>() / n;
    let variance = kept.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
    let step = f64::from(response.step(codes[codes.len() / 2]));
    // Without noise to dither it, quantisation does not average out.
    let quantisation = if variance < 0.25 * step * step {
        step * step / 12.0
    } else {
        0.0
    };
    (mean > MIN_SIGNAL_TO_NOISE * variance.sqrt() && mean > 2.0 * step).then_some(Reading {
        mean,
        variance_of_mean: variance / n + quantisation,
        variance,
    })
}

/// Codes of a patch without its margin: a rectangle drawn by hand may cross the patch's edge.
fn inner_codes(picture: &Picture, [x, y, width, height]: [u32; 4], channel: usize) -> Vec<u8> {
    let (dx, dy) = (width / 8, height / 8);
    let rows = y + dy..y + height - dy;
    rows.flat_map(|v| (x + dx..x + width - dx).map(move |u| (u, v)))
        .map(|(u, v)| picture.rgb(u, v)[channel])
        .collect()
}

/// The part of ascending values within four robust standard deviations of their median.
fn without_dust<'a>(sorted: &'a [f64], response: &Response) -> &'a [f64] {
    let at = |fraction: f64| sorted[((sorted.len() - 1) as f64 * fraction).round() as usize];
    let median = at(0.5);
    // 1.349 σ lie between the quartiles of a normal distribution.
    let sigma = (at(0.75) - at(0.25)) / 1.349;
    let step = f64::from(response.step(response.code_from_linear(median as f32)));
    let limit = 4.0 * sigma.max(0.5 * step);
    let start = sorted.partition_point(|&x| x < median - limit);
    let end = sorted.partition_point(|&x| x <= median + limit);
    &sorted[start..end]
}

#[cfg(test)]
mod tests {

    use super::*;

    const REFLECTANCE: [[f64; 3]; 8] = [
        [0.90, 0.90, 0.89],
        [0.58, 0.58, 0.58],
        [0.35, 0.35, 0.35],
        [0.19, 0.19, 0.19],
        [0.17, 0.08, 0.06],
        [0.54, 0.30, 0.22],
        [0.12, 0.19, 0.34],
        [0.13, 0.51, 0.40],
    ];

    fn chart() -> PhotometricChart {
        PhotometricChart {
            scene_picture: String::new(),
            environment_picture: String::new(),
            patches: (0..8).map(|i| [40 * i, 0, 40, 40]).collect(),
            reflectance: Vec::new(),
        }
    }

    /// A chart as a camera of this matrix would see it, with a little noise.
    fn photograph(matrix: DMat3, response: &Response, seed: u64) -> Picture {
        let mut noise = seed;
        let mut next = move || {
            noise = noise
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (noise >> 40) as f64 / f64::from(1 << 24) - 0.5
        };
        let mut rgba = Vec::new();
        for _y in 0..40 {
            for x in 0..320usize {
                let value = matrix * DVec3::from_array(REFLECTANCE[x / 40]);
                let noisy = value.to_array().map(|v| (v + 0.004 * next()) as f32);
                let codes = noisy.map(|v| response.code_from_linear(v));
                rgba.extend([codes[0], codes[1], codes[2], 255]);
            }
        }
        Picture {
            width: 320,
            height: 40,
            rgba,
        }
    }

    fn compare(
        scene: DMat3,
        environment: DMat3,
        want_matrix: bool,
    ) -> Result<ChartMatch, ChartError> {
        let (srgb, gamma) = (Response::srgb(), Response::gamma(2.2));
        let scene = photograph(scene, &srgb, 1);
        let environment = photograph(environment, &gamma, 2);
        match_chart(
            &chart(),
            Photograph {
                picture: &scene,
                response: &srgb,
            },
            Photograph {
                picture: &environment,
                response: &gamma,
            },
            want_matrix,
        )
    }

    fn diagonal(r: f64, g: f64, b: f64) -> DMat3 {
        DMat3::from_diagonal(DVec3::new(r, g, b))
    }

    #[test]
    fn recovers_gains_within_half_a_percent() {
        let found = compare(diagonal(0.8, 0.75, 0.7), diagonal(0.2, 0.25, 0.3), true).unwrap();
        let ground_truth = DVec3::new(4.0, 3.0, 0.7 / 0.3);
        let error = found.estimate.percent_from(ground_truth);
        assert!(error.abs().max_element() < 0.5, "{error}");
        assert!(found.estimate.relative_sd.max_element() < 0.005);
        assert!(found.residual_delta_e < 0.5, "{}", found.residual_delta_e);
        assert_eq!(found.matrix, None, "gains suffice for two equal cameras");
    }

    #[test]
    fn clipped_patches_do_not_bias_the_gain() {
        let found = compare(diagonal(1.6, 0.75, 0.7), diagonal(0.4, 0.25, 0.35), false).unwrap();
        let error = found.estimate.percent_from(DVec3::new(4.0, 3.0, 2.0));
        assert!(error.abs().max_element() < 0.5, "{error}");
        assert!(found.patches[0] < found.patches[1]);
    }

    #[test]
    fn rejects_a_shadowed_patch_as_an_outlier() {
        let response = Response::srgb();
        let scene = photograph(diagonal(0.8, 0.8, 0.8), &response, 1);
        let mut environment = photograph(diagonal(0.4, 0.4, 0.4), &response, 2);
        for y in 0..40 {
            let row = 4 * 320 * y;
            environment.rgba[row..row + 160].fill(90);
        }
        let view = |picture| Photograph {
            picture,
            response: &response,
        };
        let found = match_chart(&chart(), view(&scene), view(&environment), false).unwrap();
        let error = found.estimate.percent_from(DVec3::splat(2.0));
        assert!(error.abs().max_element() < 0.5, "{error}");
        assert_eq!(found.patches, [7; 3]);
    }

    #[test]
    fn fits_a_matrix_to_cameras_with_crosstalk() {
        let crosstalk = DMat3::from_cols(
            DVec3::new(0.30, 0.04, 0.01),
            DVec3::new(0.05, 0.28, 0.04),
            DVec3::new(0.01, 0.05, 0.30),
        );
        let found = compare(diagonal(0.8, 0.8, 0.8), crosstalk, true).unwrap();
        let matrix = found.matrix.expect("a matrix");
        let ground_truth = 0.8 * crosstalk.inverse();
        for (a, b) in matrix
            .to_cols_array()
            .iter()
            .zip(ground_truth.to_cols_array())
        {
            assert!((a - b).abs() < 0.1, "{matrix} is not {ground_truth}");
        }
        assert!(found.residual_delta_e < 1.0);
    }

    #[test]
    fn errors_of_an_unusable_chart_name_the_patch_or_channel() {
        let dark = compare(diagonal(0.8, 0.8, 0.8), diagonal(0.2, 0.002, 0.2), false);
        let text = dark.unwrap_err().to_string();
        assert!(
            text.contains("in green") && text.contains("another exposure"),
            "{text}"
        );
        let response = Response::srgb();
        let picture = photograph(diagonal(0.8, 0.8, 0.8), &response, 1);
        let view = Photograph {
            picture: &picture,
            response: &response,
        };
        for rect in [[300, 0, 40, 40], [0, 0, 0, 4], [u32::MAX, 0, 9, 9]] {
            let mut chart = chart();
            chart.patches.push(rect);
            let text = match_chart(&chart, view, view, false)
                .unwrap_err()
                .to_string();
            assert!(text.contains("chart patch 8"), "{text}");
        }
    }
}
