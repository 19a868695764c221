//! The cone of rays that touch a sphere, as x = a / cos α (see the parent module).

use glam::DVec3;

/// Returns the axis and the half angle (radians) of x = a / cos α.
pub(super) fn shape(x: DVec3) -> Option<(DVec3, f64)> {
    let length = x.length();
    (length.is_finite() && length > 1.000_001).then(|| (x / length, (1.0 / length).acos()))
}

/// Returns the distance of a ray from the cone, outwards, in pixels near the axis.
pub(super) fn distance(x: DVec3, bearing: DVec3, focal: f64) -> f64 {
    let length = x.length();
    let half = (1.0 / length).acos();
    (bearing.dot(x / length).clamp(-1.0, 1.0).acos() - half) * focal
}
