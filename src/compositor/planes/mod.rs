//! Shadowing planes on the GPU: baking ahead of time, and in each frame the sums of basis
//! images over the light of now.

mod bake_passes;
mod bake_scene;
pub mod baker;
mod compute;
pub mod luminance;
mod readback;
mod receiver;
mod shown;
mod stage;
pub mod synthesis;

pub use baker::bake;
pub(super) use stage::PlanesStage;
pub use stage::{PlanesChoice, Shading};
pub use synthesis::{PlaneWork, Thresholds};
