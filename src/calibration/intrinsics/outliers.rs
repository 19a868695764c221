//! Rejects corners and views that are outliers.

use super::board::View;
use super::pose::residual;
use glam::DVec2;
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;
use penumbra_numerics::median;

/// Minimum number of points of a view.
pub(super) const MIN_POINTS: usize = 8;

/// Error beyond which a corner is an outlier, standard deviations.
const CORNER_SIGMAS: f64 = 5.0;
/// Maximum ratio of a view's median error to the median over all views.
const VIEW_RATIO: f64 = 4.0;
/// Minimum error of an outlier, pixels.
const MIN_OUTLIER: f64 = 0.3;
/// Minimum share of a view's points that must remain.
const MIN_SHARE: f64 = 0.6;

/// Returns which points are consistent with the lens: compares each error with those of all views,
/// and each view's errors with the other views'.
pub(super) fn inliers(
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
    let overall = median(middles.iter().copied()).unwrap_or(0.0);
    errors
        .iter()
        .zip(&middles)
        .zip(before)
        .map(|((errors, &middle), before)| {
            let view_fits = middle <= (VIEW_RATIO * overall).max(MIN_OUTLIER);
            // The median length of a normally distributed error is 1.1774 σ (Rayleigh).
            let sigma = middle.max(overall) / 1.1774;
            let limit = (CORNER_SIGMAS * sigma).max(MIN_OUTLIER);
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
            left >= MIN_POINTS && left as f64 >= MIN_SHARE * u.len() as f64
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
