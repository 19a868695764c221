//! The settings of shadowing planes.

use penumbra_scene::PlaneShading;

/// Maximum number of compact sources with lights of their own beside the faces of the dome:
/// outdoors the sun is the only one; in a room the third source casts faint shadows.
pub const MAX_SOURCES: usize = 2;

/// When a plane's sum is recomputed. Both are shares of the total light that a plane receives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Lights that contribute less are skipped; for 40 lights, and for other numbers in inverse
    /// proportion.
    pub skip_below: f32,
    /// A plane is not recomputed while its light deviates by less.
    pub recompute_above: f32,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self {
            skip_below: 0.002,
            recompute_above: 0.01,
        }
    }
}

/// How planes are used in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanesChoice {
    /// When sums are recomputed.
    pub thresholds: Thresholds,
    /// Light with which virtual objects are shaded.
    pub shading: PlaneShading,
}
