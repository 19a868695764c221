//! Shadowing planes on the GPU: baking in advance, and in each frame the sums of the basis images,
//! weighted with the current light.

pub(crate) mod options;

// Baking.
mod bake_passes;
mod bake_scene;
pub mod baker;
mod receiver;
mod repair;

// In each frame, on the device: the light of the faces, the images of compact sources, the sums.
mod atlas;
pub mod luminance;
mod on_pixels;
mod source_bake;
mod source_images;
mod source_slots;
mod source_stage;
mod source_targets;
pub mod synthesis;

// The same on the processor, where it is the device: sums, and their light on surfaces.
mod choice;
mod normal_table;
mod on_surfaces;
mod page_light;
mod plane_sums;
mod served_pages;
mod visible_pages;

pub(crate) mod stage;
mod uploader;
mod visible_planes;

mod compute;
mod readback;

pub use baker::{Progress, bake};
pub use options::{MAX_SOURCES, PlanesChoice, Thresholds};
pub use repair::repair;
pub use source_images::SourceBaker;
pub use stage::PlanesStage;
pub use synthesis::PlaneWork;
pub use uploader::PlanesUploader;
