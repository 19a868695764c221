//! White balance and exposure between the cameras by every available method, and the light on a chart.

use super::camera_data::CameraData;
use super::camera_result::CameraResult;
use super::colours::Colours;
use super::options::RadiometricOptions;
use crate::radiometric::reference::{GREYS, NAMES};
use glam::{DMat3, DVec3};
use penumbra_camera::Response;
use penumbra_white_balance::GainEstimate;
use penumbra_white_balance::chart::{ChartMatch, Patch, Reading, match_patches, read_codes};

/// Gains by every method.
#[derive(Clone, Debug, Default)]
pub(super) struct Gains {
    /// From a chart seen by both cameras.
    pub chart: Option<Result<(GainEstimate, ChartMatch), String>>,
    /// From a grey card seen by both cameras.
    pub grey: Option<Result<GainEstimate, String>>,
    /// From surfaces of the scene that both cameras see, with a description of the data.
    pub scene: Option<(GainEstimate, String)>,
    /// Colour matrix, if the chart requires one.
    pub matrix: Option<DMat3>,
    /// Exposures of both cameras, seconds.
    pub exposures: Option<[f64; 2]>,
    /// The chart's patches in both cameras, for the report.
    pub patches: Vec<(Patch, Patch)>,
}

/// Systematic error of a chart, relative: gloss, and different viewing directions of the cameras.
const CHART_FLOOR: f64 = 0.002;
/// Systematic error of a grey card, relative: larger than a chart's, as it is a single surface.
const GREY_FLOOR: f64 = 0.007;

impl Gains {
    /// Returns the method with the smallest uncertainty and its gains.
    pub fn best(&self) -> Option<(&'static str, GainEstimate)> {
        let worst = |e: &GainEstimate| e.relative_sd.max_element();
        self.all()
            .into_iter()
            .min_by(|a, b| worst(&a.1).total_cmp(&worst(&b.1)))
    }

    /// Returns all methods with a result.
    pub fn all(&self) -> Vec<(&'static str, GainEstimate)> {
        let chart = self
            .chart
            .as_ref()
            .and_then(|c| c.as_ref().ok())
            .map(|c| c.0);
        let grey = self.grey.as_ref().and_then(|g| g.as_ref().ok()).copied();
        let scene = self.scene.as_ref().map(|s| s.0);
        let all = [
            ("chart", chart),
            ("grey card", grey),
            ("shared scene", scene),
        ];
        all.into_iter()
            .filter_map(|(name, e)| Some((name, e?)))
            .collect()
    }
}

/// Computes the gains between the cameras by every available method.
pub(super) fn between(
    data: &[CameraData; 2],
    cameras: &[CameraResult; 2],
    options: &RadiometricOptions,
    scene: Option<&(GainEstimate, String)>,
) -> Gains {
    let responses = [0, 1].map(|i| {
        let known = cameras[i].response.as_ref();
        known.map_or(&options.responses[i], |r| &r.0)
    });
    let mut gains = Gains {
        scene: scene.cloned(),
        ..Gains::default()
    };
    if data.iter().all(|camera| !camera.charts.is_empty()) {
        match_charts(&mut gains, data, responses, options.matrix);
    }
    if let [Some(a), Some(b)] = [&data[0].grey, &data[1].grey] {
        gains.grey = Some(grey_card_gains(a, b, responses));
    }
    let exposure = |camera: &CameraData| match gains.chart {
        Some(Ok(_)) => camera.charts.first().and_then(|c| c.exposure),
        _ => camera.exposure,
    };
    gains.exposures = exposure(&data[0])
        .zip(exposure(&data[1]))
        .map(|(a, b)| [a, b]);
    gains
}

/// Matches the charts of both cameras in the pictures nearest in time.
fn match_charts(
    gains: &mut Gains,
    data: &[CameraData; 2],
    responses: [&Response; 2],
    matrix: bool,
) {
    let read = [0, 1].map(|i| data[i].patches(responses[i]));
    let mut found: Vec<ChartMatch> = Vec::new();
    let mut error = None;
    for (i, seen) in data[0].charts.iter().enumerate() {
        let apart = |j: &usize| (data[1].charts[*j].seconds - seen.seconds).abs();
        let nearest = (0..data[1].charts.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
        let Some(j) = nearest else { continue };
        let pairs: Vec<(Patch, Patch)> = read[0][i]
            .iter()
            .copied()
            .zip(read[1][j].iter().copied())
            .collect();
        match match_patches(&pairs, matrix) {
            Ok(matched) => {
                if found.is_empty() {
                    gains.patches = pairs;
                }
                found.push(matched);
            }
            Err(e) => error = Some(e.to_string()),
        }
    }
    gains.chart = match (found.first().cloned(), error) {
        (Some(first), _) => {
            gains.matrix = first.matrix;
            Some(Ok((combined(&found), first)))
        }
        (None, Some(error)) => Some(Err(error)),
        (None, None) => None,
    };
}

/// Returns the mean gains of several pictures, with their scatter added to the uncertainty.
fn combined(found: &[ChartMatch]) -> GainEstimate {
    let n = found.len() as f64;
    let mean = found.iter().map(|m| m.estimate.gains.ln()).sum::<DVec3>() / n;
    let square = |m: &ChartMatch| (m.estimate.gains.ln() - mean).powf(2.0);
    let scatter = found.iter().map(square).sum::<DVec3>() / (n * (n - 1.0).max(1.0));
    let own = found
        .iter()
        .map(|m| m.estimate.relative_sd.powf(2.0))
        .sum::<DVec3>()
        / n;
    let variance = own + scatter + DVec3::splat(CHART_FLOOR * CHART_FLOOR);
    GainEstimate {
        gains: mean.exp(),
        relative_sd: variance.powf(0.5),
    }
}

/// Computes the gains from a grey card's codes in both cameras.
fn grey_card_gains(
    a: &[[u8; 3]],
    b: &[[u8; 3]],
    responses: [&Response; 2],
) -> Result<GainEstimate, String> {
    let read = |codes: &[[u8; 3]], c: usize, response| {
        let codes: Vec<u8> = codes.iter().map(|rgb| rgb[c]).collect();
        read_codes(&codes, response)
    };
    let mut estimate = GainEstimate {
        gains: DVec3::ONE,
        relative_sd: DVec3::ZERO,
    };
    for (c, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let (Some(scene), Some(environment)) = (read(a, c, responses[0]), read(b, c, responses[1]))
        else {
            return Err(format!(
                "the grey card is clipped or too dark in {name}; expose it to the middle of \
                     the range"
            ));
        };
        let relative = |r: &Reading| r.variance_of_mean / (r.mean * r.mean);
        // Uneven light on the card increases the variance and biases the mean.
        let uneven = |r: &Reading| 0.05 * 0.05 * r.variance / (r.mean * r.mean);
        let variance = [scene, environment]
            .iter()
            .map(|r| relative(r) + uneven(r))
            .sum::<f64>();
        estimate.gains[c] = scene.mean / environment.mean;
        estimate.relative_sd[c] = (variance + GREY_FLOOR * GREY_FLOOR).sqrt();
    }
    Ok(estimate)
}

/// Evaluation of a chart in one camera: the camera's tone and colours, and the light.
#[derive(Clone, Debug, Default)]
pub(super) struct ChartEvaluation {
    /// Contrast of the grey row relative to the reference, and its standard error.
    pub contrast: Option<(f64, f64)>,
    /// Change of brightness over the chart, relative.
    pub uneven: f64,
    /// Change of the light's colour over the chart, relative, and its standard error, which contains
    /// the chart's deviations from the reference.
    pub mixed: (f64, f64),
    /// RMS residual of the patches after gains and a linear gradient of light, relative.
    pub residual: f64,
    /// Colour errors.
    pub colours: Option<Colours>,
    /// Names of patches that are clipped or too dark.
    pub lost: Vec<&'static str>,
}

/// Evaluates the patches of a chart in one camera.
pub(super) fn evaluate(patches: &[Patch], options: &RadiometricOptions) -> ChartEvaluation {
    let reference = options.edition.linear();
    let lost = |(_, p): &(usize, &Patch)| p.0.iter().any(Option::is_none);
    let mut evaluation = ChartEvaluation {
        lost: patches
            .iter()
            .enumerate()
            .filter(lost)
            .map(|(i, _)| NAMES[i])
            .collect(),
        colours: Colours::new(patches, &reference),
        ..ChartEvaluation::default()
    };
    let slopes = [0, 1, 2].map(|c| slope(patches, &reference, c));
    if let [Some(r), Some(g), Some(b)] = slopes {
        evaluation.uneven = (5.0 * g.0[1]).hypot(3.0 * g.0[2]);
        let apart = |s: &Slope| (5.0 * (s.0[1] - g.0[1])).hypot(3.0 * (s.0[2] - g.0[2]));
        let error = |s: &Slope| std::f64::consts::SQRT_2 * (5.0 * s.2[1]).hypot(3.0 * s.2[2]);
        let [red, blue] = [(apart(&r), error(&r)), (apart(&b), error(&b))];
        evaluation.mixed = if red.0 > blue.0 { red } else { blue };
        evaluation.residual = ((r.1.powi(2) + g.1.powi(2) + b.1.powi(2)) / 3.0).sqrt();
        evaluation.contrast = contrast(patches, &reference, &g.0);
    }
    evaluation
}

/// A fitted gradient of the light: a, b, c; root mean square of the residuals; standard errors of a,
/// b, c.
type Slope = ([f64; 3], f64, [f64; 3]);

/// Fits ln (measured / reference) = a + b column + c row of one channel by least squares, to the
/// patches that are bright enough for stray light to be negligible.
fn slope(patches: &[Patch], reference: &[DVec3; 24], c: usize) -> Option<Slope> {
    let mut normal = penumbra_numerics::NormalEquations::new(3);
    let mut rows = Vec::new();
    for (i, patch) in patches.iter().enumerate() {
        let Some(reading) = patch.0[c].filter(|_| reference[i][c] > 0.08) else {
            continue;
        };
        let row = [1.0, (i % 6) as f64 - 2.5, (i / 6) as f64 - 1.5];
        let value = (reading.mean / reference[i][c]).ln();
        rows.push((row, value));
        // The negative gradient at zero is the right-hand side.
        normal.add(-value, &row, 1.0);
    }
    if rows.len() < 8 {
        return None;
    }
    let right: Vec<f64> = normal.gradient.iter().map(|g| -g).collect();
    let factor = normal.hessian.cholesky()?;
    let (x, inverse) = (factor.solve(&right), factor.inverse());
    let residual =
        |(row, value): &([f64; 3], f64)| value - (0..3).map(|k| row[k] * x[k]).sum::<f64>();
    let rms = penumbra_numerics::root_mean_square(rows.iter().map(residual));
    let errors = [0, 1, 2].map(|k| rms * inverse[(k, k)].sqrt());
    Some(([x[0], x[1], x[2]], rms, errors))
}

/// Returns the slope of ln measured over ln reference along the grey row, corrected for the gradient of
/// the light, and its standard error.
fn contrast(patches: &[Patch], reference: &[DVec3; 24], light: &[f64; 3]) -> Option<(f64, f64)> {
    let points: Vec<(f64, f64)> = GREYS
        .filter_map(|i| {
            let reading = patches.get(i)?.0[1]?;
            let value = reading.mean.ln() - light[1] * ((i % 6) as f64 - 2.5);
            Some((reference[i].y.ln(), value))
        })
        .collect();
    if points.len() < 4 {
        return None;
    }
    let n = points.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / n;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let (sxx, sxy) = points.iter().fold((0.0, 0.0), |(xx, xy), p| {
        (xx + (p.0 - mx).powi(2), xy + (p.0 - mx) * (p.1 - my))
    });
    let slope = sxy / sxx;
    let squares = points
        .iter()
        .map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2));
    let error = (squares.sum::<f64>() / (n - 2.0) / sxx).sqrt();
    Some((slope, error.hypot(0.01)))
}
