//! The two poses of a square that are consistent with its picture, in closed form: infinitesimal
//! plane-based pose estimation (Collins & Bartoli, "Infinitesimal Plane-based Pose Estimation",
//! IJCV 2014).
//!
//! ```text
//!  The homography's Jacobian J (2×2) at the square's centre and the image (p, q) of the centre
//!  determine both poses. With R_v, which rotates +Z to (p, q, 1), and
//!      B = [1 0 −p; 0 1 −q] R_v (its first two columns),   A = B⁻¹ J,   γ = largest singular value,
//!  A/γ is the upper left block of a rotation, whose third row is known up to its sign:
//!      R = R_v [ a₁ a₂ a₁×a₂ ],   a_i = (A_1i, A_2i)/γ and ±√(1 − |·|²).
//! ```

use super::homography::from_square;
use super::pose::{Match, PoseEstimate, refine};
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::fixed_size::solve;

/// Minimum ratio of the reprojection errors of a tag's two poses for the better one to be certain.
pub(super) const AMBIGUITY_RATIO: f64 = 2.5;
/// Reprojection errors below this do not tell the two poses apart, pixels.
pub(super) const MIN_RMS: f64 = 0.05;

/// Returns both candidates for `camera_from_tag` of a tag of edge `size` (metres), unordered;
/// `None` if the corners (pixels) cannot be the picture of a square.
pub(super) fn poses(
    camera: &PinholeCamera,
    corners: &[DVec2; 4],
    size: f64,
) -> Option<[RigidTransform; 2]> {
    let ideal = corners.map(|c| {
        let ray = camera.unproject(c);
        ray.truncate() / ray.z
    });
    let map = from_square(0.5 * size, &ideal)?;
    let scale = map.z_axis.z;
    if scale.abs() < 1e-12 {
        return None;
    }
    let h = map * (1.0 / scale);
    let seen = h.z_axis.truncate();
    let column = |c: DVec3| c.truncate() - c.z * seen;
    let jacobian = DMat2::from_cols(column(h.x_axis), column(h.y_axis));
    let poses = rotations(jacobian, seen)?.map(|r| with_translation(&r, &ideal, 0.5 * size));
    let [Some(a), Some(b)] = poses else {
        return None;
    };
    Some([a, b])
}

/// Returns the candidates for `camera_from_tag` of a tag of edge `size` (metres) from its corners
/// (pixels), each refined to the minimum reprojection error. The better one comes first; the other
/// is included only if it fits nearly as well.
#[must_use]
pub fn candidate_poses(
    camera: &PinholeCamera,
    corners: &[DVec2; 4],
    size: f64,
) -> Vec<RigidTransform> {
    let points = super::pose::square(0.5 * size);
    let matches: [_; 4] = std::array::from_fn(|i| Match {
        point: points[i],
        pixel: corners[i],
    });
    let initial_poses = poses(camera, corners, size).into_iter().flatten();
    let mut found: Vec<PoseEstimate> = initial_poses
        .filter_map(|start| refine(camera, start, &matches))
        .collect();
    found.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    let best = found.first().map_or(0.0, |f| f.rms);
    found.retain(|f| f.rms <= 2.0 * AMBIGUITY_RATIO * best.max(MIN_RMS));
    found.iter().map(|f| f.camera_from_frame).collect()
}

/// Returns `camera_from_tag` of a tag of edge `size` (metres) from its corners (pixels): the
/// candidate that fits the corners better, or, if both fit, the one closer to the orientation of
/// `last`. `None` if the corners cannot be the picture of a square.
#[must_use]
pub fn nearest_pose(
    camera: &PinholeCamera,
    corners: &[DVec2; 4],
    size: f64,
    last: Option<RigidTransform>,
) -> Option<RigidTransform> {
    let points = super::pose::square(0.5 * size);
    let matches: [_; 4] = std::array::from_fn(|i| Match {
        point: points[i],
        pixel: corners[i],
    });
    let [a, b] = poses(camera, corners, size)?.map(|start| refine(camera, start, &matches));
    let (Some(a), Some(b)) = (a, b) else {
        return Some(a.or(b)?.camera_from_frame);
    };
    let (good, other) = if a.rms <= b.rms { (a, b) } else { (b, a) };
    let angle = |e: &PoseEstimate, last: RigidTransform| {
        e.camera_from_frame.rotation.angle_between(last.rotation)
    };
    let is_ambiguous = other.rms < AMBIGUITY_RATIO * good.rms.max(MIN_RMS);
    let is_nearer = last.is_some_and(|last| angle(&other, last) < angle(&good, last));
    Some(
        if is_ambiguous && is_nearer {
            other
        } else {
            good
        }
        .camera_from_frame,
    )
}

fn rotations(jacobian: DMat2, seen: DVec2) -> Option<[DMat3; 2]> {
    let towards = seen.extend(1.0).normalize();
    let z_to_view = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, towards));
    let row = |m: DVec3| m.truncate() - m.z * seen;
    let b = DMat2::from_cols(row(z_to_view.x_axis), row(z_to_view.y_axis));
    if b.determinant().abs() < 1e-12 {
        return None;
    }
    let a = b.inverse() * jacobian;
    let square = a.x_axis.length_squared() + a.y_axis.length_squared();
    let det = a.determinant();
    let gamma = (0.5 * (square + (square * square - 4.0 * det * det).max(0.0).sqrt())).sqrt();
    if gamma.is_nan() || gamma < 1e-12 {
        return None;
    }
    let (u, v) = (a.x_axis / gamma, a.y_axis / gamma);
    let down = |w: DVec2| (1.0 - w.length_squared()).max(0.0).sqrt();
    let (s, t) = (down(u), if u.dot(v) > 0.0 { -down(v) } else { down(v) });
    let rotation = |sign: f64| {
        let (x, y) = (u.extend(sign * s), v.extend(sign * t));
        z_to_view * DMat3::from_cols(x, y, x.cross(y))
    };
    Some([rotation(1.0), rotation(-1.0)])
}

/// Returns the pose with a rotation and its best translation: for each corner X with picture (u, v),
/// (u, v) · (R X + t)_z = (R X + t)_xy, by least squares.
fn with_translation(rotation: &DMat3, ideal: &[DVec2; 4], half: f64) -> Option<RigidTransform> {
    let (mut a, mut b) = ([[0.0; 3]; 3], [0.0; 3]);
    let square = super::pose::square(half);
    for (image, corner) in ideal.iter().zip(square) {
        let x = *rotation * corner;
        let rows = [
            ([1.0, 0.0, -image.x], image.x * x.z - x.x),
            ([0.0, 1.0, -image.y], image.y * x.z - x.y),
        ];
        for (row, right) in rows {
            for i in 0..3 {
                b[i] += row[i] * right;
                for j in 0..3 {
                    a[i][j] += row[i] * row[j];
                }
            }
        }
    }
    let t = DVec3::from(solve(&a, &b)?);
    (t.z > 0.0).then(|| RigidTransform::new(DQuat::from_mat3(rotation).normalize(), t))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_candidate_is_the_pose(
            x in -0.2f64..0.2, y in -0.15f64..0.15, z in 0.3f64..2.0,
            ax in -1.2f64..1.2, ay in -1.0f64..1.0, az in -3.0f64..3.0, distorted: bool,
        ) {
            let mut camera = camera();
            if distorted {
                camera.distortion = [-0.2, 0.05, 0.001, -0.002, 0.0];
            }
            let rotation = DQuat::from_rotation_z(az) * DQuat::from_rotation_x(ax) * DQuat::from_rotation_y(ay);
            let truth = RigidTransform::new(rotation, DVec3::new(x, y, z));
            let corners = super::super::pose::square(0.03).map(|c| camera.project(truth.transform_point(c)).unwrap());
            let found = poses(&camera, &corners, 0.06).unwrap();
            let off = found.map(|f| f.translation.distance(truth.translation) + f.rotation.angle_between(truth.rotation));
            prop_assert!(off[0].min(off[1]) < 1e-5, "{off:?}");
        }
    }
}
