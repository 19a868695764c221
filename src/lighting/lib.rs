//! Estimates the light of a real scene from pictures of an environment camera: an HDR map by
//! direction, irradiance, a prefiltered radiance map, and dome lights that cast shadows.
//!
//! All values are linear, with Rec.709 primaries, in the scene camera's units (1 is the scene
//! camera's white at its exposure). Directions are in the world, +Z up.
//!
//! Data flow: [`hdr`] merges bracketed exposures; [`resample`] computes the direction of each pixel
//! and gathers the pixels into the cube map; the energy of clipped pixels is estimated;
//! [`sources`] finds compact sources among the pixels; [`harmonics`] and [`prefilter`] compute
//! irradiance and the radiance map; [`dome`] (the paper's grid) or [`adaptive`] place dome lights;
//! [`environment_map`] reads a map that takes the place of pictures; [`geodesic`] assigns pixels to the dome faces of shadowing planes. [`EnvironmentEstimator`] runs
//! all this for every frame; [`average`] averages its results where the light does not change, and
//! [`blend`] interpolates between two of them.

pub mod adaptive;
pub mod average;
pub mod blend;
pub mod box_chain;
pub mod brightest;
mod cells;
mod circle;
pub mod clipped;
pub mod compact_source_specular;
pub mod cube;
pub mod dome;
pub mod environment_map;
pub mod equirect;
pub mod estimator;
pub mod geodesic;
mod half_hidden;
pub mod harmonics;
pub mod hdr;
pub mod lamp_distance;
pub mod light;
pub mod lobes;
mod matt;
mod memory;
pub mod outline;
pub mod photograph;
pub mod place;
pub mod prefilter;
mod probe;
pub mod report;
pub mod resample;
mod round;
pub mod settings;
mod shadow_ratio;
pub mod sources;
mod stages;
mod tracking;
pub mod triangulation;

pub use blend::Blender;
pub use brightest::{BrightestFollower, BrightestLight};
pub use circle::{
    Circle, OutlineSearch, find_outline, outline_points, sphere_outline, visible_share,
};
pub use environment_map::{EnvironmentMapError, read_environment_map};
pub use equirect::Equirect;
pub use estimator::EnvironmentEstimator;
pub use hdr::Bracket;
pub use light::{CubeMap, DomeLight, Filtering, Harmonics, LightKind, Lighting};
pub use matt::is_matt;
pub use place::LightPlace;
pub use probe::ProbeMap;
pub use report::LightReport;
pub use settings::{
    ClippedEnergy, EnvironmentError, EnvironmentInput, EnvironmentSettings, IrradianceMethod,
    LightPlacement, SpherePosition,
};
pub use stages::Stages;
