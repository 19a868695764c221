//! Rolling shutter: the rows of a picture are read one after the other while the camera moves.

use crate::PinholeCamera;
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::rotation_vector;

/// Fixed-point iterations for the row in which a point is seen.
const ITERATIONS: usize = 4;

/// Motion of a camera while it reads out a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RollingShutter {
    /// Rotation vector from one row to the next, camera axes, radians.
    pub rotation_per_row: DVec3,
    /// Translation from one row to the next, camera axes, metres.
    pub translation_per_row: DVec3,
}

impl RollingShutter {
    /// Returns the motion of a camera whose pose changes from `before` to `after`
    /// (`world_from_camera`) within `seconds` around the middle row; `row_seconds` is the time from
    /// one row to the next. `None` for a global shutter or invalid times.
    #[must_use]
    pub fn between(
        before: &RigidTransform,
        after: &RigidTransform,
        seconds: f64,
        row_seconds: f64,
    ) -> Option<Self> {
        let share = row_seconds / seconds;
        if !share.is_finite() || share == 0.0 {
            return None;
        }
        let to_camera = before.rotation.inverse();
        let translation = to_camera * (after.translation - before.translation);
        Some(Self {
            rotation_per_row: rotation_vector(to_camera * after.rotation) * share,
            translation_per_row: translation * share,
        })
    }

    /// The row at which the camera has the picture's pose.
    #[must_use]
    pub fn middle_row(camera: &PinholeCamera) -> f64 {
        0.5 * (f64::from(camera.height) - 1.0)
    }

    /// Projects a point of the static scene, given in the camera's frame at the middle row (metres),
    /// to a pixel; `None` behind the camera.
    #[must_use]
    pub fn project(&self, camera: &PinholeCamera, point_in_camera: DVec3) -> Option<DVec2> {
        let last = f64::from(camera.height);
        let mut pixel = camera.project(point_in_camera)?;
        for _ in 0..ITERATIONS {
            let rows = pixel.y.clamp(-last, 2.0 * last) - Self::middle_row(camera);
            let per_row = self.translation_per_row + self.rotation_per_row.cross(point_in_camera);
            pixel = camera.project(point_in_camera - per_row * rows)?;
        }
        Some(pixel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn projects_point_into_the_row_read_at_its_time() {
        let camera = PinholeCamera {
            width: 640,
            height: 480,
            focal: DVec2::splat(600.0),
            centre: DVec2::new(319.5, 239.5),
            distortion: [-0.1, 0.02, 0.0, 0.0, 0.0],
        };
        // A fast motion of the hand: half a metre and a radian per second, 30 µs per row.
        let pose = |seconds: f64| {
            RigidTransform::new(
                DQuat::from_scaled_axis(DVec3::new(0.3, 1.0, -0.2) * seconds),
                DVec3::new(0.4, -0.3, 0.1) * seconds,
            )
        };
        let row_seconds = 30e-6;
        let rolling =
            RollingShutter::between(&pose(-0.01), &pose(0.01), 0.02, row_seconds).unwrap();
        for world in [DVec3::new(0.2, 0.15, 0.7), DVec3::new(-0.2, -0.18, 0.6)] {
            let shown = rolling
                .project(&camera, pose(0.0).inverse().transform_point(world))
                .unwrap();
            let rows = shown.y - RollingShutter::middle_row(&camera);
            let then = pose(rows * row_seconds).inverse().transform_point(world);
            let truth = camera.project(then).unwrap();
            let still = camera
                .project(pose(0.0).inverse().transform_point(world))
                .unwrap();
            assert!(shown.distance(truth) < 0.02, "{shown} {truth}");
            assert!(still.distance(truth) > 2.0);
        }
    }
}
