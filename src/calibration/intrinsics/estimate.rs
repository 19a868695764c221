//! Estimates a lens from views of a board: initial values, robust search, rejection of outliers,
//! least squares, uncertainty.

use super::board::View;
use super::bundle::{Bundle, Loss, State, Unknowns};
use super::initial_estimate::initial_lens;
use super::outliers::{MIN_POINTS, drop_views, inliers};
use super::pose::{board_pose, residual};
use glam::DVec2;
use penumbra_camera::{Lens, LensModel, MAX_PARAMETERS};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, root_mean_square};

/// Options of the estimation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Distortion model.
    pub model: LensModel,
    /// Constrains fx = fy, which holds for nearly every sensor.
    pub square_pixels: bool,
}

/// A lens with its uncertainty and residuals.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The lens.
    pub lens: Lens,
    /// Standard deviations of fx, fy, cx, cy and the coefficients, in order; 0 where fixed.
    pub sigma: [f64; MAX_PARAMETERS],
    /// RMS reprojection error over all points used, pixels: √(mean squared distance), as OpenCV
    /// defines it.
    pub rms: f64,
    /// Every view, in the order given.
    pub views: Vec<ViewEstimate>,
    /// Covariance of the unknowns.
    pub(super) covariance: Matrix,
    pub(super) unknowns: Unknowns,
}

/// Residuals of one view.
#[derive(Clone, Debug)]
pub struct ViewEstimate {
    /// The view's name.
    pub name: String,
    /// `camera_from_board`; `None` if it could not be computed.
    pub pose: Option<RigidTransform>,
    /// The view is used in the estimate.
    pub used: bool,
    /// RMS reprojection error over its points used, pixels.
    pub rms: f64,
    /// Every point.
    pub points: Vec<PointEstimate>,
}

/// Residual of one point.
#[derive(Clone, Copy, Debug)]
pub struct PointEstimate {
    /// Detected position, pixels.
    pub pixel: DVec2,
    /// Predicted minus detected position, pixels.
    pub error: DVec2,
    /// The point is used in the estimate.
    pub used: bool,
}

/// Reasons why the views give no lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoEstimate {
    /// Fewer views than the unknowns need.
    #[error("only {usable} usable views of the board; take at least 3, better 15, from all sides")]
    TooFewViews {
        /// Views with enough points.
        usable: usize,
    },
    /// No lens fits the views.
    #[error(
        "no lens fits the views: check the board's size and that all pictures are of one camera"
    )]
    NoLens,
    /// A family of lenses fits the views equally well.
    #[error(
        "the views do not determine the lens: tilt the board by 20 to 45 degrees, in several directions"
    )]
    Undetermined,
}

/// Estimates the lens that fits the views best. `size` is the pictures' width and height, pixels.
///
/// # Errors
/// There are too few views, no lens fits them, or they do not determine the lens.
pub fn estimate(
    size: (u32, u32),
    views: &[View],
    options: &Options,
) -> Result<Estimate, NoEstimate> {
    estimate_some(size, views, options, options.model.coefficients().len())
}

/// Like [`estimate`], with only the first `coefficients` of the model; the others stay zero.
pub(super) fn estimate_some(
    size: (u32, u32),
    views: &[View],
    options: &Options,
    coefficients: usize,
) -> Result<Estimate, NoEstimate> {
    let unknowns = Unknowns::new(options.square_pixels, true, coefficients);
    let mut chosen: Vec<usize> = (0..views.len())
        .filter(|&i| views[i].points.len() >= MIN_POINTS)
        .collect();
    if chosen.len() < 3 {
        return Err(NoEstimate::TooFewViews {
            usable: chosen.len(),
        });
    }
    let usable: Vec<View> = chosen.iter().map(|&i| views[i].clone()).collect();
    let lens = initial_lens(options.model, size, &usable).ok_or(NoEstimate::NoLens)?;
    let (mut lens, mut poses) = search(&lens, views, &mut chosen, &unknowns, options)?;
    let mut used: Vec<Vec<bool>> = chosen
        .iter()
        .map(|&i| vec![true; views[i].points.len()])
        .collect();
    let mut last = None;
    for _ in 0..5 {
        let inliers = inliers(&lens, views, &chosen, &poses, &used);
        let unchanged = inliers == used;
        if unchanged && last.is_some() {
            break;
        }
        used = inliers;
        drop_views(&mut chosen, &mut poses, &mut used);
        if chosen.len() < 3 {
            return Err(NoEstimate::NoLens);
        }
        let kept: Vec<&View> = chosen.iter().map(|&i| &views[i]).collect();
        let bundle = Bundle {
            views: &kept,
            used: &used,
            unknowns: unknowns.clone(),
            loss: Loss::Squares,
        };
        let (state, at) = bundle
            .minimise(State { lens, poses }, 60)
            .ok_or(NoEstimate::NoLens)?;
        (lens, poses) = (state.lens, state.poses);
        last = Some(at);
    }
    let at = last.ok_or(NoEstimate::NoLens)?;
    let covariance = covariance(&at).ok_or(NoEstimate::Undetermined)?;
    let sigma = unknowns.by_parameter(|c| covariance[(c, c)].max(0.0).sqrt());
    Ok(Estimate {
        rms: (at.cost / at.points.max(1) as f64).sqrt(),
        views: describe(&lens, views, &chosen, &poses, &used),
        lens,
        sigma,
        covariance,
        unknowns,
    })
}

/// Minimises a robust cost in stages, first over the best-determined parameters, so that high-order
/// coefficients start from a nearly correct lens.
fn search(
    start: &Lens,
    views: &[View],
    chosen: &mut Vec<usize>,
    all: &Unknowns,
    options: &Options,
) -> Result<(Lens, Vec<RigidTransform>), NoEstimate> {
    chosen.retain(|&i| board_pose(start, &views[i].points).is_some());
    let poses = chosen
        .iter()
        .filter_map(|&i| board_pose(start, &views[i].points))
        .collect();
    let mut state = State {
        lens: start.clone(),
        poses,
    };
    if chosen.len() < 3 {
        return Err(NoEstimate::NoLens);
    }
    let kept: Vec<&View> = chosen.iter().map(|&i| &views[i]).collect();
    let used: Vec<Vec<bool>> = kept.iter().map(|v| vec![true; v.points.len()]).collect();
    let longer = f64::from(start.width.max(start.height));
    for (scale, unknowns) in [
        (0.02 * longer, Unknowns::new(true, false, 0)),
        (0.01 * longer, Unknowns::new(true, false, 1)),
        (
            0.005 * longer,
            Unknowns::new(options.square_pixels, true, 2),
        ),
        (1.0, all.clone()),
    ] {
        let bundle = Bundle {
            views: &kept,
            used: &used,
            unknowns,
            loss: Loss::Cauchy(scale),
        };
        let (next, _) = bundle.minimise(state, 60).ok_or(NoEstimate::NoLens)?;
        state = next;
    }
    Ok((state.lens, state.poses))
}

// ┌ Σ = σ² S⁻¹, σ² = Σ e² / (2 N − unknowns), S the reduced normal matrix; and             ┐
// │ Σ' = S⁻¹ (Σ gᵢ gᵢᵀ) S⁻¹ over the views' gradients gᵢ (White 1980, clustered), which     │
// └ also covers errors common to a view: a bent board, glare, blur.                        ┘
/// Returns the covariance of the unknowns: the larger of both variances for each, with the
/// correlations of Σ.
fn covariance(at: &super::bundle::Linearised) -> Option<Matrix> {
    let reduced = at.reduced(0.0)?;
    let inverse = reduced.matrix.cholesky()?.inverse();
    let (n, views) = (inverse.rows(), reduced.by_view.len());
    let freedom = (2.0 * at.points as f64 - (n + 6 * views) as f64).max(1.0);
    let mut out = inverse.clone().scaled(at.cost / freedom);
    let mut gradients = Matrix::zeros(n, n);
    for share in &reduced.by_view {
        gradients.add_outer(1.0, share, share);
    }
    let clustered = inverse.times(&gradients).times(&inverse);
    // The residuals of few views are smaller than their errors.
    let small = views as f64 / (views as f64 - 1.0).max(1.0);
    let widen: Vec<f64> = (0..n)
        .map(|i| (small * clustered[(i, i)] / out[(i, i)]).max(1.0).sqrt())
        .collect();
    for i in 0..n {
        for j in 0..n {
            out[(i, j)] *= widen[i] * widen[j];
        }
    }
    (0..n)
        .all(|i| out[(i, i)].is_finite() && out[(i, i)] >= 0.0)
        .then_some(out)
}

fn describe(
    lens: &Lens,
    views: &[View],
    chosen: &[usize],
    poses: &[RigidTransform],
    used: &[Vec<bool>],
) -> Vec<ViewEstimate> {
    views
        .iter()
        .enumerate()
        .map(|(i, view)| {
            let kept = chosen.iter().position(|&c| c == i);
            let pose = kept
                .map(|k| poses[k])
                .or_else(|| board_pose(lens, &view.points));
            let points: Vec<PointEstimate> = view
                .points
                .iter()
                .enumerate()
                .map(|(j, c)| PointEstimate {
                    pixel: c.pixel,
                    error: pose
                        .and_then(|pose| residual(lens, c, pose))
                        .map_or(DVec2::ZERO, |r| r.0),
                    used: kept.is_some_and(|k| used[k][j]),
                })
                .collect();
            let counted = points.iter().filter(|p| p.used || kept.is_none());
            ViewEstimate {
                name: view.name.clone(),
                pose,
                used: kept.is_some(),
                rms: root_mean_square(counted.map(|p| p.error.length())),
                points,
            }
        })
        .collect()
}

#[cfg(test)]
pub(super) mod tests;
