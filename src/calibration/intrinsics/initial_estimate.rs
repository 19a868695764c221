//! Initial values of the lens.

use super::board::{Correspondence, View};
use super::homography;
use super::pose::{initial_pose, residual};
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_numerics::{Matrix, median, null_vector};

/// Candidate fields of view along the picture's longer side, degrees.
const VIEW_ANGLES: [f64; 22] = [
    6.0, 8.0, 11.0, 15.0, 20.0, 25.0, 30.0, 37.0, 45.0, 53.0, 61.0, 70.0, 80.0, 90.0, 100.0, 115.0,
    130.0, 145.0, 165.0, 185.0, 205.0, 230.0,
];
/// Maximum number of views by which candidates are compared.
const MAX_VIEWS: usize = 24;

/// Returns the lens without distortion that fits the views best. Candidates are Zhang's closed-form
/// solution, if the model is a pinhole and the solution exists, and a range of focal lengths with
/// the principal point at the picture's centre. `None` if no candidate fits the views.
pub(super) fn initial_lens(model: LensModel, size: (u32, u32), views: &[View]) -> Option<Lens> {
    let sample = sample_views(views);
    let middle = DVec2::new(f64::from(size.0) - 1.0, f64::from(size.1) - 1.0) * 0.5;
    let fisheye = model == LensModel::KannalaBrandt;
    let sweep = VIEW_ANGLES
        .iter()
        .filter(|angle| fisheye || **angle <= 145.0)
        .map(|angle| {
            let half = 0.5 * angle.to_radians();
            let across = 0.5 * f64::from(size.0.max(size.1));
            let focal = across / if fisheye { half } else { half.tan() };
            Lens::ideal(model, size, DVec2::splat(focal), middle)
        });
    let closed = (!fisheye)
        .then(|| zhang(model, size, &sample, middle))
        .flatten();
    closed
        .into_iter()
        .chain(sweep)
        .filter_map(|lens| Some((median_error(&lens, &sample)?, lens)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, lens)| lens)
}

fn sample_views(views: &[View]) -> Vec<&View> {
    let every = views.len().div_ceil(MAX_VIEWS).max(1);
    views.iter().step_by(every).collect()
}

/// Returns the median over the views of their RMS reprojection error by homography, pixels.
fn median_error(lens: &Lens, views: &[&View]) -> Option<f64> {
    let errors = views
        .iter()
        .map(|v| view_error(lens, &v.points).unwrap_or(f64::INFINITY));
    median(errors).filter(|m| m.is_finite())
}

fn view_error(lens: &Lens, points: &[Correspondence]) -> Option<f64> {
    let pose = initial_pose(lens, points)?;
    let mut sum = 0.0;
    for c in points {
        sum += residual(lens, c, pose)?.0.length_squared();
    }
    Some((sum / points.len().max(1) as f64).sqrt())
}

// ┌ Every homography H = [h1 h2 h3] from board to pixels satisfies h1ᵀ ω h2 = 0 and      ┐
// │ h1ᵀ ω h1 = h2ᵀ ω h2, with ω = K⁻ᵀ K⁻¹ (Zhang 2000). Without skew and with the        │
// └ principal point in the middle, ω = diag(1/fx², 1/fy², 1): two unknowns.              ┘
fn zhang(model: LensModel, size: (u32, u32), views: &[&View], middle: DVec2) -> Option<Lens> {
    let scale = f64::from(size.0.max(size.1));
    let mut normal = Matrix::zeros(3, 3);
    for view in views {
        let pairs: Vec<(DVec2, DVec3)> = view
            .points
            .iter()
            .map(|c| {
                (
                    c.point,
                    ((c.pixel - middle) / scale).extend(1.0).normalize(),
                )
            })
            .collect();
        let Some(h) = homography::from_rays(&pairs) else {
            continue;
        };
        let DMat3 {
            x_axis: a,
            y_axis: b,
            ..
        } = h * (1.0 / h.x_axis.length());
        normal.add_outer(1.0, (a * b).as_ref(), (a * b).as_ref());
        let difference = a * a - b * b;
        normal.add_outer(1.0, difference.as_ref(), difference.as_ref());
    }
    let omega = null_vector(&normal);
    let square = DVec2::new(omega[2] / omega[0], omega[2] / omega[1]);
    let is_plausible =
        square.is_finite() && square.min_element() > 1e-3 && square.max_element() < 1e4;
    is_plausible.then(|| {
        // One focal length for both axes: with square pixels both change by equal steps from here
        // on, so that an initial difference would persist.
        let focal = (square.x * square.y).powf(0.25) * scale;
        Lens::ideal(model, size, DVec2::splat(focal), middle)
    })
}
