//! Is it good enough, why not, and what to do about it.

use super::eye::EyeState;
use super::gains::Gains;
use super::judge_cameras;
use super::{CameraFound, EYES, Options};
use crate::radiometric::curve::{Curve, NoCurve};
use crate::radiometric::vignetting::Fit;
use crate::step::{Finished, Progress};
use glam::DVec3;
use penumbra_camera::Response;
use penumbra_rig_model::Grade;

/// Gains worse known than this are not good, and not usable; relative.
const GOOD_GAIN: f64 = 0.01;
const USABLE_GAIN: f64 = 0.05;
/// A curve whose error is larger is no better than what is known, and one that is good; relative.
const USABLE_CURVE: f64 = 0.12;
/// A named curve within so many standard errors, and this near, is taken for the measured one.
const SAME_SIGMAS: f64 = 3.0;
const SAME_CURVE: f64 = 0.03;
/// Two ways differ where they are this far apart, relative, and beyond their errors.
const AGREE: f64 = 0.03;

/// The tone curve from here on: the one known before where the series agrees with it, else a
/// named one that it agrees with, else the measured one. True if it takes the old one's place.
pub(super) fn response(
    curve: Option<&Result<Curve, NoCurve>>,
    said: &Response,
) -> ((Response, String), bool) {
    let Some(Ok(curve)) = curve else {
        return ((said.clone(), "as the rig says".to_owned()), false);
    };
    let same = |other: &Response| {
        let (apart, sigmas) = curve.apart(other);
        sigmas < SAME_SIGMAS && apart < SAME_CURVE
    };
    if same(said) {
        return (
            (said.clone(), "as the rig says, confirmed".to_owned()),
            false,
        );
    }
    if curve.largest_sigma() > USABLE_CURVE {
        return ((said.clone(), "as the rig says".to_owned()), false);
    }
    let named = [
        (Response::srgb(), "sRGB"),
        (Response::linear(), "linear"),
        (Response::gamma(2.2), "gamma 2.2"),
    ];
    for (named, name) in named {
        if same(&named) {
            return ((named, name.to_owned()), true);
        }
    }
    ((curve.response.clone(), "measured".to_owned()), true)
}

/// Whether a fall-off is there at all: half a per cent at the edge, and beyond its error.
pub(super) fn falls_off(fit: &Fit) -> bool {
    let edge = (fit.edge() - 1.0).abs();
    edge > 0.005 && edge > 3.0 * fit.edge_sigma
}

pub(super) fn progress(eyes: &[EyeState; 2]) -> Progress {
    let [scene, environment] = [0, 1].map(|i| eyes[i].charts.len());
    let series: usize = eyes.iter().map(|e| e.series.series).sum();
    let noise: usize = eyes.iter().map(|e| e.noise.pairs).sum();
    let hint = match (scene, environment) {
        (0, 0) => "hold a ColorChecker where both cameras see it",
        (0, _) => "turn the chart until the scene camera sees all of it",
        (_, 0) => "turn the chart until the environment camera sees all of it",
        _ if noise < 3 => "keep the cameras still for a moment",
        _ => "",
    };
    let parts = [scene.min(1), environment.min(1), usize::from(noise >= 3)];
    let last = usize::from(eyes[0].marks.is_empty());
    Progress {
        share: parts.iter().sum::<usize>() as f64 / 3.0,
        message: format!(
            "chart in {scene} and {environment} pictures, {series} exposure series, {noise} \
                 pairs at rest"
        ),
        hint: hint.to_owned(),
        marks: eyes[last].marks.clone(),
        eye: (!eyes[last].marks.is_empty()).then_some(EYES[last]),
    }
}

/// Lines and findings on their way to a verdict.
#[derive(Default)]
pub(super) struct Verdict {
    pub lines: Vec<String>,
    pub findings: Vec<(Grade, String)>,
    pub hints: Vec<String>,
}

impl Verdict {
    pub fn find(&mut self, grade: Grade, text: impl Into<String>) {
        self.findings.push((grade, text.into()));
    }
}

pub(super) fn judged(
    eyes: &[EyeState; 2],
    cameras: &[CameraFound; 2],
    gains: &Gains,
    options: &Options,
) -> Finished {
    let mut verdict = Verdict::default();
    swapped(&mut verdict, eyes, options);
    judge_gains(&mut verdict, eyes, gains);
    for i in 0..2 {
        judge_cameras::judge_charts(&mut verdict, i, &eyes[i], &cameras[i], options);
        judge_cameras::judge_camera(&mut verdict, i, &cameras[i]);
        if eyes[i].moved > 2 && eyes[i].noise.pairs == 0 {
            verdict.hints.push(format!(
                "keep the {} camera still for a moment: its noise was not measured",
                EYES[i].name()
            ));
        }
    }
    let Verdict {
        lines,
        mut findings,
        hints,
    } = verdict;
    if lines.is_empty() && findings.is_empty() {
        findings.push((
            Grade::Refused,
            "there is nothing to calibrate from; show both cameras a ColorChecker, or give \
             pictures of an exposure series"
                .to_owned(),
        ));
    }
    findings.sort_by_key(|f| std::cmp::Reverse(f.0));
    let grade = findings.iter().map(|f| f.0).max().unwrap_or(Grade::Good);
    Finished {
        grade,
        lines,
        findings,
        hints,
        page: String::new(),
        file: None,
    }
}

fn swapped(verdict: &mut Verdict, eyes: &[EyeState; 2], options: &Options) {
    let [Some(scene), Some(environment)] = options.sizes else {
        return;
    };
    let shown = [eyes[0].size, eyes[1].size];
    if scene != environment && shown == [environment, scene] {
        verdict.find(
            Grade::Refused,
            format!(
                "the cameras are swapped: the scene camera's pictures are {}×{}, which is the \
                 environment camera's size; exchange them",
                shown[0].0, shown[0].1
            ),
        );
    }
}

fn judge_gains(verdict: &mut Verdict, eyes: &[EyeState; 2], gains: &Gains) {
    for (name, estimate) in gains.all() {
        let sd = 100.0 * estimate.relative_sd;
        verdict.lines.push(format!(
            "scene = ({:.4}, {:.4}, {:.4}) × environment by {name}, ± ({:.2}, {:.2}, {:.2}) %",
            estimate.gains.x, estimate.gains.y, estimate.gains.z, sd.x, sd.y, sd.z
        ));
    }
    if let Some(Ok((_, matched))) = &gains.chart {
        let used = matched.patches;
        verdict.lines.push(format!(
            "chart: {}, {}, {} of 24 patches in red, green, blue; ΔE2000 left {:.2} (worst \
                 {:.2}){}",
            used[0],
            used[1],
            used[2],
            matched.residual_delta_e,
            matched.worst_delta_e,
            if gains.matrix.is_some() {
                "; a 3×3 matrix matches better and is in the file"
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
        verdict.find(Grade::Refused, error.clone());
    }
    missing_charts(verdict, eyes, gains);
    let Some((_, best)) = gains.best() else {
        return;
    };
    let worst = best.relative_sd.max_element();
    if worst > USABLE_GAIN {
        verdict.find(
            Grade::Refused,
            format!(
                "gains are known to {:.0} % only; light the chart better",
                100.0 * worst
            ),
        );
    } else if worst > GOOD_GAIN {
        verdict.find(
            Grade::Usable,
            format!(
                "gains are known to {:.1} %; a well-lit chart gives 0.5 %",
                100.0 * worst
            ),
        );
    }
    agreement(verdict, gains);
}

fn missing_charts(verdict: &mut Verdict, eyes: &[EyeState; 2], gains: &Gains) {
    if gains.best().is_some() {
        return;
    }
    let seen = [0, 1].map(|i| (eyes[i].pictures > 0, !eyes[i].charts.is_empty()));
    let text = match seen {
        [(true, false), (true, false)] => {
            "no chart is seen by either camera; show all 24 patches, no smaller than 8 pixels each"
        }
        [(true, false), (_, true)] => {
            "the scene camera sees no chart; turn it until all 24 patches are in its picture"
        }
        [(_, true), (true, false)] => {
            "the environment camera sees no chart; turn it until all 24 patches are in its picture"
        }
        _ => return,
    };
    // A series may have been all that was wanted.
    let series = eyes.iter().any(|e| e.series.series > 0);
    let grade = if series {
        Grade::Usable
    } else {
        Grade::Refused
    };
    verdict.find(grade, text);
}

/// The other ways against the surest.
fn agreement(verdict: &mut Verdict, gains: &Gains) {
    let all = gains.all();
    let Some((best, of_best)) = gains.best() else {
        return;
    };
    for (name, other) in all.iter().filter(|(name, _)| *name != best) {
        let apart: DVec3 = (other.gains / of_best.gains).ln().abs();
        let variance = other.relative_sd.powf(2.0) + of_best.relative_sd.powf(2.0);
        let beyond = (0..3).any(|c| apart[c] > AGREE && apart[c] > 3.0 * variance[c].sqrt());
        let text = format!(
            "{best} and {name} differ by {:.1} %, {:.1} %, {:.1} %",
            100.0 * apart.x,
            100.0 * apart.y,
            100.0 * apart.z
        );
        if beyond {
            verdict.find(
                Grade::Usable,
                format!(
                    "{text}, more than both allow; put the chart where the scene is, in \
                     the same light"
                ),
            );
        } else {
            verdict
                .lines
                .push(format!("{text}, within what both allow"));
        }
    }
}
