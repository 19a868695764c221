//! Half-float texels and their upload.

use half::f16;

/// RGB as a texel with an alpha of 1. Half floats end at 65504; radiance of the sun can be higher.
pub fn half_texel([r, g, b]: [f32; 3]) -> [f16; 4] {
    [r, g, b, 1.0].map(|x| f16::from_f32(x.min(65_000.0)))
}

/// Uploads one mip level of a square texture with `layers` layers of `size` texels a side.
pub fn write_level(
    queue: &wgpu::Queue,
    texture: &wgpu::Texture,
    mip_level: u32,
    size: u32,
    layers: u32,
    texels: &[[f16; 4]],
) {
    queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level,
            origin: wgpu::Origin3d::ZERO,
            aspect: wgpu::TextureAspect::All,
        },
        bytemuck::cast_slice(texels),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(size * 8),
            rows_per_image: Some(size),
        },
        wgpu::Extent3d {
            width: size,
            height: size,
            depth_or_array_layers: layers,
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiance_beyond_half_floats_stays_finite() {
        assert!(half_texel([1e9, 1.0, 0.0]).iter().all(|v| v.is_finite()));
    }
}
