//! Indirect light on the GPU: the light that virtual objects reflect onto the real scene and onto
//! each other.

use super::texels::half_texel;
use crate::compiled::Device;
use half::f16;
use penumbra_scene::IndirectLight;
use penumbra_scene::indirect_light::{GRID_SIDE, GROUND_SIDE, SurfaceIrradiance, VOLUME_SIZE};

/// Kinds of irradiance on surfaces.
const SURFACE_KINDS: usize = 3;

/// Three pictures of the ground side by side (change by virtual objects, light reflected by
/// phantoms without them and with them; in alpha, the ground's share of its light); six volumes of the
/// light of phantoms in the air; and six each of the irradiance on virtual surfaces, its change on real
/// ones, and what these have of it without virtual objects.
pub struct IndirectLightMaps {
    ground: wgpu::Texture,
    volume: wgpu::Texture,
    on_surfaces: wgpu::Texture,
    pub ground_view: wgpu::TextureView,
    pub volume_view: wgpu::TextureView,
    pub on_surfaces_view: wgpu::TextureView,
}

impl IndirectLightMaps {
    pub fn new(device: &Device) -> Self {
        let [nx, ny, nz] = VOLUME_SIZE;
        let ground = texture(
            device,
            wgpu::TextureDimension::D2,
            [3 * GROUND_SIDE, GROUND_SIDE, 1],
        );
        let volume = texture(device, wgpu::TextureDimension::D3, [6 * nx, ny, nz]);
        let kinds = SURFACE_KINDS as u32;
        let grid = [6 * GRID_SIDE, GRID_SIDE, kinds * GRID_SIDE];
        let on_surfaces = texture(device, wgpu::TextureDimension::D3, grid);
        let view = |t: &wgpu::Texture| t.create_view(&wgpu::TextureViewDescriptor::default());
        Self {
            ground_view: view(&ground),
            volume_view: view(&volume),
            on_surfaces_view: view(&on_surfaces),
            ground,
            volume,
            on_surfaces,
        }
    }

    /// Uploads `light`; `texels` is a recycled buffer.
    pub fn write(&self, queue: &wgpu::Queue, light: &IndirectLight, texels: &mut Vec<[f16; 4]>) {
        let on_surfaces = [
            &light.on_virtual,
            &light.change.surfaces,
            &light.real.surfaces,
        ];
        self.write_on_surfaces(queue, on_surfaces, texels);
        let all = [
            &light.change.ground,
            &light.real.ground,
            &light.real_now.ground,
        ];
        let side = GROUND_SIDE as usize;
        if all.iter().all(|ground| ground.len() == side * side) {
            texels.clear();
            for (y, ground) in (0..side).flat_map(|y| all.map(|ground| (y, ground))) {
                let row = &ground[y * side..(y + 1) * side];
                let shares = light.nearby.ground.get(y * side..(y + 1) * side);
                texels.extend(row.iter().enumerate().map(|(x, t)| {
                    let [r, g, b, _] = half_texel(t.to_array());
                    let share = shares.map_or(1.0, |shares| shares[x].element_sum() / 3.0);
                    [r, g, b, f16::from_f32(share)]
                }));
            }
            upload(queue, &self.ground, texels);
        }
        let [nx, ny, nz] = VOLUME_SIZE.map(|n| n as usize);
        let faces = &light.real_now.volume;
        if faces.iter().any(|face| face.len() != nx * ny * nz) {
            return;
        }
        texels.clear();
        for row in 0..ny * nz {
            for face in faces {
                let values = &face[row * nx..(row + 1) * nx];
                texels.extend(values.iter().map(|t| half_texel(t.to_array())));
            }
        }
        upload(queue, &self.volume, texels);
    }

    /// Uploads the irradiance times weight in the cells that have one, with the weight in alpha.
    fn write_on_surfaces(
        &self,
        queue: &wgpu::Queue,
        kinds: [&SurfaceIrradiance; SURFACE_KINDS],
        texels: &mut Vec<[f16; 4]>,
    ) {
        let size = (6 * GRID_SIDE * GRID_SIDE * GRID_SIDE) as usize;
        texels.clear();
        texels.resize(SURFACE_KINDS * size, [f16::ZERO; 4]);
        for (kind, light) in kinds.into_iter().enumerate() {
            for ((texel, weight), value) in light.grid.cells.iter().zip(&light.values) {
                let [r, g, b, _] = half_texel(value.to_array());
                texels[kind * size + *texel as usize] = [r, g, b, f16::from_f32(*weight)];
            }
        }
        upload(queue, &self.on_surfaces, texels);
    }
}

fn texture(
    device: &Device,
    dimension: wgpu::TextureDimension,
    [width, height, depth]: [u32; 3],
) -> wgpu::Texture {
    device.create_texture(&wgpu::TextureDescriptor {
        label: Some("indirect light"),
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
