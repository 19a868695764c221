//! The intermediate pictures of a frame, allocated once per picture size.

use super::passes::exposure::ExposedPictures;
use super::passes::phantom_geometry::PhantomPictures;
use super::passes::shadow_buffer::ShadowPictures;
use super::passes::surroundings::SurroundingsPictures;
use super::passes::tiles::TilePictures;
use super::passes::virtual_geometry::VirtualPictures;
use super::textures::{DRAWN, FrameTexture, format, tile_grid};
use wgpu::TextureUsages as U;

/// Textures of one picture size, in the order in which a frame draws them.
pub struct SizedResources {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// The camera picture, undistorted.
    pub camera: FrameTexture,
    /// The camera picture in another exposure; allocated when that is first needed.
    pub exposed: Option<ExposedPictures>,
    pub phantoms: PhantomPictures,
    pub virtual_surfaces: VirtualPictures,
    /// Tiles that virtual surfaces may cover; uploaded.
    pub covered_tiles: FrameTexture,
    pub tiles: TilePictures,
    pub shadows: ShadowPictures,
    /// Linear light that virtual lights add to the real picture, where it is not a part of the
    /// shadow buffer.
    pub lamp_light: FrameTexture,
    pub surroundings: SurroundingsPictures,
    /// Depth buffer of the composite: the kind of each pixel.
    pub kinds: FrameTexture,
    /// The composed picture.
    pub output: FrameTexture,
}

impl SizedResources {
    /// Allocates textures for pictures of `size` with `samples` samples a pixel and `shadow_step`
    /// pixels per texel of the shadow buffer, each way.
    pub fn new(device: &wgpu::Device, size: (u32, u32), samples: u32, shadow_step: u32) -> Self {
        let picture = |label, format, usage| FrameTexture::new(device, label, size, format, usage);
        let copied = DRAWN | U::COPY_SRC | U::COPY_DST;
        let uploaded = U::COPY_DST | U::TEXTURE_BINDING;
        let covered = format::COVERED;
        Self {
            size,
            camera: picture("camera", format::CAMERA, copied),
            exposed: None,
            phantoms: PhantomPictures::new(device, size),
            virtual_surfaces: VirtualPictures::new(device, size, samples),
            covered_tiles: FrameTexture::new(
                device,
                "covered tiles",
                tile_grid(size),
                covered,
                uploaded,
            ),
            tiles: TilePictures::new(device, size),
            shadows: ShadowPictures::new(device, size, shadow_step),
            lamp_light: picture("lamp response", format::LIGHT, DRAWN),
            surroundings: SurroundingsPictures::new(device, size),
            kinds: picture("kinds", format::DEPTH, U::RENDER_ATTACHMENT),
            output: picture("output", format::OUTPUT, copied),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::Gpu;
    use crate::textures::TILE;

    #[test]
    fn textures_cover_pictures_of_any_size() {
        let gpu = Gpu::open(None).expect("a Vulkan driver; `make test` installs a software one");
        for (width, height) in [(1, 1), (16, 16), (101, 67), (640, 480)] {
            for step in [1, 2] {
                let pictures = SizedResources::new(&gpu.device, (width, height), 1, step);
                let (across, down) = pictures.shadows.phantom_shadow.size();
                assert!(across * step >= width && across * step < width + step);
                assert!(down * step >= height && down * step < height + step);
                let (across, down) = pictures.tiles.phantom.lights.size();
                assert!(across * TILE >= width && down * TILE >= height);
                assert_eq!(pictures.covered_tiles.size(), (across, down));
                let levels = pictures.surroundings.all.texture.mip_level_count();
                assert_eq!(pictures.surroundings.highest_level() + 1, levels);
            }
        }
    }
}
