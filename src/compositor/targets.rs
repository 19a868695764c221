//! The textures a picture passes through; made once per picture size.

use wgpu::{TextureFormat as F, TextureUsages as U};

/// Formats that passes and targets must agree on.
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
}

/// Side of a tile, picture pixels.
pub const TILE: u32 = 32;

/// Entries of the inverse response's table.
pub const ENCODING: u32 = 4096;

/// A texture and the view of all of it.
pub struct Target {
    pub texture: wgpu::Texture,
    pub view: wgpu::TextureView,
}

/// All of them.
pub struct Targets {
    pub width: u32,
    pub height: u32,
    pub camera: Target,
    /// The response and its inverse: 256 and [`ENCODING`] floats.
    pub codes: wgpu::Buffer,
    pub phantom_normal: Target,
    pub phantom_depth: Target,
    /// Shape and material of virtual surfaces, packed.
    pub virtual_surface: [Target; 2],
    pub virtual_depth: Target,
    /// Of which kind a pixel is, for the composite.
    pub kinds: Target,
    /// Which texels of the shadow buffer there is work for.
    pub marks: Target,
    /// Factor (or subtrahend) of the real picture.
    pub shadow: Target,
    /// Linear light that lamps add to the real picture, where it is not part of that factor.
    pub response: Target,
    /// Irradiance left on virtual surfaces, packed.
    pub light: Target,
    /// Linear shadowed picture, level 0 at half size.
    pub surroundings: Target,
    pub surroundings_levels: Vec<wgpu::TextureView>,
    /// Masks of lights per tile, for phantom and virtual surfaces.
    pub tiles: [Target; 2],
    /// Masks of lamps per tile, likewise.
    pub lamp_tiles: [Target; 2],
    /// Tiles in which virtual surfaces can be.
    pub covered: Target,
    pub output: Target,
}

impl Target {
    /// One sample, one level.
    pub fn new(device: &wgpu::Device, label: &str, size: (u32, u32), format: F, usage: U) -> Self {
        Maker(device).make(label, size, format, usage, 1)
    }
}

struct Maker<'a>(&'a wgpu::Device);

impl Maker<'_> {
    fn make(&self, label: &str, size: (u32, u32), format: F, usage: U, samples: u32) -> Target {
        self.levels(label, size, format, usage, samples, 1)
    }

    fn levels(
        &self,
        label: &str,
        (width, height): (u32, u32),
        format: F,
        usage: U,
        sample_count: u32,
        mip_level_count: u32,
    ) -> Target {
        let texture = self.0.create_texture(&wgpu::TextureDescriptor {
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
        Target { texture, view }
    }
}

impl Targets {
    /// Number of tiles.
    pub const fn tile_count(&self) -> u32 {
        self.width.div_ceil(TILE) * self.height.div_ceil(TILE)
    }

    /// Textures for pictures of `width` × `height` with `samples` samples a pixel and
    /// `step` pixels per shadow-buffer texel, each way.
    pub fn new(device: &wgpu::Device, width: u32, height: u32, samples: u32, step: u32) -> Self {
        let m = Maker(device);
        let (full, coarse) = (
            (width, height),
            (width.div_ceil(step), height.div_ceil(step)),
        );
        let drawn = U::RENDER_ATTACHMENT | U::TEXTURE_BINDING;
        let uploaded = U::COPY_DST | U::TEXTURE_BINDING;
        let copied = U::COPY_SRC | U::COPY_DST;
        let tiles = (width.div_ceil(TILE), height.div_ceil(TILE));
        let half = (width.div_ceil(2), height.div_ceil(2));
        let levels = (half.0.max(half.1)).ilog2().clamp(1, 7);
        let surroundings = m.levels("surroundings", half, format::LIGHT, drawn, 1, levels);
        let surroundings_levels = (0..levels)
            .map(|level| {
                surroundings
                    .texture
                    .create_view(&wgpu::TextureViewDescriptor {
                        base_mip_level: level,
                        mip_level_count: Some(1),
                        ..Default::default()
                    })
            })
            .collect();
        Self {
            width,
            height,
            camera: m.make("camera", full, format::CAMERA, drawn | copied, 1),
            codes: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("codes"),
                size: 4 * u64::from(256 + ENCODING),
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            phantom_normal: m.make("phantom normal", full, format::PHANTOM_NORMAL, drawn, 1),
            phantom_depth: m.make("phantom depth", full, format::DEPTH, drawn, 1),
            virtual_surface: format::VIRTUAL
                .map(|f| m.make("virtual surface", full, f, drawn, samples)),
            virtual_depth: m.make("virtual depth", full, format::DEPTH, drawn, samples),
            kinds: m.make("kinds", full, format::DEPTH, U::RENDER_ATTACHMENT, 1),
            marks: m.make("marks", coarse, format::DEPTH, U::RENDER_ATTACHMENT, 1),
            shadow: m.make("shadow", coarse, format::LIGHT, drawn, 1),
            response: m.make("lamp response", full, format::LIGHT, drawn, 1),
            light: m.make("light", coarse, format::LIGHT_TEXEL, drawn, 1),
            surroundings,
            surroundings_levels,
            tiles: ["phantom tiles", "virtual tiles"]
                .map(|label| m.make(label, tiles, format::TILES, drawn, 1)),
            lamp_tiles: ["phantom lamp tiles", "virtual lamp tiles"]
                .map(|label| m.make(label, tiles, format::LAMP_TILES, drawn, 1)),
            covered: m.make("covered tiles", tiles, format::COVERED, uploaded, 1),
            output: m.make("output", full, format::OUTPUT, drawn | copied, 1),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn targets_cover_pictures_of_any_size() {
        let gpu =
            crate::Gpu::open(None).expect("a Vulkan driver; `make test` installs a software one");
        for (width, height) in [(1, 1), (16, 16), (101, 67), (640, 480)] {
            for step in [1, 2] {
                let t = Targets::new(&gpu.device, width, height, 1, step);
                let size = t.shadow.texture.size();
                assert!(size.width * step >= width && size.width * step < width + step);
                assert!(size.height * step >= height && size.height * step < height + step);
                let tiles = t.tiles[0].texture.size();
                assert_eq!(tiles.width * tiles.height, t.tile_count());
                assert!(tiles.width * TILE >= width && tiles.height * TILE >= height);
                let levels = t.surroundings_levels.len() as u32;
                assert_eq!(levels, t.surroundings.texture.mip_level_count());
            }
        }
    }
}
