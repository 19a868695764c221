//! Rejects corners and views that are outliers.

use super::board::View;
use super::pose::residual;
use glam::DVec2;
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;
use penumbra_numerics::median;

/// Minimum number of points of a view.
pub(super) const LEAST_POINTS: usize = 8;

/// Number of standard deviations beyond which a corner is an outlier.
const CORNER_SIGMAS: f64 = 5.0;
/// Ratio of a view's median error to the others' beyond which the view is an outlier.
const VIEW_TIMES: f64 = 4.0;
/// Minimum error of an outlier, pixels.
const ALWAYS_GOOD: f64 = 0.3;
/// Minimum share of a view's points that must remain.
const LEAST_SHARE: f64 = 0.6;

/// Returns which points are consistent with the lens: compares each error with those of all views,
/// and each view's errors with the other views'.
pub(super) fn judge(
    lens: &Lens,
    views: &[View],
    chosen: &[usize],
    poses: &[RigidTransform],
    before: &[Vec<bool>],
) -> Vec<Vec<bool>> {
    let errors: Vec<Vec<f64>> = chosen
        .iter()
        .zip(poses)
        .map(|(&i, &pose)| {
            errors_of(lens, &views[i], pose)
                .map(DVec2::length)
                .collect()
        })
        .collect();
    let middle_of = |e: &Vec<f64>| median(e.iter().copied()).unwrap_or(f64::INFINITY);
    let middles: Vec<f64> = errors.iter().map(middle_of).collect();
    let usual = median(middles.iter().copied()).unwrap_or(0.0);
    errors
        .iter()
        .zip(&middles)
        .zip(before)
        .map(|((errors, &middle), before)| {
            let view_fits = middle <= (VIEW_TIMES * usual).max(ALWAYS_GOOD);
            // Half of the lengths of normal errors lie within 1.1774 σ (Rayleigh).
            let sigma = middle.max(usual) / 1.1774;
            let limit = (CORNER_SIGMAS * sigma).max(ALWAYS_GOOD);
            let fits = errors.iter().map(|&e| view_fits && e <= limit);
            debug_assert_eq!(errors.len(), before.len());
            fits.collect()
        })
        .collect()
}

fn errors_of<'a>(
    lens: &'a Lens,
    view: &'a View,
    pose: RigidTransform,
) -> impl Iterator<Item = DVec2> + 'a {
    view.points
        .iter()
        .map(move |c| residual(lens, c, pose).map_or(DVec2::INFINITY, |r| r.0))
}

/// Removes views with too few remaining points.
pub(super) fn drop_views(
    chosen: &mut Vec<usize>,
    poses: &mut Vec<RigidTransform>,
    used: &mut Vec<Vec<bool>>,
) {
    let keep: Vec<bool> = used
        .iter()
        .map(|u| {
            let left = u.iter().filter(|x| **x).count();
            left >= LEAST_POINTS && left as f64 >= LEAST_SHARE * u.len() as f64
        })
        .collect();
    retain(chosen, &keep);
    retain(poses, &keep);
    retain(used, &keep);
}

fn retain<T>(list: &mut Vec<T>, keep: &[bool]) {
    let mut kept = keep.iter();
    list.retain(|_| kept.next().copied().unwrap_or(false));
}
