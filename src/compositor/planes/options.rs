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

/// The papers' number of lights, to which [`Thresholds::skip_below`] refers: of more lights, each
/// contributes less.
const PAPERS_LIGHTS: f32 = 40.0;

/// Thresholds for a number of lights; shares of the total light that a plane receives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Limits {
    /// Lights that contribute less are skipped.
    pub skip_below: f32,
    /// A plane is not recomputed while its light deviates by less.
    pub recompute_above: f32,
    /// Lights that deviate by less are not updated together with the others; their sum deviates by
    /// at most the threshold again.
    pub min_change: f32,
}

impl Thresholds {
    pub(super) fn limits(self, lights: usize) -> Limits {
        let lights = lights.max(1) as f32;
        Limits {
            skip_below: self.skip_below * PAPERS_LIGHTS / lights,
            recompute_above: self.recompute_above,
            min_change: self.recompute_above / lights,
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
