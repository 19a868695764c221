//! Numbers of the images of compact sources, and the resources into which they are written.

use super::options::SOURCES;

/// Images of each plane: past everything, and past phantoms alone.
pub(super) const KINDS: u32 = 2;

/// Lights that sources add to those of the dome: two sets of images each.
pub(super) const SOURCE_LIGHTS: usize = 2 * SOURCES;

/// Images that sources add to those of a bake.
pub(super) const fn image_count(planes: u32) -> u32 {
    SOURCE_LIGHTS as u32 * KINDS * planes
}

/// What the images of compact sources are written into.
pub(super) struct SourceTargets<'a> {
    pub planes: usize,
    /// Lights of the dome; those of sources come behind them.
    pub dome_lights: u32,
    /// Directions of lights; numbers of images and luminances in use, per plane and light.
    pub faces: &'a wgpu::Buffer,
    pub basis: &'a wgpu::Buffer,
    pub applied: &'a wgpu::Buffer,
    /// All images, how many are in a row, and the first that no bake fills.
    pub images: &'a wgpu::TextureView,
    pub across: u32,
    pub first_image: u32,
}
