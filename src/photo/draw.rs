//! Draws what was found into a photograph, so that a person can judge it at a glance.

use crate::Analysis;
use glam::{DVec2, DVec3};
use penumbra_picture::Picture;

/// Green: the ball.
const BALL: [u8; 3] = [60, 255, 90];
/// Yellow: the ground.
const GROUND: [u8; 3] = [255, 220, 40];
/// Cells of the ground's grid to either side.
const CELLS: i32 = 4;

impl Analysis {
    /// Returns the first picture with the ball, with its outline and a grid on the ground whose cells
    /// are as wide as the ball.
    #[must_use]
    pub fn drawn(&self) -> Picture {
        let first = self.balls.first();
        let mut picture = first.map_or_else(
            || self.empty.picture.clone(),
            |b| b.photograph.picture.clone(),
        );
        let shift = first.map_or(DVec2::ZERO, |b| b.shift.as_dvec2());
        let camera_from_world = self.placement.world_from_camera.inverse();
        let project = |p: DVec3| {
            let at = self.camera.project(camera_from_world.transform_point(p));
            at.map(|at| (at + shift).to_array())
        };
        let cell = 2.0 * self.ball_radius;
        let reach = f64::from(CELLS) * cell;
        for k in -CELLS..=CELLS {
            let at = f64::from(k) * cell;
            for [a, b] in [
                [DVec3::new(at, -reach, 0.0), DVec3::new(at, reach, 0.0)],
                [DVec3::new(-reach, at, 0.0), DVec3::new(reach, at, 0.0)],
            ] {
                let points = (0..=32).map(|i| project(a.lerp(b, f64::from(i) / 32.0)));
                picture.draw_line(points, GROUND);
            }
        }
        let axis = self.ball.direction;
        let (u, v) = axis.any_orthonormal_pair();
        let (sin, cos) = self.ball.half_angle.sin_cos();
        let outline = (0..=180).map(|k| {
            let around = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / 180.0);
            let ray = axis * cos + (u * around.x + v * around.y) * sin;
            let at = self.camera.project(ray);
            at.map(|at| (at + shift).to_array())
        });
        picture.draw_line(outline, BALL);
        picture
    }
}
