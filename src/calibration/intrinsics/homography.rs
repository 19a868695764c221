//! Homographies from points of a plane to viewing rays or pixels.

use glam::{DMat3, DVec2, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Matrix, null_vector};

/// Fits H in ray ∝ H (x, y, 1) by least squares over all pairs; its sign puts the points in front
/// of the rays' origin. `None` for fewer than four or collinear points.
///
/// ray × H (x, y, 1) = 0 is linear in H (Hartley & Zisserman 4.1) and holds for rays in any
/// direction, also beyond 90° from the axis.
pub(crate) fn from_rays(pairs: &[(DVec2, DVec3)]) -> Option<DMat3> {
    if pairs.len() < 4 {
        return None;
    }
    let (middle, scale) = normalisation(pairs.iter().map(|p| p.0))?;
    let mut normal = Matrix::zeros(9, 9);
    for &(point, ray) in pairs {
        let p = ((point - middle) * scale).extend(1.0);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            // axis · (ray × H p) = (axis × ray) · H p
            let left = axis.cross(ray);
            let mut row = [0.0; 9];
            for i in 0..3 {
                for j in 0..3 {
                    row[3 * i + j] = left[i] * p[j];
                }
            }
            normal.add_outer(1.0, &row, &row);
        }
    }
    let h = null_vector(&normal);
    let rows = DMat3::from_cols_slice(&h).transpose();
    let normalised = DMat3::from_cols(
        DVec3::new(scale, 0.0, 0.0),
        DVec3::new(0.0, scale, 0.0),
        (-middle * scale).extend(1.0),
    );
    let h = rows * normalised;
    let side = |&(point, ray): &(DVec2, DVec3)| ray.dot(h * point.extend(1.0)).signum();
    let sign = pairs.iter().map(side).sum::<f64>().signum();
    (h.determinant().abs() > 1e-300 && h.is_finite()).then(|| h * sign)
}

/// Fits H in (pixel, 1) ∝ H (x, y, 1) by least squares in normalised pixel coordinates (Hartley &
/// Zisserman 4.4), which weight the noise evenly.
pub(super) fn from_pixels(pairs: &[(DVec2, DVec2)]) -> Option<DMat3> {
    let (middle, scale) = normalisation(pairs.iter().map(|p| p.1))?;
    let normalised: Vec<(DVec2, DVec3)> = pairs
        .iter()
        .map(|(point, pixel)| (*point, ((*pixel - middle) * scale).extend(1.0)))
        .collect();
    let back = DMat3::from_cols(
        DVec3::new(1.0 / scale, 0.0, 0.0),
        DVec3::new(0.0, 1.0 / scale, 0.0),
        middle.extend(1.0),
    );
    Some(back * from_rays(&normalised)?)
}

/// Returns the centroid of the points, and the scale that makes their mean distance from it √2.
fn normalisation(points: impl Iterator<Item = DVec2> + Clone) -> Option<(DVec2, f64)> {
    let count = points.clone().count().max(1) as f64;
    let middle = points.clone().sum::<DVec2>() / count;
    let mean_distance = points.map(|p| p.distance(middle)).sum::<f64>() / count;
    (mean_distance > 0.0).then(|| (middle, std::f64::consts::SQRT_2 / mean_distance))
}

/// Decomposes a homography to rays into the pose `camera_from_board`.
pub(super) fn pose(h: DMat3) -> Option<RigidTransform> {
    let scale = (h.x_axis.length() * h.y_axis.length()).sqrt();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let h = h * (1.0 / scale);
    // The perpendicular axes nearest to those of the homography.
    let (sum, difference) = (
        (h.x_axis.normalize() + h.y_axis.normalize()).try_normalize()?,
        (h.x_axis.normalize() - h.y_axis.normalize()).try_normalize()?,
    );
    let x = (sum + difference) * std::f64::consts::FRAC_1_SQRT_2;
    let y = (sum - difference) * std::f64::consts::FRAC_1_SQRT_2;
    let rotation = glam::DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize();
    let pose = RigidTransform::new(rotation, h.z_axis);
    (pose.translation.is_finite() && rotation.is_finite()).then_some(pose)
}
