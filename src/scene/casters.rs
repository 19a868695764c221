//! Virtual parts as they cast shadows.

use super::{Part, Scene};

/// The virtual parts of `scene` as casters.
#[must_use]
pub fn casters(scene: &Scene) -> Vec<Part> {
    scene.virtual_parts.clone()
}
