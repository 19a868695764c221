//! Pose of a board seen through a known lens.

use super::board::Correspondence;
use super::homography;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;
use penumbra_numerics::{NormalEquations, minimise};

/// Threshold of the Huber loss, pixels.
const HUBER: f64 = 2.0;

/// Computes `camera_from_board` from at least four points: initial value by homography, then
/// minimisation of the reprojection error. `None` if the points are collinear or have no rays.
#[must_use]
pub fn board_pose(lens: &Lens, points: &[Correspondence]) -> Option<RigidTransform> {
    let initial_pose = initial_pose(lens, points)?;
    let minimum = minimise(
        initial_pose,
        30,
        |pose| linearise(lens, points, *pose),
        |pose, step| moved(*pose, step),
    )?;
    Some(minimum.state)
}

/// Returns the pose from the homography alone.
pub(super) fn initial_pose(lens: &Lens, points: &[Correspondence]) -> Option<RigidTransform> {
    let rays: Vec<(DVec2, DVec3)> = points
        .iter()
        .filter_map(|c| Some((c.point, lens.unproject(c.pixel)?)))
        .collect();
    homography::pose(homography::from_rays(&rays)?)
}

fn linearise(
    lens: &Lens,
    points: &[Correspondence],
    pose: RigidTransform,
) -> Option<NormalEquations> {
    let mut normal = NormalEquations::new(6);
    for c in points {
        let (error, by_pose) = residual(lens, c, pose)?;
        let weight = (HUBER / error.length().max(1e-12)).min(1.0);
        for axis in 0..2 {
            normal.add(error[axis], &by_pose.map(|d| d[axis]), weight);
        }
        // Cost of Huber's linear tail, so that steps are accepted by the minimised cost.
        let tail = (error.length() - HUBER).max(0.0);
        normal.cost += HUBER * tail;
    }
    Some(normal)
}

/// Returns the reprojection error and its derivatives by a small rotation and translation of the
/// pose.
pub(super) fn residual(
    lens: &Lens,
    c: &Correspondence,
    pose: RigidTransform,
) -> Option<(DVec2, [DVec2; 6])> {
    let arm = pose.rotation * c.point.extend(0.0);
    let projection = lens.project_with_derivatives(arm + pose.translation)?;
    Some((
        projection.pixel - c.pixel,
        by_pose(&projection.by_point, arm),
    ))
}

/// Returns ∂/∂(ω, t) of the projection of exp(ω) arm + t.
pub(super) fn by_pose(by_point: &[DVec2; 3], arm: DVec3) -> [DVec2; 6] {
    let along = |v: DVec3| by_point[0] * v.x + by_point[1] * v.y + by_point[2] * v.z;
    [
        along(DVec3::X.cross(arm)),
        along(DVec3::Y.cross(arm)),
        along(DVec3::Z.cross(arm)),
        by_point[0],
        by_point[1],
        by_point[2],
    ]
}

/// Applies a small rotation (about axes parallel to the camera's, at the board's origin) and a
/// translation.
pub(super) fn moved(pose: RigidTransform, step: &[f64]) -> RigidTransform {
    let rotation = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
    let translation = DVec3::new(step[3], step[4], step[5]);
    RigidTransform::new(
        (rotation * pose.rotation).normalize(),
        pose.translation + translation,
    )
}
