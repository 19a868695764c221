//! Shadowing planes on the GPU: baking ahead of time, and in each frame the sums of basis
//! images over the light of now.

mod atlas;
mod bake_passes;
mod bake_scene;
pub mod baker;
mod compute;
pub mod luminance;
mod mend;
mod readback;
mod receiver;
mod shown;
mod source_drawing;
mod source_images;
mod source_slots;
mod source_stage;
mod stage;
pub mod synthesis;

/// Compact sources at most that get lights of their own beside the dome's faces: outdoors the sun
/// is the only one; of more sources in a room the third throws faint shadows.
pub const SOURCES: usize = 2;

pub use baker::{Progress, bake};
pub use mend::mend;
pub use source_images::SourceBaker;
pub use stage::{PlanesChoice, PlanesStage};
pub use synthesis::{PlaneWork, Thresholds};
