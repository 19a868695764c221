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
            at.map(|at| at + shift)
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
                polyline(&mut picture, points, GROUND);
            }
        }
        let axis = self.ball.direction;
        let (u, v) = axis.any_orthonormal_pair();
        let (sin, cos) = self.ball.half_angle.sin_cos();
        let outline = (0..=180).map(|k| {
            let around = DVec2::from_angle(std::f64::consts::TAU * f64::from(k) / 180.0);
            let ray = axis * cos + (u * around.x + v * around.y) * sin;
            self.camera.project(ray).map(|at| at + shift)
        });
        polyline(&mut picture, outline, BALL);
        picture
    }
}

/// Draws a line through points; one that cannot be projected interrupts it.
fn polyline(picture: &mut Picture, points: impl Iterator<Item = Option<DVec2>>, colour: [u8; 3]) {
    let width = (f64::from(picture.width) / 800.0).max(1.0);
    let mut last: Option<DVec2> = None;
    for point in points {
        if let (Some(a), Some(b)) = (last, point) {
            line(picture, [a, b], width, colour);
        }
        last = point;
    }
}

fn line(picture: &mut Picture, [a, b]: [DVec2; 2], width: f64, colour: [u8; 3]) {
    let size = DVec2::new(f64::from(picture.width), f64::from(picture.height));
    // A line that leaves the picture far away is not followed for ever.
    let length = a.distance(b);
    if length.is_nan() || length > 4.0 * size.length() {
        return;
    }
    let steps = (2.0 * length).ceil().max(1.0) as u32;
    let half = (width / 2.0).ceil() as i32;
    for i in 0..=steps {
        let p = a
            .lerp(b, f64::from(i) / f64::from(steps))
            .round()
            .as_ivec2();
        for (dx, dy) in (-half..half.max(1)).flat_map(|x| (-half..half.max(1)).map(move |y| (x, y)))
        {
            let (x, y) = (p.x + dx, p.y + dy);
            let is_inside =
                x >= 0 && y >= 0 && x < picture.width as i32 && y < picture.height as i32;
            if is_inside {
                let at = 4 * (y as usize * picture.width as usize + x as usize);
                picture.rgba[at..at + 3].copy_from_slice(&colour);
            }
        }
    }
}
