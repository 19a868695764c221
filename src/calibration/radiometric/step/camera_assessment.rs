//! Assessment of each camera: light and colours on a chart, tone curve, noise, vignetting.

use super::camera_data::CameraData;
use super::camera_result::{CAMERAS, CONFIRMED, CameraResult, is_significant};
use super::colours::Colours;
use super::gains::{ChartEvaluation, evaluate};
use super::options::RadiometricOptions;
use crate::radiometric::curve::{Curve, NoCurve};
use crate::summary::Summary;
use penumbra_rig_model::Grade;

/// Maximum change of brightness over the chart, relative.
const MAX_UNEVENNESS: f64 = 0.35;
/// Maximum change of the light's colour over the chart, relative.
const MAX_COLOUR_CHANGE: f64 = 0.12;
/// Maximum error of the grey row's contrast.
const MAX_CONTRAST_ERROR: f64 = 0.06;

/// Assesses light, colours and contrast of a camera's chart.
pub(super) fn assess_chart(
    summary: &mut Summary,
    i: usize,
    data: &CameraData,
    camera: &CameraResult,
    options: &RadiometricOptions,
) {
    let name = CAMERAS[i].name();
    let Some(seen) = data.charts.first() else {
        return;
    };
    let Some((response, _)) = &camera.response else {
        return;
    };
    if data.charts.iter().any(|c| c.charts > 1) {
        summary.finding(
            Grade::Usable,
            format!(
                "the {name} camera sees {} charts; only the largest was read: cover the others",
                seen.charts
            ),
        );
    }
    let patches = data.patches(response);
    let Some(first) = patches.first() else { return };
    let evaluation = evaluate(first, options);
    assess_light(summary, name, &evaluation);
    assess_colours(summary, name, &evaluation, camera);
}

fn assess_light(summary: &mut Summary, name: &str, evaluation: &ChartEvaluation) {
    if evaluation.uneven > MAX_UNEVENNESS {
        summary.finding(
            Grade::Usable,
            format!(
                "the light changes by {:.0} % over the chart in the {name} camera's picture; \
                 light it evenly, without shadows",
                100.0 * evaluation.uneven
            ),
        );
    }
    let (mixed, sigma) = evaluation.mixed;
    if mixed > MAX_COLOUR_CHANGE && mixed > 4.0 * sigma {
        summary.finding(
            Grade::Usable,
            format!(
                "the light's colour changes by {:.0} % over the chart in the {name} \
                 camera's picture (mixed light); switch one kind of lamp off",
                100.0 * mixed
            ),
        );
    }
    let clipped = ["white 9.5", "neutral 8"]
        .iter()
        .filter(|n| evaluation.lost.contains(n))
        .count();
    if clipped > 0 && evaluation.lost.len() > 8 {
        summary.finding(
            Grade::Usable,
            format!(
                "{} of 24 patches are clipped or too dark in the {name} camera's picture; \
                 correct its exposure",
                evaluation.lost.len()
            ),
        );
    }
}

fn assess_colours(
    summary: &mut Summary,
    name: &str,
    evaluation: &ChartEvaluation,
    camera: &CameraResult,
) {
    if let Some(colours) = &evaluation.colours {
        summary.lines.push(format!(
            "{name} camera: colour error ΔE2000 {:.1} as shown, {:.1} white balanced, {:.1} with a \
             3×3 matrix",
            Colours::mean(&colours.as_shown),
            Colours::mean(&colours.balanced),
            Colours::mean(&colours.matrixed)
        ));
    }
    if let Some((contrast, sigma)) = evaluation.contrast {
        summary.lines.push(format!(
            "{name} camera: contrast of the grey patches {contrast:.3} ± {sigma:.3} of the \
             reference, residual of the patches {:.1} %",
            100.0 * evaluation.residual
        ));
        let error = (contrast - 1.0).abs();
        if error > MAX_CONTRAST_ERROR && error > 3.0 * sigma {
            summary.finding(
                Grade::Usable,
                format!(
                    "the {name} camera's tone curve ({}) does not reproduce the grey patches \
                     (contrast {contrast:.2}); record an exposure series",
                    camera.response.as_ref().map_or("", |r| &r.1)
                ),
            );
        }
    }
}

/// Assesses tone curve, noise and vignetting of a camera.
pub(super) fn assess_camera(summary: &mut Summary, i: usize, camera: &CameraResult) {
    let name = CAMERAS[i].name();
    match &camera.curve {
        Some(Ok(curve)) => assess_curve(summary, name, curve, camera),
        // A single exposure is not a series: no curve was requested.
        Some(Err(NoCurve::OneExposure)) | None => {}
        Some(Err(error)) => summary.finding(
            Grade::Usable,
            format!("{name} camera's tone curve: {error}"),
        ),
    }
    if let Some(noise) = &camera.noise {
        let percent = |variance: f64| 100.0 * variance.max(0.0).sqrt();
        let hidden =
            noise.read[1] <= noise.read_sigma[1] && noise.shot[1] <= 2.0 * noise.shot_sigma[1];
        summary.lines.push(if hidden {
            format!("{name} camera: noise is below the quantisation of its pictures")
        } else {
            format!(
                "{name} camera: noise {:.2} % of white at black, {:.2} % at linear 0.2, green; \
                 read {:.2e} ± {:.1e}, shot {:.2e} ± {:.1e}",
                percent(noise.read[1]),
                percent(noise.read[1] + 0.2 * noise.shot[1]),
                noise.read[1],
                noise.read_sigma[1],
                noise.shot[1],
                noise.shot_sigma[1]
            )
        });
    }
    if let Some((fit, flat)) = &camera.vignetting {
        let (edge, sigma) = (
            100.0 * (fit.edge_brightness() - 1.0),
            100.0 * fit.edge_sigma,
        );
        summary.lines.push(match (is_significant(fit), flat) {
            (true, true) => {
                format!("{name} camera: brightness at the edge {edge:+.1} ± {sigma:.1} %")
            }
            (true, false) => format!(
                "{name} camera: brightness at the edge {edge:+.1} ± {sigma:.1} % from its motion; \
                 not used, photograph a white wall instead (--{name}-flat)"
            ),
            (false, _) => format!(
                "{name} camera: no significant vignetting ({edge:+.1} ± {sigma:.1} % at the edge)"
            ),
        });
    }
}

fn assess_curve(summary: &mut Summary, name: &str, curve: &Curve, camera: &CameraResult) {
    let description = camera.response.as_ref().map_or("", |r| &r.1);
    let sigma = 100.0 * curve.largest_sigma();
    summary.lines.push(format!(
        "{name} camera: tone curve {description}; standard error {sigma:.1} % over codes {:.0} to \
         {:.0}, {} samples, residual {:.1} %",
        curve.code_range.0,
        curve.code_range.1,
        curve.used,
        100.0 * curve.rms
    ));
    if !camera.replaces && description != CONFIRMED {
        summary.finding(
            Grade::Usable,
            format!(
                "the {name} camera's tone curve has an error of {sigma:.0} % and is not used; \
                 vary the exposure in steps of one or two stops"
            ),
        );
    }
    if camera.replaces {
        summary.hints.push(format!(
            "the {name} camera's tone curve differs from rig.json; gains found with the old one \
             are invalid"
        ));
    }
}
