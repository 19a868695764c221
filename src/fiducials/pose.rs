//! Pose estimation from corners: robust least squares, with the covariance.

use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::fixed_size::{Matrix, inverse, solve};
use penumbra_numerics::{Stop, descend};

/// Reprojection error beyond which a corner's weight decreases (Huber 1964), pixels.
const HUBER: f64 = 0.5;
/// Minimum standard deviation of a corner, pixels: with four corners and six unknowns, residuals
/// alone are not informative.
const MIN_SIGMA: f64 = 0.05;
/// End of the refinement.
const STOP: Stop = Stop {
    iterations: 25,
    min_gain: 1e-9,
};

/// A corner in space and its picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Position in the frame whose pose is estimated, metres.
    pub point: DVec3,
    /// Position in the picture, pixels.
    pub pixel: DVec2,
}

/// A pose estimated from corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEstimate {
    /// The corners' frame in the camera's frame.
    pub camera_from_frame: RigidTransform,
    /// Covariance of a small motion, in the camera's frame, that is applied after this pose:
    /// rotation vector (radians), then translation (metres).
    pub covariance: [[f64; 6]; 6],
    /// Root mean square reprojection error, pixels.
    pub rms: f64,
    /// Maximum reprojection error, pixels.
    pub max_error: f64,
}

impl PoseEstimate {
    /// Returns the standard deviation (pixels, per axis) of the picture of a point of the corners' frame.
    #[must_use]
    pub fn sigma_at(&self, camera: &PinholeCamera, point: DVec3) -> f64 {
        let p = self.camera_from_frame.transform_point(point);
        let Some(rows) = rows(camera, p) else {
            return f64::INFINITY;
        };
        let variance = |row: &[f64; 6]| -> f64 {
            let c = &self.covariance;
            (0..6)
                .map(|i| (0..6).map(|j| row[i] * c[i][j] * row[j]).sum::<f64>())
                .sum()
        };
        (0.5 * (variance(&rows[0]) + variance(&rows[1]))).sqrt()
    }

    /// Returns the standard deviations of orientation (radians) and position (metres), each over all axes.
    #[must_use]
    pub fn sigmas(&self) -> (f64, f64) {
        let sum = |from: usize| (from..from + 3).map(|i| self.covariance[i][i]).sum::<f64>();
        (sum(0).sqrt(), sum(3).sqrt())
    }
}

/// Corners of a tag of half side `half` in its own frame, clockwise as it is read from the top left.
pub(super) fn square(half: f64) -> [DVec3; 4] {
    [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, 0.0))
}

/// Returns the derivatives of a point's pixel by a small motion (rotation vector, translation) in
/// the camera's frame; those of the projection by central differences.
fn rows(camera: &PinholeCamera, p: DVec3) -> Option<[[f64; 6]; 2]> {
    const STEP: f64 = 1e-6;
    let mut by_point = [DVec2::ZERO; 3];
    for (axis, slot) in DVec3::AXES.into_iter().zip(&mut by_point) {
        let step = STEP * p.z.max(STEP);
        let (a, b) = (
            camera.project(p + axis * step)?,
            camera.project(p - axis * step)?,
        );
        *slot = (a - b) / (2.0 * step);
    }
    let mut rows = [[0.0; 6]; 2];
    for axis in 0..3 {
        // d(ω × p)/dω_axis = e_axis × p.
        let turned = DVec3::AXES[axis].cross(p).to_array();
        let moved: DVec2 = (0..3).map(|k| by_point[k] * turned[k]).sum();
        (rows[0][axis], rows[1][axis]) = (moved.x, moved.y);
        (rows[0][3 + axis], rows[1][3 + axis]) = (by_point[axis].x, by_point[axis].y);
    }
    Some(rows)
}

/// Returns half the robust sum of squares; `None` if a corner is behind the camera.
fn cost(camera: &PinholeCamera, pose: RigidTransform, matches: &[Match]) -> Option<f64> {
    let mut sum = 0.0;
    for m in matches {
        let off = camera
            .project(pose.transform_point(m.point))?
            .distance(m.pixel);
        sum += if off <= HUBER {
            0.5 * off * off
        } else {
            HUBER * (off - 0.5 * HUBER)
        };
    }
    Some(sum)
}

/// JᵀWJ and JᵀWr.
fn normal(
    camera: &PinholeCamera,
    pose: RigidTransform,
    matches: &[Match],
) -> Option<(Matrix<6>, [f64; 6])> {
    let (mut a, mut b) = ([[0.0; 6]; 6], [0.0; 6]);
    for m in matches {
        let p = pose.transform_point(m.point);
        let off = m.pixel - camera.project(p)?;
        let weight = (HUBER / off.length().max(HUBER)).min(1.0);
        for (row, off) in rows(camera, p)?.iter().zip(off.to_array()) {
            for i in 0..6 {
                b[i] += weight * row[i] * off;
                for j in 0..6 {
                    a[i][j] += weight * row[i] * row[j];
                }
            }
        }
    }
    Some((a, b))
}

/// Applies a small motion in the camera's frame after the pose.
fn moved(pose: RigidTransform, by: &[f64; 6]) -> RigidTransform {
    let turn = DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]));
    RigidTransform::new(
        (turn * pose.rotation).normalize(),
        turn * pose.translation + DVec3::new(by[3], by[4], by[5]),
    )
}

/// Refines the pose (`camera_from_` the corners' frame) from `start` to the minimum robust
/// reprojection error (Huber 1964). `None` with fewer than four corners, or if
/// `start` puts a corner behind the camera.
#[must_use]
pub fn refine(
    camera: &PinholeCamera,
    start: RigidTransform,
    matches: &[Match],
) -> Option<PoseEstimate> {
    if matches.len() < 4 {
        return None;
    }
    let (pose, ()) = descend(
        start,
        STOP,
        |pose| Some((cost(camera, *pose, matches)?, ())),
        |pose, (), damping| {
            let (mut a, b) = normal(camera, *pose, matches)?;
            for (i, row) in a.iter_mut().enumerate() {
                row[i] *= 1.0 + damping;
            }
            Some(moved(*pose, &solve(&a, &b)?))
        },
    )?;
    estimate(camera, pose, matches)
}

/// Returns the pose with its covariance and errors.
fn estimate(
    camera: &PinholeCamera,
    pose: RigidTransform,
    matches: &[Match],
) -> Option<PoseEstimate> {
    let (mut sum, mut worst) = (0.0, 0.0_f64);
    for m in matches {
        let off = camera
            .project(pose.transform_point(m.point))?
            .distance(m.pixel);
        sum += off * off;
        worst = worst.max(off);
    }
    let free = (2 * matches.len()).saturating_sub(6).max(1);
    let variance = (sum / free as f64).max(MIN_SIGMA * MIN_SIGMA);
    let (a, _) = normal(camera, pose, matches)?;
    let covariance = inverse(&a)?.map(|row| row.map(|v| v * variance));
    Some(PoseEstimate {
        camera_from_frame: pose,
        covariance,
        rms: (sum / matches.len() as f64).sqrt(),
        max_error: worst,
    })
}

#[cfg(test)]
mod tests;
