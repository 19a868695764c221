//! What a mirrored sphere in the scene camera's picture has shown of the light, in the status's
//! words.

use serde::Serialize;

/// The map that grows as the scene camera sees the sphere from more sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ProbeStatus {
    /// Share of all directions that the sphere has shown, 0..=1.
    pub coverage: f64,
    /// The same of those above the horizon.
    pub coverage_above: f64,
    /// Time since they were seen last, on average, seconds; `None` before the first.
    pub map_age_s: Option<f64>,
    /// Time since the sphere was seen, seconds; `None` before it was.
    pub ball_age_s: Option<f64>,
    /// How far its rim in the picture has moved it then from where the pose puts it, pixels; `None`
    /// where it was not looked for.
    pub rim_shift_px: Option<f64>,
}
