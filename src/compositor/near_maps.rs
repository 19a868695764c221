//! The light that virtual objects throw onto the real scene, on the GPU.

use super::light_maps::half_texel;
use crate::scene::NearLight;
use crate::scene::near_field::{GROUND_SIDE, VOLUME_SIZE};
use half::f16;

/// A picture of the ground and six volumes side by side.
pub struct NearMaps {
    ground: wgpu::Texture,
    volume: wgpu::Texture,
    pub ground_view: wgpu::TextureView,
    pub volume_view: wgpu::TextureView,
}

impl NearMaps {
    pub fn new(device: &wgpu::Device) -> Self {
        let [nx, ny, nz] = VOLUME_SIZE;
        let ground = texture(
            device,
            wgpu::TextureDimension::D2,
            [GROUND_SIDE, GROUND_SIDE, 1],
        );
        let volume = texture(device, wgpu::TextureDimension::D3, [6 * nx, ny, nz]);
        let view = |t: &wgpu::Texture| t.create_view(&wgpu::TextureViewDescriptor::default());
        Self {
            ground_view: view(&ground),
            volume_view: view(&volume),
            ground,
            volume,
        }
    }

    /// Uploads a new state; `texels` is memory to be used again.
    pub fn write(&self, queue: &wgpu::Queue, light: &NearLight, texels: &mut Vec<[f16; 4]>) {
        texels.clear();
        texels.extend(light.ground.iter().map(|t| half_texel(t.to_array())));
        if light.ground.len() == (GROUND_SIDE * GROUND_SIDE) as usize {
            upload(queue, &self.ground, texels);
        }
        let [nx, ny, nz] = VOLUME_SIZE.map(|n| n as usize);
        if light.volume.iter().any(|face| face.len() != nx * ny * nz) {
            return;
        }
        texels.clear();
        for row in 0..ny * nz {
            for face in &light.volume {
                let values = &face[row * nx..(row + 1) * nx];
                texels.extend(values.iter().map(|t| half_texel(t.to_array())));
            }
        }
        upload(queue, &self.volume, texels);
    }
}

fn texture(
    device: &wgpu::Device,
    dimension: wgpu::TextureDimension,
    [width, height, depth]: [u32; 3],
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("near light"),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: depth,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

fn upload(queue: &wgpu::Queue, texture: &wgpu::Texture, texels: &[[f16; 4]]) {
    let size = texture.size();
    queue.write_texture(
        texture.as_image_copy(),
        bytemuck::cast_slice(texels),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(size.width * 8),
            rows_per_image: Some(size.height),
        },
        size,
    );
}
