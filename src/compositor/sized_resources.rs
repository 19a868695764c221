//! The intermediate pictures of a frame, allocated once per picture size.

use super::passes::exposure::ExposedPictures;
use super::passes::phantom_geometry::PhantomPictures;
use super::passes::shadow_buffer::ShadowPictures;
use super::passes::surroundings::SurroundingsPictures;
use super::passes::tiles::TilePictures;
use super::passes::virtual_geometry::VirtualPictures;
use super::shaders::Variant;
use super::textures::{DRAWN, FrameTexture, format, tile_grid};
use crate::compiled::Device;
use wgpu::TextureUsages as U;

/// Textures of one picture size, in the order in which a frame draws them.
pub struct SizedResources {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// Whether they have places in the surface cache.
    pub cached: bool,
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
    /// Upper and lower halves of tiles in which edges of the real scene matter.
    pub edge_tiles: FrameTexture,
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
    /// Allocates textures for pictures of `size` for a `variant` of the shaders.
    pub fn new(device: &Device, size: (u32, u32), variant: Variant) -> Self {
        let picture = |label, format, usage| FrameTexture::new(device, label, size, format, usage);
        let copied = DRAWN | U::COPY_SRC | U::COPY_DST;
        let uploaded = U::COPY_DST | U::TEXTURE_BINDING;
        let (across, down) = tile_grid(size);
        let grid = |label, down, usage| {
            FrameTexture::new(device, label, (across, down), format::COVERED, usage)
        };
        Self {
            size,
            cached: variant.cached,
            camera: picture("camera", format::CAMERA, copied),
            exposed: None,
            phantoms: PhantomPictures::new(device, size, variant.cached),
            virtual_surfaces: VirtualPictures::new(device, size, variant.samples, variant.cached),
            covered_tiles: grid("covered tiles", down, uploaded),
            edge_tiles: grid("edge tiles", 2 * down, DRAWN),
            tiles: TilePictures::new(device, size),
            shadows: ShadowPictures::new(device, size),
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
            let pictures = SizedResources::new(&gpu.device, (width, height), Variant::PLAIN);
            let (across, down) = pictures.shadows.phantom_shadow.size();
            assert_eq!((across, down), (width, height));
            let (across, down) = pictures.tiles.phantom.lights.size();
            assert!(across * TILE >= width && down * TILE >= height);
            assert_eq!(pictures.covered_tiles.size(), (across, down));
            let levels = pictures.surroundings.all.texture.mip_level_count();
            assert_eq!(pictures.surroundings.highest_level() + 1, levels);
        }
    }
}
