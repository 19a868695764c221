//! Shadowing planes on the GPU: baking in advance, and in each frame the sums of the basis images,
//! weighted with the current light.

mod atlas;
mod bake_passes;
mod bake_scene;
pub mod baker;
mod compute;
pub mod luminance;
pub(crate) mod options;
mod readback;
mod receiver;
mod repair;
mod source_bake;
mod source_images;
mod source_slots;
mod source_stage;
mod source_targets;
pub(crate) mod stage;
pub mod synthesis;
mod visible_planes;

pub use baker::{Progress, bake};
pub use options::{MAX_SOURCES, PlanesChoice, Thresholds};
pub use repair::repair;
pub use source_images::SourceBaker;
pub use stage::PlanesStage;
pub use synthesis::PlaneWork;
