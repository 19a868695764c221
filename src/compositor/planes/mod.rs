//! Shadowing planes on the GPU: baking ahead of time, and in each frame the sums of basis
//! images over the light of now.

mod bake_passes;
mod bake_scene;
pub mod baker;
mod compute;
pub mod luminance;
mod mend;
mod readback;
mod receiver;
mod shown;
mod stage;
pub mod synthesis;

pub use baker::{Progress, bake};
pub use mend::mend;
pub use stage::{PlanesChoice, PlanesStage, Shading};
pub use synthesis::{PlaneWork, Thresholds};
