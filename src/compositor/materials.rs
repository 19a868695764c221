//! Materials on the GPU: textures with all their levels, and their bind groups.

use super::bindings::{group, sampler, view};
use penumbra_scene::{Material, SceneTexture};
use std::sync::Arc;
use wgpu::util::{DeviceExt, TextureDataOrder};

/// Uploads materials.
pub struct MaterialUploader<'a> {
    device: &'a wgpu::Device,
    queue: &'a wgpu::Queue,
    layout: &'a wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl<'a> MaterialUploader<'a> {
    pub fn new(
        device: &'a wgpu::Device,
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
        let levels = mip_chain(t, format == wgpu::TextureFormat::Rgba8UnormSrgb);
        let data: Vec<u8> = levels.concat();
        let descriptor = wgpu::TextureDescriptor {
            label: Some("surface"),
            size: wgpu::Extent3d {
                width: t.width,
                height: t.height,
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
