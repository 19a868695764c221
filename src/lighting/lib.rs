//! The environment camera's picture becomes light: an HDR map by direction, irradiance,
//! a prefiltered radiance map, and the dome lights that cast shadows.
//!
//! All values are linear, Rec.709 primaries, in the scene camera's units (a value of 1 is
//! the scene camera's white at its exposure). Directions are in the world, +Z up.
//!
//! The way of a picture: [`hdr`] merges bracketed exposures; [`view`] knows which
//! direction each pixel shows; [`sources`] finds compact sources among the pixels;
//! [`resample`] gathers the pixels into the cube map; [`harmonics`] and [`prefilter`] make
//! it into irradiance and the radiance map; [`dome`] (the paper's grid) or [`adaptive`]
//! make it into dome lights; [`geodesic`] tells which pixels light which face of the dome
//! that shadowing planes were baked for. [`EnvironmentEstimator`] does all this for every
//! frame.

pub mod adaptive;
pub mod box_chain;
pub mod brightest;
mod cells;
mod circle;
pub mod clipped;
pub mod cube;
pub mod dome;
pub mod equirect;
pub mod estimator;
pub mod geodesic;
pub mod glints;
pub mod harmonics;
pub mod hdr;
pub mod light;
pub mod lobes;
mod memory;
pub mod outline;
pub mod photograph;
pub mod prefilter;
mod probe;
pub mod report;
pub mod resample;
pub mod settings;
mod shadow_ratio;
pub mod sources;
mod stages;
mod tracking;

pub use brightest::{BrightestFollower, BrightestLight};
pub use circle::ball_outline;
pub use clipped::ClippedEnergy;
pub use estimator::EnvironmentEstimator;
pub use hdr::Bracket;
pub use light::{CubeMap, DomeLight, Filtering, Harmonics, LightKind, Lighting};
pub use probe::ProbeMap;
pub use report::LightReport;
pub use settings::{
    BallSeen, EnvironmentError, EnvironmentInput, EnvironmentSettings, IrradianceMethod,
    LightPlacement,
};
pub use stages::Stages;
