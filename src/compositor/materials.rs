//! Materials on the GPU: textures with all their levels, and their bind groups.

use super::bindings::{group, sampler, view};
use crate::compiled::Device;
use penumbra_scene::{Material, SceneTexture};
use std::sync::Arc;
use wgpu::util::{DeviceExt, TextureDataOrder};

/// Uploads materials.
pub struct MaterialUploader<'a> {
    device: &'a Device,
    queue: &'a wgpu::Queue,
    layout: &'a wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl<'a> MaterialUploader<'a> {
    pub fn new(
        device: &'a Device,
        queue: &'a wgpu::Queue,
        layout: &'a wgpu::BindGroupLayout,
    ) -> Self {
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("surface"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        Self {
            device,
            queue,
            layout,
            sampler,
        }
    }

    /// Uploads the textures of `m` and binds them.
    pub fn bind(&self, m: &Material) -> wgpu::BindGroup {
        let (srgb, plain) = (
            wgpu::TextureFormat::Rgba8UnormSrgb,
            wgpu::TextureFormat::Rgba8Unorm,
        );
        let views = [
            self.texture(m.base_colour_texture.as_ref(), srgb),
            self.texture(m.metallic_roughness_texture.as_ref(), plain),
            self.texture(m.normal_texture.as_ref(), plain),
            self.texture(m.occlusion_texture.as_ref(), plain),
            self.texture(m.emissive_texture.as_ref(), srgb),
        ];
        let mut resources = vec![sampler(&self.sampler)];
        resources.extend(views.iter().map(view));
        group(self.device, "material", self.layout, &resources)
    }

    fn texture(
        &self,
        texture: Option<&Arc<SceneTexture>>,
        format: wgpu::TextureFormat,
    ) -> wgpu::TextureView {
        let white = SceneTexture {
            width: 1,
            height: 1,
            rgba: vec![255; 4],
        };
        let t = texture.map_or(&white, |t| t.as_ref());
        let mut levels = mip_chain(t, format == wgpu::TextureFormat::Rgba8UnormSrgb);
        let (width, height) = fitted((t.width, t.height), max_side(self.device));
        // The levels of a smaller texture are those of the larger one without the first.
        levels.drain(..(t.width / width).max(t.height / height).ilog2() as usize);
        let data: Vec<u8> = levels.concat();
        let descriptor = wgpu::TextureDescriptor {
            label: Some("surface"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: levels.len() as u32,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        self.device
            .create_texture_with_data(self.queue, &descriptor, TextureDataOrder::LayerMajor, &data)
            .create_view(&wgpu::TextureViewDescriptor::default())
    }
}

/// Maximum width and height of a texture on a device, pixels.
pub fn max_side(device: &Device) -> u32 {
    device.limits().max_texture_dimension_2d
}

/// Returns the size of a texture on a device: halved until it is at most `max` each way.
#[must_use]
pub fn fitted((mut width, mut height): (u32, u32), max: u32) -> (u32, u32) {
    while width.max(height) > max.max(1) {
        (width, height) = ((width / 2).max(1), (height / 2).max(1));
    }
    (width, height)
}

/// Box-filtered levels down to one texel, averaged in linear light for sRGB textures.
fn mip_chain(texture: &SceneTexture, srgb: bool) -> Vec<Vec<u8>> {
    let mut levels = vec![texture.rgba.clone()];
    let (mut w, mut h) = (texture.width, texture.height);
    while w > 1 || h > 1 {
        let finer = levels.last().map_or(&[][..], |l| l.as_slice());
        let (nw, nh) = ((w / 2).max(1), (h / 2).max(1));
        let mut coarser = Vec::with_capacity(4 * (nw * nh) as usize);
        for y in 0..nh {
            for x in 0..nw {
                coarser.extend(box_of_four(finer, (w, h), (2 * x, 2 * y), srgb));
            }
        }
        levels.push(coarser);
        (w, h) = (nw, nh);
    }
    levels
}

fn box_of_four(rgba: &[u8], (w, h): (u32, u32), (x, y): (u32, u32), srgb: bool) -> [u8; 4] {
    use penumbra_camera::{linear_from_srgb, srgb_from_linear};
    let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
    std::array::from_fn(|c| {
        let decode = srgb && c < 3;
        let sum: f32 = corners
            .iter()
            .map(|(x, y)| {
                let i = 4 * (y.min(&(h - 1)) * w + x.min(&(w - 1))) as usize + c;
                let v = f32::from(rgba[i]) / 255.0;
                if decode { linear_from_srgb(v) } else { v }
            })
            .sum();
        let mean = sum / 4.0;
        ((if decode { srgb_from_linear(mean) } else { mean }) * 255.0).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_beyond_the_limit_is_halved_until_it_fits() {
        for (size, max, expected) in [
            ((16_384, 16_384), 4096, (4096, 4096)),
            ((5000, 10), 4096, (2500, 5)),
            ((3, 9000), 4096, (1, 2250)),
            ((4096, 1), 4096, (4096, 1)),
        ] {
            assert_eq!(fitted(size, max), expected);
        }
    }

    /// The levels of the smaller texture are the last ones of the larger one.
    #[test]
    fn dropped_levels_leave_a_complete_chain() {
        let (width, height) = (40, 12);
        let texture = SceneTexture {
            width,
            height,
            rgba: (0..4 * width * height).map(|i| (i * 7) as u8).collect(),
        };
        let (w, h) = fitted((width, height), 10);
        let dropped = (width / w).max(height / h).ilog2() as usize;
        let levels = mip_chain(&texture, false).split_off(dropped);
        assert_eq!(levels[0].len() as u32, 4 * w * h);
        assert_eq!(levels.len() as u32, w.max(h).ilog2() + 1);
    }
}
