//! Recognises pictures of two cameras: the views that contradict the lens fit one of their own.

use super::board::View;
use super::estimate::{Estimate, Options, ViewEstimate, estimate_some};
use super::findings::Finding;
use penumbra_numerics::{median, root_mean_square};

/// Minimum share of contradicting views; fewer are blurred views or a picture that got in by mistake.
const MIN_SHARE: f64 = 0.2;
/// Minimum ratio of a contradicting view's RMS error to the median over all views.
const VIEW_RATIO: f64 = 2.0;
/// Minimum share of the contradicting views that a lens of their own must fit: blurred views and a
/// bent board fit none.
const MIN_FITTED: f64 = 0.75;
/// Maximum ratio of their error under that lens to their error under the calibrated one.
const MAX_ERROR_RATIO: f64 = 0.5;
/// Minimum relative difference of the focal lengths, and its ratio to the standard deviation.
const MIN_DIFFERENCE: (f64, f64) = (0.02, 3.0);

/// Returns a finding if the views that contradict `estimate` fit another lens; `coefficients` are
/// those of the simplest lens of the model.
pub(super) fn two_cameras(
    estimate: &Estimate,
    views: &[View],
    options: &Options,
    coefficients: usize,
) -> Option<Finding> {
    let limit = VIEW_RATIO * median(estimate.views.iter().map(|v| v.rms))?;
    let contradicts = |v: &ViewEstimate| !v.used || v.rms > limit;
    let both = views.iter().zip(&estimate.views);
    let (others, before): (Vec<View>, Vec<f64>) = both
        .filter(|(_, e)| contradicts(e))
        .map(|(view, e)| (view.clone(), e.rms))
        .unzip();
    if (others.len() as f64) < MIN_SHARE * views.len() as f64 {
        return None;
    }
    let size = (estimate.lens.width, estimate.lens.height);
    let other = estimate_some(size, &others, options, coefficients).ok()?;
    let fitted = other.views.iter().filter(|v| v.used).count() as f64;
    let is_better = other.rms <= MAX_ERROR_RATIO * root_mean_square(before.iter().copied());
    let difference = (other.lens.focal.x / estimate.lens.focal.x - 1.0).abs();
    let sigma = other.sigma[0] / other.lens.focal.x;
    let differs = difference > MIN_DIFFERENCE.0.max(MIN_DIFFERENCE.1 * sigma);
    let is_other = fitted >= MIN_FITTED * others.len() as f64 && is_better && differs;
    is_other.then_some(Finding::TwoCameras {
        others: others.len(),
        views: views.len(),
        focal: other.lens.focal.x,
        used: estimate.lens.focal.x,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intrinsics::estimate::tests::{pinhole, poses, simulated_views};
    use crate::intrinsics::{Board, ViewCollector};
    use penumbra_camera::LensModel;
    use penumbra_numerics::Random;
    use penumbra_rig_model::Grade;

    fn collected(views: impl IntoIterator<Item = View>) -> ViewCollector {
        let mut collector = ViewCollector::new(Board::parse("chess:9x6:0.025").unwrap());
        for view in views {
            collector.add_points("", (640, 480), view.points);
        }
        collector
    }

    const OPTIONS: Options = Options {
        model: LensModel::Brown,
        square_pixels: true,
    };

    #[test]
    fn views_of_two_cameras_are_refused() {
        for factor in [0.7, 1.25, 1.6] {
            let mut random = Random::new(1);
            let mut other = pinhole();
            other.focal *= factor;
            let mut views = simulated_views(&pinhole(), &poses(16, 0.4, 0.2, 5), 0.1, &mut random);
            let more = simulated_views(&other, &poses(8, 0.5, 0.15, 6), 0.1, &mut random);
            views.extend(more);
            let outcome = collected(views).finish(&OPTIONS);
            let found = &outcome.assessment.findings;
            assert_eq!(
                outcome.assessment.grade,
                Grade::Refused,
                "{factor} {found:?}"
            );
            let is_named = |f: &(Grade, Finding)| matches!(f.1, Finding::TwoCameras { .. });
            assert!(found.iter().any(is_named), "{factor}: {found:?}");
        }
    }

    #[test]
    fn disturbed_views_are_no_second_camera() {
        let mut random = Random::new(1);
        let mut views = simulated_views(&pinhole(), &poses(24, 0.4, 0.2, 5), 0.1, &mut random);
        for view in views.iter_mut().take(7) {
            for c in &mut view.points {
                c.pixel.x += 3.0 * random.normal();
            }
        }
        let outcome = collected(views).finish(&OPTIONS);
        let found = &outcome.assessment.findings;
        let is_named = |f: &(Grade, Finding)| matches!(f.1, Finding::TwoCameras { .. });
        assert!(!found.iter().any(is_named), "{found:?}");
    }
}
