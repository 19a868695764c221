//! A pose from corners: robust least squares, with its covariance.

use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::fixed_size::{Matrix, inverse, solve};

/// Corners that are farther off than this count less (Huber 1964), pixels.
const HUBER: f64 = 0.5;
/// A corner is never taken to be better than this, pixels: with four corners and six unknowns
/// residuals alone would say nothing.
const LEAST_SIGMA: f64 = 0.05;
/// Rounds, at most.
const ROUNDS: usize = 25;

/// A corner in space and in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Match {
    /// Where it is, metres, in the frame whose pose is sought.
    pub point: DVec3,
    /// Where it is seen, pixels.
    pub pixel: DVec2,
}

/// A pose that corners speak for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEstimate {
    /// `camera_from_` the corners' frame.
    pub camera_from_frame: RigidTransform,
    /// Of a small motion in the camera's frame before this pose: rotation vector (radians), then
    /// translation (metres).
    pub covariance: [[f64; 6]; 6],
    /// Root mean square distance of the corners, pixels.
    pub rms: f64,
    /// The largest distance, pixels.
    pub worst: f64,
}

impl PoseEstimate {
    /// Standard deviation of a point's picture, pixels; the point in the corners' frame.
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

    /// Standard deviations of direction (radians) and place (metres), each over all axes.
    #[must_use]
    pub fn sigmas(&self) -> (f64, f64) {
        let sum = |from: usize| (from..from + 3).map(|i| self.covariance[i][i]).sum::<f64>();
        (sum(0).sqrt(), sum(3).sqrt())
    }
}

/// Corners of a tag of half side `half`, its own frame, in [`super::TagSeen`]'s order.
pub(super) fn square(half: f64) -> [DVec3; 4] {
    [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| DVec3::new(x, y, 0.0))
}

/// Change of a point's pixel by a small motion (rotation vector, translation) of the camera's
/// frame; lens distortion by differences.
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

/// Half the robust sum of squares; `None` where a corner is behind the camera.
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

/// A small motion of the camera's frame, after the pose.
fn moved(pose: RigidTransform, by: &[f64; 6]) -> RigidTransform {
    let turn = DQuat::from_scaled_axis(DVec3::new(by[0], by[1], by[2]));
    RigidTransform::new(
        (turn * pose.rotation).normalize(),
        turn * pose.translation + DVec3::new(by[3], by[4], by[5]),
    )
}

/// The pose that suits corners best, from a `start` (Levenberg 1944, Marquardt 1963). `None`
/// where fewer than four corners, or a start with one behind the camera, leave it open.
#[must_use]
pub fn refine(
    camera: &PinholeCamera,
    start: RigidTransform,
    matches: &[Match],
) -> Option<PoseEstimate> {
    if matches.len() < 4 {
        return None;
    }
    let mut pose = start;
    let mut now = cost(camera, pose, matches)?;
    let mut damping = 1e-4;
    for _ in 0..ROUNDS {
        let (a, b) = normal(camera, pose, matches)?;
        let mut damped = a;
        for (i, row) in damped.iter_mut().enumerate() {
            row[i] *= 1.0 + damping;
        }
        let step = solve(&damped, &b)?;
        let next = moved(pose, &step);
        match cost(camera, next, matches) {
            Some(better) if better < now => {
                let gained = now - better;
                (pose, now, damping) = (next, better, damping * 0.2);
                if gained < 1e-9 * now.max(1e-12) {
                    break;
                }
            }
            _ if damping > 1e6 => break,
            _ => damping *= 8.0,
        }
    }
    estimate(camera, pose, matches)
}

/// What the corners say of a pose.
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
    let variance = (sum / free as f64).max(LEAST_SIGMA * LEAST_SIGMA);
    let (a, _) = normal(camera, pose, matches)?;
    let covariance = inverse(&a)?.map(|row| row.map(|v| v * variance));
    Some(PoseEstimate {
        camera_from_frame: pose,
        covariance,
        rms: (sum / matches.len() as f64).sqrt(),
        worst,
    })
}

#[cfg(test)]
mod tests;
