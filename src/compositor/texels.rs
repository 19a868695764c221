//! Half-float texels and their upload.

use half::f16;
use half::slice::HalfFloatSliceExt;

/// The greatest number of a texel: half floats end at 65504; radiance of the sun can be higher.
const LARGEST: f32 = 65_000.0;

/// RGB as a texel with an alpha of 1.
pub fn half_texel([r, g, b]: [f32; 3]) -> [f16; 4] {
    [r, g, b, 1.0].map(|x| f16::from_f32(x.min(LARGEST)))
}

/// Many texels of [`half_texel`], several at a time.
#[derive(Default)]
pub struct HalfTexels {
    floats: Vec<[f32; 4]>,
    texels: Vec<[f16; 4]>,
}

impl HalfTexels {
    /// Converts `from`; the memory of the call before is reused.
    pub fn converted(&mut self, from: &[[f32; 3]]) -> &[[f16; 4]] {
        let limited = |&[r, g, b]: &[f32; 3]| [r, g, b, 1.0].map(|x: f32| x.min(LARGEST));
        self.floats.clear();
        self.floats.extend(from.iter().map(limited));
        self.texels.resize(from.len(), [f16::ZERO; 4]);
        let floats = self.floats.as_flattened();
        self.texels
            .as_flattened_mut()
            .convert_from_f32_slice(floats);
        &self.texels
    }
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

    #[test]
    fn many_texels_are_those_of_one_at_a_time() {
        let mut all = HalfTexels::default();
        for count in [7, 3] {
            let from: Vec<[f32; 3]> = (0..count).map(|k| [1e9, 0.1 * k as f32, -0.3]).collect();
            let each: Vec<[f16; 4]> = from.iter().map(|t| half_texel(*t)).collect();
            assert_eq!(all.converted(&from), each);
        }
    }
}
