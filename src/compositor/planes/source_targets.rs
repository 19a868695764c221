//! Counts and indices of the images of compact sources, and the resources into which they are
//! written.

use super::options::MAX_SOURCES;

/// Images per plane and light: past all casters, and past phantoms alone.
pub(super) const KINDS: u32 = 2;

/// Lights that sources add to those of the dome: one per set of images, two sets per source.
pub(super) const SOURCE_LIGHTS: usize = 2 * MAX_SOURCES;

/// Number of images that sources add to those of a bake.
pub(super) const fn image_count(planes: u32) -> u32 {
    SOURCE_LIGHTS as u32 * KINDS * planes
}

/// The resources into which the images of compact sources are written.
pub(super) struct SourceTargets<'a> {
    pub planes: usize,
    /// Number of lights of the dome; those of sources follow them.
    pub dome_lights: u32,
    /// Directions of lights.
    pub faces: &'a wgpu::Buffer,
    /// Indices of images, per plane and light.
    pub basis: &'a wgpu::Buffer,
    /// Luminances in use, per plane and light.
    pub applied: &'a wgpu::Buffer,
    /// All images.
    pub images: &'a wgpu::TextureView,
    /// Number of images in a row of the texture.
    pub across: u32,
    /// Index of the first image that the bake does not fill.
    pub first_image: u32,
}
