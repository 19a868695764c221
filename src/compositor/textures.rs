//! Textures of one picture size, and the formats on which passes and shaders agree.

use crate::compiled::Device;
use wgpu::{TextureFormat as F, TextureUsages as U};

/// Formats on which passes and textures must agree.
pub mod format {
    use wgpu::TextureFormat as F;
    pub const DEPTH: F = F::Depth32Float;
    pub const CAMERA: F = F::Rgba8Unorm;
    pub const OUTPUT: F = F::Rgba8Unorm;
    pub const PHANTOM_NORMAL: F = F::Rgba16Float;
    pub const VIRTUAL: [F; 2] = [F::Rgba16Uint, F::Rgba16Uint];
    pub const LIGHT: F = F::Rgba16Float;
    pub const TILES: F = F::Rgba32Uint;
    pub const LAMP_TILES: F = F::R32Uint;
    pub const LIGHT_TEXEL: F = F::Rgba32Uint;
    pub const COVERED: F = F::R8Uint;
    pub const PLACE: F = F::Rg16Uint;
    pub const PAGE_TABLE: F = F::R32Uint;
}

/// Side of a tile, picture pixels.
pub const TILE: u32 = 32;

/// Usage of a picture that a pass draws and a later pass reads.
pub const DRAWN: U = U::RENDER_ATTACHMENT.union(U::TEXTURE_BINDING);

/// Tiles across and down a picture of `size` pixels.
pub const fn tile_grid((width, height): (u32, u32)) -> (u32, u32) {
    (width.div_ceil(TILE), height.div_ceil(TILE))
}

/// Size in texels of a picture with one texel per `step` pixels of `size`, each way.
pub const fn coarse_size((width, height): (u32, u32), step: u32) -> (u32, u32) {
    (width.div_ceil(step), height.div_ceil(step))
}

/// A texture and the view of all of it. A clone is another handle to the same texture.
#[derive(Clone, Debug)]
pub struct FrameTexture {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
}

impl FrameTexture {
    /// Allocates a texture of `size` (width, height) texels with one sample and one level.
    pub fn new(device: &Device, label: &str, size: (u32, u32), format: F, usage: U) -> Self {
        Self::allocate(device, label, size, format, usage, (1, 1))
    }

    /// Allocates a texture with `samples` samples a pixel.
    pub fn multisampled(
        device: &Device,
        label: &str,
        size: (u32, u32),
        format: F,
        samples: u32,
    ) -> Self {
        Self::allocate(device, label, size, format, DRAWN, (samples, 1))
    }

    /// Allocates a texture with `levels` mip levels.
    pub fn with_levels(
        device: &Device,
        label: &str,
        size: (u32, u32),
        format: F,
        levels: u32,
    ) -> Self {
        Self::allocate(device, label, size, format, DRAWN, (1, levels))
    }

    fn allocate(
        device: &Device,
        label: &str,
        (width, height): (u32, u32),
        format: F,
        usage: U,
        (sample_count, mip_level_count): (u32, u32),
    ) -> Self {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count,
            sample_count,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { texture, view }
    }

    /// Width and height, pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.texture.width(), self.texture.height())
    }

    /// Uploads the rows of a picture of this size, without gaps, with `texel_bytes` bytes a texel.
    pub fn upload(&self, queue: &wgpu::Queue, texels: &[u8], texel_bytes: u32) {
        queue.write_texture(
            self.texture.as_image_copy(),
            texels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(texel_bytes * self.texture.width()),
                rows_per_image: None,
            },
            self.texture.size(),
        );
    }
}
