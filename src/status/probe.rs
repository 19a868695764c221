//! Status of the mirrored sphere in the scene camera's picture.

use serde::Serialize;

/// The environment map, which grows as the scene camera sees the sphere from more sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ProbeStatus {
    /// Share of all directions that the sphere has shown, 0..=1.
    pub coverage: f64,
    /// The same for directions above the horizon.
    pub coverage_above: f64,
    /// Mean time since the directions were last seen, seconds; `None` before the first.
    pub map_age_s: Option<f64>,
    /// Time since the sphere was seen, seconds; `None` before it was.
    pub sphere_age_s: Option<f64>,
    /// Correction of the sphere's position by its detected rim, pixels; `None` if the rim was not
    /// searched for.
    pub rim_shift_px: Option<f64>,
}
