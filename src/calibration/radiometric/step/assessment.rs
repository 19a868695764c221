//! The step's progress, and its assessment with advice.

use super::camera_assessment::{assess_camera, assess_chart};
use super::camera_data::CameraData;
use super::camera_result::{CAMERAS, CameraResult};
use super::gains::Gains;
use super::options::RadiometricOptions;
use crate::step::{Finished, Progress};
use crate::summary::Summary;
use glam::DVec3;
use penumbra_rig_model::Grade;

/// Maximum relative standard deviation of good gains.
const MAX_GOOD_SIGMA: f64 = 0.01;
/// Maximum relative standard deviation of usable gains.
const MAX_USABLE_SIGMA: f64 = 0.05;
/// Maximum relative difference of two methods that is consistent regardless of their errors.
const MAX_DIFFERENCE: f64 = 0.03;

/// Returns the step's progress, with a hint for the next action.
pub(super) fn progress(data: &[CameraData; 2]) -> Progress {
    let [scene, environment] = [0, 1].map(|i| data[i].charts.len());
    let series: usize = data.iter().map(|e| e.series.series).sum();
    let noise: usize = data.iter().map(|e| e.noise.pairs).sum();
    let hint = match (scene, environment) {
        (0, 0) => "hold a ColorChecker in view of both cameras",
        (0, _) => "rotate the chart until all of it is in the scene camera's picture",
        (_, 0) => "rotate the chart until all of it is in the environment camera's picture",
        _ if noise < 3 => "keep the cameras still for a moment",
        _ => "",
    };
    let parts = [scene.min(1), environment.min(1), usize::from(noise >= 3)];
    let last = usize::from(data[0].overlay_points.is_empty());
    Progress {
        share: parts.iter().sum::<usize>() as f64 / 3.0,
        message: format!(
            "chart in {scene} and {environment} pictures, {series} exposure series, {noise} \
                 static pairs"
        ),
        hint: hint.to_owned(),
        overlay_points: data[last].overlay_points.clone(),
        camera: (!data[last].overlay_points.is_empty()).then_some(CAMERAS[last]),
    }
}

/// Grades the results and describes them.
pub(super) fn assess(
    data: &[CameraData; 2],
    cameras: &[CameraResult; 2],
    gains: &Gains,
    options: &RadiometricOptions,
) -> Finished {
    let mut summary = Summary::default();
    check_swapped(&mut summary, data, options);
    assess_gains(&mut summary, data, gains);
    for i in 0..2 {
        assess_chart(&mut summary, i, &data[i], &cameras[i], options);
        assess_camera(&mut summary, i, &cameras[i]);
        if data[i].moved > 2 && data[i].noise.pairs == 0 {
            summary.hints.push(format!(
                "keep the {} camera still for a moment: its noise was not measured",
                CAMERAS[i].name()
            ));
        }
    }
    check_results(&mut summary, data, cameras, gains);
    summary.finished()
}

/// Refuses a calibration without any result.
fn check_results(
    summary: &mut Summary,
    data: &[CameraData; 2],
    cameras: &[CameraResult; 2],
    gains: &Gains,
) {
    let has_chart = data.iter().any(|camera| !camera.charts.is_empty());
    if has_chart || gains.best().is_some() || cameras.iter().any(CameraResult::has_result) {
        return;
    }
    let is_explained = !summary.findings.is_empty();
    for finding in &mut summary.findings {
        finding.0 = Grade::Refused;
    }
    if !is_explained {
        summary.finding(
            Grade::Refused,
            "there is nothing to calibrate from; show both cameras a ColorChecker, or provide \
             pictures of an exposure series",
        );
    }
}

fn check_swapped(summary: &mut Summary, data: &[CameraData; 2], options: &RadiometricOptions) {
    let [Some(scene), Some(environment)] = options.sizes else {
        return;
    };
    let sizes = [data[0].size, data[1].size];
    if scene != environment && sizes == [environment, scene] {
        summary.finding(
            Grade::Refused,
            format!(
                "the cameras are swapped: the scene camera's pictures are {}×{}, which is the \
                 environment camera's size; exchange them",
                sizes[0].0, sizes[0].1
            ),
        );
    }
}

fn assess_gains(summary: &mut Summary, data: &[CameraData; 2], gains: &Gains) {
    for (name, estimate) in gains.all() {
        let sd = 100.0 * estimate.relative_sd;
        summary.lines.push(format!(
            "scene = ({:.4}, {:.4}, {:.4}) × environment by {name}, ± ({:.2}, {:.2}, {:.2}) %",
            estimate.gains.x, estimate.gains.y, estimate.gains.z, sd.x, sd.y, sd.z
        ));
    }
    if let Some(Ok((_, matched))) = &gains.chart {
        let used = matched.patches;
        summary.lines.push(format!(
            "chart: {}, {}, {} of 24 patches in red, green, blue; residual ΔE2000 {:.2} (worst \
                 {:.2}){}",
            used[0],
            used[1],
            used[2],
            matched.residual_delta_e,
            matched.worst_delta_e,
            if gains.matrix.is_some() {
                "; a 3×3 matrix fits better and is included in the file"
            } else {
                ""
            }
        ));
    }
    for error in [
        gains.chart.as_ref().and_then(|c| c.as_ref().err()),
        gains.grey.as_ref().and_then(|g| g.as_ref().err()),
    ]
    .into_iter()
    .flatten()
    {
        summary.finding(Grade::Refused, error.clone());
    }
    missing_charts(summary, data, gains);
    let Some((_, best)) = gains.best() else {
        return;
    };
    let worst = best.relative_sd.max_element();
    if worst > MAX_USABLE_SIGMA {
        summary.finding(
            Grade::Refused,
            format!(
                "the gains have a standard deviation of {:.0} %; light the chart better",
                100.0 * worst
            ),
        );
    } else if worst > MAX_GOOD_SIGMA {
        summary.finding(
            Grade::Usable,
            format!(
                "the gains have a standard deviation of {:.1} %; a well-lit chart yields 0.5 %",
                100.0 * worst
            ),
        );
    }
    check_consistency(summary, gains);
}

fn missing_charts(summary: &mut Summary, data: &[CameraData; 2], gains: &Gains) {
    if gains.best().is_some() {
        return;
    }
    let seen = [0, 1].map(|i| (data[i].pictures > 0, !data[i].charts.is_empty()));
    let text = match seen {
        [(true, false), (true, false)] => {
            "neither camera sees a chart; show all 24 patches, each at least 8 pixels wide"
        }
        [(true, false), (_, true)] => {
            "the scene camera sees no chart; move it until all 24 patches are in its picture"
        }
        [(_, true), (true, false)] => {
            "the environment camera sees no chart; move it until all 24 patches are in its picture"
        }
        _ => return,
    };
    // An exposure series alone is a valid input.
    let series = data.iter().any(|e| e.series.series > 0);
    let grade = if series {
        Grade::Usable
    } else {
        Grade::Refused
    };
    summary.finding(grade, text);
}

/// Compares the other methods with the best one.
fn check_consistency(summary: &mut Summary, gains: &Gains) {
    let all = gains.all();
    let Some((best, estimate)) = gains.best() else {
        return;
    };
    for (name, other) in all.iter().filter(|(name, _)| *name != best) {
        let difference: DVec3 = (other.gains / estimate.gains).ln().abs();
        let variance = other.relative_sd.powf(2.0) + estimate.relative_sd.powf(2.0);
        let inconsistent = (0..3)
            .any(|c| difference[c] > MAX_DIFFERENCE && difference[c] > 3.0 * variance[c].sqrt());
        let text = format!(
            "{best} and {name} differ by {:.1} %, {:.1} %, {:.1} %",
            100.0 * difference.x,
            100.0 * difference.y,
            100.0 * difference.z
        );
        if inconsistent {
            summary.finding(
                Grade::Usable,
                format!(
                    "{text}, more than their errors; place the chart within the scene, in \
                     the same light"
                ),
            );
        } else {
            summary.lines.push(format!("{text}, within their errors"));
        }
    }
}
