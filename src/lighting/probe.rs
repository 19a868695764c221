//! What there is to say of a mirrored sphere in the scene camera's picture and of the map that
//! it has given.

use super::estimator::EnvironmentEstimator;
use penumbra_interface::MonotonicTime;

/// The map that a mirrored sphere has given so far, and when the sphere was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProbeMap {
    /// The last picture that showed the sphere: the middle of its exposure.
    pub ball_seen_at: Option<MonotonicTime>,
    /// How far that picture's rim moved the sphere from where the pose puts it, pixels; `None`
    /// where it was not looked for.
    pub rim_shift: Option<f64>,
    /// When the directions that were ever seen were seen last, on average.
    pub seen_at: Option<MonotonicTime>,
    /// Share of the sphere that has been seen, 0..=1.
    pub coverage: f32,
    /// The same of the hemisphere above the horizon.
    pub coverage_above: f32,
}

/// The sphere in the newest picture that showed it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastBall {
    seen_at: Option<MonotonicTime>,
    rim_shift: Option<f64>,
}

impl LastBall {
    /// A picture showed it.
    pub const fn seen(&mut self, at: MonotonicTime, rim_shift: Option<f64>) {
        self.seen_at = Some(at);
        self.rim_shift = rim_shift;
    }
}

impl EnvironmentEstimator {
    /// The map by a mirrored sphere in the scene camera's picture; `None` for other views.
    #[must_use]
    pub fn probe_map(&self) -> Option<ProbeMap> {
        let (memory, grid, ball) = self.remembered()?;
        let (mut sum, mut above, mut total_above) = (0.0, 0.0, 0.0);
        for ((d, &w), &c) in grid
            .directions
            .iter()
            .zip(&grid.solid_angles)
            .zip(&memory.coverage)
        {
            sum += w * c;
            if d.z > 0.0 {
                above += w * c;
                total_above += w;
            }
        }
        Some(ProbeMap {
            ball_seen_at: ball.seen_at,
            rim_shift: ball.rim_shift,
            seen_at: memory.mean_seen_at(&grid.solid_angles),
            coverage: sum / (4.0 * std::f32::consts::PI),
            coverage_above: above / total_above,
        })
    }
}
