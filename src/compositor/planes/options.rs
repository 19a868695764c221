//! The settings of shadowing planes.

use penumbra_scene::PlaneShading;

/// Maximum number of compact sources with lights of their own beside the faces of the dome:
/// outdoors the sun is the only one; in a room the third source casts faint shadows.
pub const MAX_SOURCES: usize = 2;

/// When sums are made anew. All are shares of all the light that a plane gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Thresholds {
    /// Lights that give less are left out: of 40 lights; of more in proportion.
    pub skip_below: f32,
    /// A plane is left alone while its light is off by less.
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
    /// When sums are made anew.
    pub thresholds: Thresholds,
    /// What virtual objects are shaded by.
    pub shading: PlaneShading,
}
