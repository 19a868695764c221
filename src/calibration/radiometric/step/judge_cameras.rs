//! What is told of each camera.

use super::colours::Colours;
use super::eye::EyeState;
use super::gains::says;
use super::judge::{Verdict, falls_off};
use super::{CameraFound, EYES, Options};
use crate::radiometric::curve::{Curve, NoCurve};
use penumbra_rig_model::Grade;

/// Slope of light over the chart from which it is uneven, and mixed; what may be left of patches.
const UNEVEN: f64 = 0.35;
const MIXED: f64 = 0.12;
/// Contrast of the grey row may differ from what it is by so much.
const CONTRAST: f64 = 0.06;

pub(super) fn judge_charts(
    verdict: &mut Verdict,
    i: usize,
    eye: &EyeState,
    camera: &CameraFound,
    options: &Options,
) {
    let name = EYES[i].name();
    let Some(seen) = eye.charts.first() else {
        return;
    };
    let Some((response, _)) = &camera.response else {
        return;
    };
    if eye.charts.iter().any(|c| c.charts > 1) {
        verdict.find(
            Grade::Usable,
            format!(
                "the {name} camera sees {} charts; the largest was read, cover the others",
                seen.charts
            ),
        );
    }
    let patches = eye.patches(response);
    let Some(first) = patches.first() else { return };
    let says = says(first, options);
    if says.uneven > UNEVEN {
        verdict.find(
            Grade::Usable,
            format!(
                "light changes by {:.0} % over the chart in the {name} camera's picture; \
                 light it evenly, without a shadow on it",
                100.0 * says.uneven
            ),
        );
    }
    let (mixed, sigma) = says.mixed;
    if mixed > MIXED && mixed > 4.0 * sigma {
        verdict.find(
            Grade::Usable,
            format!(
                "the light's colour changes by {:.0} % over the chart in the {name} \
                 camera's picture: mixed light; switch one kind of lamp off",
                100.0 * mixed
            ),
        );
    }
    let clipped = ["white 9.5", "neutral 8"]
        .iter()
        .filter(|n| says.lost.contains(n))
        .count();
    if clipped > 0 && says.lost.len() > 8 {
        verdict.find(
            Grade::Usable,
            format!(
                "{} of 24 patches are clipped or too dark in the {name} camera's picture; \
                 correct its exposure",
                says.lost.len()
            ),
        );
    }
    if let Some(colours) = &says.colours {
        verdict.lines.push(format!(
            "{name} camera: colours ΔE2000 {:.1} from what they are, {:.1} white balanced, \
             {:.1} with a 3×3 matrix",
            Colours::mean(&colours.as_shown),
            Colours::mean(&colours.balanced),
            Colours::mean(&colours.matrixed)
        ));
    }
    if let Some((contrast, sigma)) = says.contrast {
        verdict.lines.push(format!(
            "{name} camera: grey patches' contrast {contrast:.3} ± {sigma:.3} of what it is, \
                 patches {:.1} % about their colours",
            100.0 * says.rest
        ));
        let off = (contrast - 1.0).abs();
        if off > CONTRAST && off > 3.0 * sigma {
            verdict.find(
                Grade::Usable,
                format!(
                    "the {name} camera's tone curve ({}) does not show greys as they are \
                     (contrast {contrast:.2}); record an exposure series",
                    camera.response.as_ref().map_or("", |r| &r.1)
                ),
            );
        }
    }
}

pub(super) fn judge_camera(verdict: &mut Verdict, i: usize, camera: &CameraFound) {
    let name = EYES[i].name();
    match &camera.curve {
        Some(Ok(curve)) => judge_curve(verdict, name, curve, camera),
        // One exposure is no series: nobody asked for a curve.
        Some(Err(NoCurve::OneExposure)) | None => {}
        Some(Err(error)) => verdict.find(
            Grade::Usable,
            format!("{name} camera's tone curve: {error}"),
        ),
    }
    if let Some(noise) = &camera.noise {
        let percent = |variance: f64| 100.0 * variance.max(0.0).sqrt();
        let hidden =
            noise.read[1] <= noise.read_sigma[1] && noise.shot[1] <= 2.0 * noise.shot_sigma[1];
        verdict.lines.push(if hidden {
            format!("{name} camera: noise is below what its coded pictures show")
        } else {
            format!(
                "{name} camera: noise {:.2} % of white in the dark, {:.2} % in the middle (linear \
                 0.2), green; read {:.2e} ± {:.1e}, shot {:.2e} ± {:.1e}",
                percent(noise.read[1]),
                percent(noise.read[1] + 0.2 * noise.shot[1]),
                noise.read[1],
                noise.read_sigma[1],
                noise.shot[1],
                noise.shot_sigma[1]
            )
        });
    }
    if let Some((fit, flat)) = &camera.fall_off {
        let (edge, sigma) = (100.0 * (fit.edge() - 1.0), 100.0 * fit.edge_sigma);
        verdict.lines.push(match (falls_off(fit), flat) {
            (true, true) => {
                format!("{name} camera: brightness at the edge {edge:+.1} ± {sigma:.1} %")
            }
            (true, false) => format!(
                "{name} camera: brightness at the edge {edge:+.1} ± {sigma:.1} % by what it saw while \
                 it moved; not taken over, photograph a white wall for that (--{name}-flat)"
            ),
            (false, _) => format!(
                "{name} camera: no fall-off towards the edge ({edge:+.1} ± {sigma:.1} %)"
            ),
        });
    }
}

fn judge_curve(verdict: &mut Verdict, name: &str, curve: &Curve, camera: &CameraFound) {
    let called = camera.response.as_ref().map_or("", |r| &r.1);
    let sigma = 100.0 * curve.largest_sigma();
    verdict.lines.push(format!(
        "{name} camera: tone curve {called}; measured to {sigma:.1} % over codes {:.0} to \
             {:.0}, {} places, {:.1} % left",
        curve.seen.0,
        curve.seen.1,
        curve.used,
        100.0 * curve.rms
    ));
    if !camera.replaces && !called.contains("confirmed") {
        verdict.find(
            Grade::Usable,
            format!(
                "the {name} camera's tone curve is measured to {sigma:.0} % only and not \
                 taken over; step the exposure by one or two stops"
            ),
        );
    }
    if camera.replaces {
        verdict.hints.push(format!(
            "the {name} camera's tone curve is not the one in rig.json; gains found with the \
                 old one are void"
        ));
    }
}
