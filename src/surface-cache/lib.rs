//! Keeps the light that reaches surfaces in texels on those surfaces, so that a picture costs one
//! look-up per pixel whatever the number of lights.
#![doc = include_str!("README.md")]

mod cache;
mod casters;
mod charts;
mod depth_map;
mod disc;
mod indirect;
mod lanes;
mod lattice;
mod layout;
mod ranges;
mod receivers;
mod renewal;
mod sampling;
mod split;
mod sums;
#[cfg(test)]
mod tests;
mod texels;
mod visibility;

pub use cache::{CacheOptions, ReceiverPage, SurfaceCache, SurfaceLight};
pub use indirect::{fill as fill_indirect, fill_on_virtual as fill_indirect_on_virtual};
pub use layout::{BORDERED, Bounds, PAGE, TABLE_WIDTH, TEXELS};
pub use receivers::Layer;
pub use split::{CacheVertex, SplitMesh};
pub use texels::PageTexels;
