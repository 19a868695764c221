//! State of the light probe, a mirrored sphere in the scene camera's picture, and of its map.

use penumbra_camera::MirroredView;
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
    pub(super) seen_at: Option<MonotonicTime>,
    pub(super) rim_shift: Option<f64>,
    pub(super) view: Option<MirroredView>,
}

impl LastSphere {
    /// Records an observation.
    pub const fn record(
        &mut self,
        at: MonotonicTime,
        rim_shift: Option<f64>,
        view: Option<MirroredView>,
    ) {
        self.view = view;
        self.seen_at = Some(at);
        self.rim_shift = rim_shift;
    }
}
