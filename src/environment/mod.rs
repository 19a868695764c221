//! The environment camera's picture becomes light: an HDR map by direction, irradiance,
//! a prefiltered radiance map, and the dome lights that cast shadows.
//!
//! All values are linear, Rec.709 primaries, in the scene camera's units (a value of 1 is
//! the scene camera's white at its exposure). Directions are in the world, +Z up.

pub mod light;

pub use light::{CubeMap, DomeLight, Harmonics, LightKind, Lighting};
