//! A rolling shutter: rows of a picture are read one after the other, while the camera moves.

use crate::PinholeCamera;
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;

/// Rounds until the row in which a point is seen stands still.
const ROUNDS: usize = 4;

/// How a camera moved while it read a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RollingShutter {
    /// Rotation vector from one row to the next, the camera's axes, radians.
    pub rotation_per_row: DVec3,
    /// Way from one row to the next, the camera's axes, metres.
    pub translation_per_row: DVec3,
}

impl RollingShutter {
    /// Of a camera whose pose went from `before` to `after` (`world_from_camera`) in so many
    /// seconds about the middle row, and that takes `row_seconds` from one row to the next.
    /// `None` where nothing moved or the times make no sense.
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
        let turn = before.rotation.inverse() * after.rotation;
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let way = before.rotation.inverse() * (after.translation - before.translation);
        Some(Self {
            rotation_per_row: turn.to_scaled_axis() * share,
            translation_per_row: way * share,
        })
    }

    /// Row that the pose is of.
    #[must_use]
    pub fn middle_row(camera: &PinholeCamera) -> f64 {
        0.5 * (f64::from(camera.height) - 1.0)
    }

    /// Pixel of a point that stands still, given in the camera's frame at the middle row;
    /// `None` behind the camera.
    #[must_use]
    pub fn project(&self, camera: &PinholeCamera, point_in_camera: DVec3) -> Option<DVec2> {
        let last = f64::from(camera.height);
        let mut pixel = camera.project(point_in_camera)?;
        for _ in 0..ROUNDS {
            let rows = pixel.y.clamp(-last, 2.0 * last) - Self::middle_row(camera);
            let way = self.translation_per_row + self.rotation_per_row.cross(point_in_camera);
            pixel = camera.project(point_in_camera - way * rows)?;
        }
        Some(pixel)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_point_is_seen_where_the_row_of_its_time_shows_it() {
        let camera = PinholeCamera {
            width: 640,
            height: 480,
            focal: DVec2::splat(600.0),
            centre: DVec2::new(319.5, 239.5),
            distortion: [-0.1, 0.02, 0.0, 0.0, 0.0],
        };
        // A hand's quick move: half a metre and a radian a second, 30 µs a row.
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
