//! State of the light probe, a mirrored sphere in the scene camera's picture, and of its map.

use super::estimator::EnvironmentEstimator;
use penumbra_interface::MonotonicTime;

/// The map accumulated from a mirrored sphere, and when the sphere was seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProbeMap {
    /// Middle of the exposure of the last picture that showed the sphere.
    pub sphere_seen_at: Option<MonotonicTime>,
    /// Displacement of the sphere by that picture's rim from the position by the pose, pixels;
    /// `None` if the rim was not searched.
    pub rim_shift: Option<f64>,
    /// Mean time at which the directions ever seen were seen last.
    pub seen_at: Option<MonotonicTime>,
    /// Share of the sphere of directions that has been seen, 0..=1.
    pub coverage: f32,
    /// The same for the hemisphere above the horizon.
    pub coverage_above: f32,
}

/// The newest observation of the sphere.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LastSphere {
    seen_at: Option<MonotonicTime>,
    rim_shift: Option<f64>,
}

impl LastSphere {
    /// Records an observation.
    pub const fn record(&mut self, at: MonotonicTime, rim_shift: Option<f64>) {
        self.seen_at = Some(at);
        self.rim_shift = rim_shift;
    }
}

impl EnvironmentEstimator {
    /// Returns the state of the map from a mirrored sphere in the scene camera's picture; `None`
    /// for other views.
    #[must_use]
    pub fn probe_map(&self) -> Option<ProbeMap> {
        let (memory, grid, sphere) = self.accumulated()?;
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
            sphere_seen_at: sphere.seen_at,
            rim_shift: sphere.rim_shift,
            seen_at: memory.mean_seen_at(&grid.solid_angles),
            coverage: sum / (4.0 * std::f32::consts::PI),
            coverage_above: above / total_above,
        })
    }
}
