//! White balance and exposure between the cameras, each way that there is.

use super::colours::Colours;
use super::eye::EyeState;
use super::{CameraFound, Options};
use crate::radiometric::reference::{GREYS, NAMES};
use glam::{DMat3, DVec3};
use penumbra_camera::Response;
use penumbra_white_balance::GainEstimate;
use penumbra_white_balance::chart::{ChartMatch, Patch, Reading, match_patches, read_codes};

/// Every way's answer.
#[derive(Clone, Debug, Default)]
pub(super) struct Gains {
    /// A chart seen by both.
    pub chart: Option<Result<(GainEstimate, ChartMatch), String>>,
    /// A grey card seen by both.
    pub grey: Option<Result<GainEstimate, String>>,
    /// What both see anyway, and from how much.
    pub scene: Option<(GainEstimate, String)>,
    /// Where the chart calls for it.
    pub matrix: Option<DMat3>,
    /// Of both cameras then, seconds.
    pub exposures: Option<[f64; 2]>,
    /// The chart's patches in both, for the report.
    pub patches: Vec<(Patch, Patch)>,
}

/// What the eye of one chart does not tell: gloss, and light from another side as the cameras
/// look from different places; relative.
const CHART_FLOOR: f64 = 0.002;
/// The same of a card, which is one surface alone.
const GREY_FLOOR: f64 = 0.007;

impl Gains {
    /// What goes into the file: the surest way.
    pub fn best(&self) -> Option<(&'static str, GainEstimate)> {
        let worst = |e: &GainEstimate| e.relative_sd.max_element();
        self.all()
            .into_iter()
            .min_by(|a, b| worst(&a.1).total_cmp(&worst(&b.1)))
    }

    /// All that have an answer.
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
            ("what both see", scene),
        ];
        all.into_iter()
            .filter_map(|(name, e)| Some((name, e?)))
            .collect()
    }
}

pub(super) fn between(
    eyes: &[EyeState; 2],
    cameras: &[CameraFound; 2],
    options: &Options,
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
    if eyes.iter().all(|eye| !eye.charts.is_empty()) {
        chart(&mut gains, eyes, responses, options.matrix);
    }
    if let [Some(a), Some(b)] = [&eyes[0].grey, &eyes[1].grey] {
        gains.grey = Some(card(a, b, responses));
    }
    let exposure = |eye: &EyeState| match gains.chart {
        Some(Ok(_)) => eye.charts.first().and_then(|c| c.exposure),
        _ => eye.exposure,
    };
    gains.exposures = exposure(&eyes[0])
        .zip(exposure(&eyes[1]))
        .map(|(a, b)| [a, b]);
    gains
}

/// Pictures nearest in time are compared; several agree or say how far they do not.
fn chart(gains: &mut Gains, eyes: &[EyeState; 2], responses: [&Response; 2], matrix: bool) {
    let read = [0, 1].map(|i| eyes[i].patches(responses[i]));
    let mut found: Vec<ChartMatch> = Vec::new();
    let mut error = None;
    for (i, seen) in eyes[0].charts.iter().enumerate() {
        let apart = |j: &usize| (eyes[1].charts[*j].seconds - seen.seconds).abs();
        let nearest = (0..eyes[1].charts.len()).min_by(|a, b| apart(a).total_cmp(&apart(b)));
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
            Some(Ok((together(&found), first)))
        }
        (None, Some(error)) => Some(Err(error)),
        (None, None) => None,
    };
}

/// Mean of several pictures' gains; what they scatter is added to what each allows.
fn together(found: &[ChartMatch]) -> GainEstimate {
    let n = found.len() as f64;
    let mean = found.iter().map(|m| m.estimate.gains.ln()).sum::<DVec3>() / n;
    let off = |m: &ChartMatch| (m.estimate.gains.ln() - mean).powf(2.0);
    let scatter = found.iter().map(off).sum::<DVec3>() / (n * (n - 1.0).max(1.0));
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

fn card(a: &[[u8; 3]], b: &[[u8; 3]], responses: [&Response; 2]) -> Result<GainEstimate, String> {
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
        // Uneven light over a card shows as spread and shifts its mean.
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

/// What one camera's chart says of that camera and of the light.
#[derive(Clone, Debug, Default)]
pub(super) struct ChartSays {
    /// Contrast of the grey row as the camera shows it over what it is, and its error.
    pub contrast: Option<(f64, f64)>,
    /// How much brighter one end of the chart is than the other, relative.
    pub uneven: f64,
    /// How much the light's colour changes over the chart, relative, and its error: no chart's
    /// colours are quite the reference's.
    pub mixed: (f64, f64),
    /// What the patches leave when gains and an even slope of light are taken off, relative.
    pub rest: f64,
    /// How true the colours are.
    pub colours: Option<Colours>,
    /// Names of patches that are clipped or too dark.
    pub lost: Vec<&'static str>,
}

pub(super) fn says(patches: &[Patch], options: &Options) -> ChartSays {
    let reference = options.edition.linear();
    let lost = |(_, p): &(usize, &Patch)| p.0.iter().any(Option::is_none);
    let mut says = ChartSays {
        lost: patches
            .iter()
            .enumerate()
            .filter(lost)
            .map(|(i, _)| NAMES[i])
            .collect(),
        colours: Colours::of(patches, &reference),
        ..ChartSays::default()
    };
    let slopes = [0, 1, 2].map(|c| slope(patches, &reference, c));
    if let [Some(r), Some(g), Some(b)] = slopes {
        says.uneven = (5.0 * g.0[1]).hypot(3.0 * g.0[2]);
        let apart = |s: &Slope| (5.0 * (s.0[1] - g.0[1])).hypot(3.0 * (s.0[2] - g.0[2]));
        let error = |s: &Slope| std::f64::consts::SQRT_2 * (5.0 * s.2[1]).hypot(3.0 * s.2[2]);
        let [red, blue] = [(apart(&r), error(&r)), (apart(&b), error(&b))];
        says.mixed = if red.0 > blue.0 { red } else { blue };
        says.rest = ((r.1.powi(2) + g.1.powi(2) + b.1.powi(2)) / 3.0).sqrt();
        says.contrast = contrast(patches, &reference, &g.0);
    }
    says
}

/// a, b, c; root mean square of what is left; standard errors of a, b, c.
type Slope = ([f64; 3], f64, [f64; 3]);

/// ln (measured / reference) = a + b column + c row of one channel by least squares; of the patches
/// that are bright enough for stray light not to count.
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
        // The step downhill from zero solves it.
        normal.add(-value, &row, 1.0);
    }
    if rows.len() < 8 {
        return None;
    }
    let right: Vec<f64> = normal.gradient.iter().map(|g| -g).collect();
    let factor = normal.hessian.cholesky()?;
    let (x, inverse) = (factor.solve(&right), factor.inverse());
    let left = |(row, value): &([f64; 3], f64)| value - (0..3).map(|k| row[k] * x[k]).sum::<f64>();
    let rms = penumbra_numerics::root_mean_square(rows.iter().map(left));
    let errors = [0, 1, 2].map(|k| rms * inverse[(k, k)].sqrt());
    Some(([x[0], x[1], x[2]], rms, errors))
}

/// Slope of ln measured over ln reference along the grey row, the light's own slope taken off.
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
    let left = points
        .iter()
        .map(|p| (p.1 - my - slope * (p.0 - mx)).powi(2));
    let error = (left.sum::<f64>() / (n - 2.0) / sxx).sqrt();
    Some((slope, error.hypot(0.01)))
}
