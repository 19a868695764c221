//! Draws what was found into a photograph, so that a person can judge it at a glance.

use crate::ball::FoundBall;
use crate::placement::Placement;
use crate::{Analysis, Photographs};
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_picture::Picture;

/// Green: the ball.
const BALL: [u8; 3] = [60, 255, 90];
/// Yellow: the ground.
const GROUND: [u8; 3] = [255, 220, 40];
/// Cells of the ground's grid to either side.
const CELLS: i32 = 4;
/// Cells to either side of a square that a person may take for a start.
const SQUARE: f64 = 2.0;
/// Points of a line of the grid, and of the ball's outline, less one.
const LINE_POINTS: u32 = 32;
const OUTLINE_POINTS: u32 = 180;

/// A line in a picture, pixels. Points behind the camera are missing.
pub type Line = Vec<Option<[f64; 2]>>;

/// A camera whose pictures are shifted by so many pixels.
#[derive(Clone, Copy)]
struct View<'a> {
    camera: &'a PinholeCamera,
    shift: DVec2,
}

impl View<'_> {
    fn project(&self, point_in_camera: DVec3) -> Option<[f64; 2]> {
        let at = self.camera.project(point_in_camera);
        at.map(|at| (at + self.shift).to_array())
    }

    fn outline(&self, ball: &FoundBall) -> Line {
        let axis = ball.direction;
        let (u, v) = axis.any_orthonormal_pair();
        let (sin, cos) = ball.half_angle.sin_cos();
        let point = |k: u32| {
            let turn = std::f64::consts::TAU * f64::from(k) / f64::from(OUTLINE_POINTS);
            let around = DVec2::from_angle(turn);
            self.project(axis * cos + (u * around.x + v * around.y) * sin)
        };
        (0..=OUTLINE_POINTS).map(point).collect()
    }

    fn grid(&self, placement: &Placement, cell: f64) -> Vec<Line> {
        let camera_from_world = placement.world_from_camera.inverse();
        let reach = f64::from(CELLS) * cell;
        let line = |a: DVec3, b: DVec3| -> Line {
            let points = (0..=LINE_POINTS).map(|i| f64::from(i) / f64::from(LINE_POINTS));
            let at = |t: f64| self.project(camera_from_world.transform_point(a.lerp(b, t)));
            points.map(at).collect()
        };
        let lines = (-CELLS..=CELLS).flat_map(|k| {
            let at = f64::from(k) * cell;
            [
                line(DVec3::new(at, -reach, 0.0), DVec3::new(at, reach, 0.0)),
                line(DVec3::new(-reach, at, 0.0), DVec3::new(reach, at, 0.0)),
            ]
        });
        lines.collect()
    }
}

impl Photographs {
    fn view(&self) -> View<'_> {
        View {
            camera: &self.camera,
            shift: self.shift(),
        }
    }

    /// Returns the outline of a ball in the [first](Self::first) picture.
    #[must_use]
    pub fn outline(&self, ball: &FoundBall) -> Line {
        self.view().outline(ball)
    }

    /// Returns the lines of a grid on the ground in that picture, whose cells are as wide as the ball, whose radius
    /// is in metres.
    #[must_use]
    pub fn grid(&self, placement: &Placement, ball_radius: f64) -> Vec<Line> {
        self.view().grid(placement, 2.0 * ball_radius)
    }

    /// Returns the corners of a square on the ground around the ball in that picture, four balls wide, if the
    /// camera sees it.
    #[must_use]
    pub fn square(&self, placement: &Placement, ball_radius: f64) -> Option<[[f64; 2]; 4]> {
        let reach = SQUARE * 2.0 * ball_radius;
        let camera_from_world = placement.world_from_camera.inverse();
        let corner = |[x, y]: [f64; 2]| {
            let at = DVec3::new(x * reach, y * reach, 0.0);
            self.view().project(camera_from_world.transform_point(at))
        };
        let [a, b, c, d] = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]].map(corner);
        Some([a?, b?, c?, d?])
    }
}

impl Analysis {
    /// Returns the first picture with the ball, with its outline, how much of that is seen, and a grid on the
    /// ground whose cells are as wide as the ball.
    #[must_use]
    pub fn drawn(&self) -> Picture {
        let first = self.balls.first();
        let mut picture = first.map_or_else(
            || self.empty.picture.clone(),
            |b| b.photograph.picture.clone(),
        );
        let view = View {
            camera: &self.camera,
            shift: first.map_or(DVec2::ZERO, |b| b.shift.as_dvec2()),
        };
        for line in view.grid(&self.placement, 2.0 * self.ball_radius) {
            picture.draw_line(line, GROUND);
        }
        let outline = view.outline(&self.ball);
        let bottom = outline.iter().flatten().map(|p| p[1]).reduce(f64::max);
        picture.draw_line(outline, BALL);
        let circle = self.ball.circle;
        let at = [
            circle.centre.x + view.shift.x,
            bottom.unwrap_or(circle.centre.y) + 0.15 * circle.radius,
        ];
        let label = format!("outline seen: {:.0} %", 100.0 * self.ball.support);
        picture.draw_label(at, &label, BALL);
        picture
    }
}
