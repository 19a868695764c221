//! The two poses of a square that its picture allows, in closed form: infinitesimal plane-based
//! pose estimation (Collins & Bartoli, "Infinitesimal Plane-based Pose Estimation", IJCV 2014).
//!
//! ```text
//!  Around the square's middle the homography's Jacobian J (2×2) and the image (p, q) of the
//!  middle say all. With R_v, which turns +Z towards (p, q, 1), and
//!      B = [1 0 −p; 0 1 −q] R_v (its first two columns),   A = B⁻¹ J,   γ = largest singular value,
//!  A/γ is the upper left of a rotation, whose third row is known but for its sign:
//!      R = R_v [ a₁ a₂ a₁×a₂ ],   a_i = (A_1i, A_2i)/γ and ±√(1 − |·|²).
//! ```

use super::homography::from_square;
use super::pose::{Match, PoseEstimate, refine};
use super::registrar::CLEAR;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::fixed_size::solve;

/// Both `camera_from_tag` of a tag of this size (metres), in no order; `None` where
/// the corners are no picture of a square.
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
    let poses = rotations(jacobian, seen)?.map(|r| place(&r, &ideal, 0.5 * size));
    let [Some(a), Some(b)] = poses else {
        return None;
    };
    Some([a, b])
}

/// Both `camera_from_tag` of a tag of this size, metres, each to the least reprojection error, the
/// better first; the other only where its corners fit nearly as well.
#[must_use]
pub fn both_poses(camera: &PinholeCamera, corners: &[DVec2; 4], size: f64) -> Vec<RigidTransform> {
    let points = super::pose::square(0.5 * size);
    let matches: [_; 4] = std::array::from_fn(|i| Match {
        point: points[i],
        pixel: corners[i],
    });
    let starts = poses(camera, corners, size).into_iter().flatten();
    let mut found: Vec<PoseEstimate> = starts
        .filter_map(|start| refine(camera, start, &matches))
        .collect();
    found.sort_by(|a, b| a.rms.total_cmp(&b.rms));
    let best = found.first().map_or(0.0, |f| f.rms);
    found.retain(|f| f.rms <= 2.0 * CLEAR * best.max(0.05));
    found.iter().map(|f| f.camera_from_frame).collect()
}

/// `camera_from_tag` of a tag of this size, metres: of its two poses the one that suits the corners
/// better, or, where both do, the one nearer to the `last`.
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
    let turn = |e: &PoseEstimate, last: RigidTransform| {
        e.camera_from_frame.rotation.angle_between(last.rotation)
    };
    let doubtful = other.rms < CLEAR * good.rms.max(0.05);
    let nearer = last.is_some_and(|last| turn(&other, last) < turn(&good, last));
    Some(if doubtful && nearer { other } else { good }.camera_from_frame)
}

fn rotations(jacobian: DMat2, seen: DVec2) -> Option<[DMat3; 2]> {
    let towards = seen.extend(1.0).normalize();
    let turn = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, towards));
    let row = |m: DVec3| m.truncate() - m.z * seen;
    let b = DMat2::from_cols(row(turn.x_axis), row(turn.y_axis));
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
        turn * DMat3::from_cols(x, y, x.cross(y))
    };
    Some([rotation(1.0), rotation(-1.0)])
}

/// The translation that suits a rotation best: for each corner X with picture (u, v),
/// (u, v) · (R X + t)_z = (R X + t)_xy, by least squares.
fn place(rotation: &DMat3, ideal: &[DVec2; 4], half: f64) -> Option<RigidTransform> {
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
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::synthetic::camera;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_of_the_two_is_the_pose(
            x in -0.2f64..0.2, y in -0.15f64..0.15, z in 0.3f64..2.0,
            ax in -1.2f64..1.2, ay in -1.0f64..1.0, az in -3.0f64..3.0, bent: bool,
        ) {
            let mut camera = camera();
            if bent {
                camera.distortion = [-0.2, 0.05, 0.001, -0.002, 0.0];
            }
            let turn = DQuat::from_rotation_z(az) * DQuat::from_rotation_x(ax) * DQuat::from_rotation_y(ay);
            let truth = RigidTransform::new(turn, DVec3::new(x, y, z));
            let corners = super::super::pose::square(0.03).map(|c| camera.project(truth.transform_point(c)).unwrap());
            let found = poses(&camera, &corners, 0.06).unwrap();
            let off = found.map(|f| f.translation.distance(truth.translation) + f.rotation.angle_between(truth.rotation));
            prop_assert!(off[0].min(off[1]) < 1e-5, "{off:?}");
        }
    }
}
