//! Moves the displayed pose towards the estimate without a jump.

use crate::motion::{difference, moved};
use glam::DVec2;
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;

/// Maximum speed of virtual objects relative to the picture while the camera rests, pixels per
/// second.
pub(super) const MAX_SPEED_AT_REST: f64 = 9.0;
/// Additional speed as a share of the picture's motion: a tenth of a hand's motion is not noticed.
pub(super) const MAX_SHARE_OF_MOTION: f64 = 0.1;

/// Positions of the points for [`apart_pixels`], shares of the picture's size from its centre.
const PROBES: [DVec2; 5] = [
    DVec2::ZERO,
    DVec2::new(-0.3, -0.3),
    DVec2::new(0.3, -0.3),
    DVec2::new(0.3, 0.3),
    DVec2::new(-0.3, 0.3),
];

/// Returns the maximum distance (pixels) between the pictures of the same points with two poses of
/// a camera (`world_from_camera`). The points are `distance` metres in front of pose `a`, spread
/// over the middle of the picture.
#[must_use]
pub fn apart_pixels(
    camera: &PinholeCamera,
    a: RigidTransform,
    b: RigidTransform,
    distance: f64,
) -> f64 {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let b_from_a = b.inverse() * a;
    let distances = PROBES.iter().map(|share| {
        let p = *share * size / camera.focal * distance;
        let p = p.extend(distance);
        match (
            camera.project(p),
            camera.project(b_from_a.transform_point(p)),
        ) {
            (Some(one), Some(other)) => one.distance(other),
            _ => size.length(),
        }
    });
    distances.fold(0.0, f64::max)
}

/// The displayed pose of the previous picture.
#[derive(Clone, Debug)]
pub(super) struct RateLimiter {
    /// displayed = this × pose by the tracker.
    displayed_from_tracked: Option<RigidTransform>,
    /// displayed = this × pose by markers.
    displayed_from_markers: Option<RigidTransform>,
    /// The last displayed pose, and the one before it.
    last: Option<(RigidTransform, RigidTransform)>,
}

impl RateLimiter {
    /// Creates a limiter without a previous picture.
    pub const fn new() -> Self {
        Self {
            displayed_from_tracked: None,
            displayed_from_markers: None,
            last: None,
        }
    }

    /// Returns the pose to display: the continuation of the previous one, moved towards `target` as
    /// far as the rate allows. `tracked` and `by_markers` are this picture's poses; `seconds` is the
    /// time since the previous picture, in which the picture moved by `motion` pixels.
    pub fn approach(
        &mut self,
        (camera, distance): (&PinholeCamera, f64),
        target: RigidTransform,
        (tracked, by_markers): (Option<RigidTransform>, Option<RigidTransform>),
        (seconds, motion): (f64, f64),
    ) -> RigidTransform {
        let continued = self.continued(tracked, by_markers);
        let displayed = continued.map_or(target, |from| {
            let distance = apart_pixels(camera, from, target, distance);
            let allowed = MAX_SPEED_AT_REST * seconds + MAX_SHARE_OF_MOTION * motion;
            interpolated(from, target, allowed / distance.max(1e-9))
        });
        self.displayed_from_tracked = tracked.map(|t| displayed * t.inverse());
        self.displayed_from_markers = by_markers.map(|m| displayed * m.inverse());
        let previous = self.last.map_or(displayed, |(last, _)| last);
        self.last = Some((displayed, previous));
        displayed
    }

    /// Continues the previous picture's pose: with a source that was present then and now, otherwise
    /// with the motion between the last two pictures.
    fn continued(
        &self,
        tracked: Option<RigidTransform>,
        by_markers: Option<RigidTransform>,
    ) -> Option<RigidTransform> {
        let by =
            |offset: Option<RigidTransform>, pose: Option<RigidTransform>| Some(offset? * pose?);
        let extrapolated = || {
            let (last, before) = self.last?;
            let (rotation, translation) = difference(&before, &last);
            Some(moved(last, rotation, translation))
        };
        by(self.displayed_from_tracked, tracked)
            .or_else(|| by(self.displayed_from_markers, by_markers))
            .or_else(extrapolated)
    }
}

/// Moves a pose by a share of its difference to another.
fn interpolated(from: RigidTransform, to: RigidTransform, share: f64) -> RigidTransform {
    if share >= 1.0 {
        return to;
    }
    let (rotation, translation) = difference(&from, &to);
    moved(from, rotation * share, translation * share)
}
