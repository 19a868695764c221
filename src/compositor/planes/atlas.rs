//! The texture that holds all basis images.

use super::super::gpu::{Gpu, GpuError};
use super::source_targets::image_count;
use penumbra_scene::planes::Bake;

/// All stored images in one texture; each of its texels holds four texels of a row.
pub(super) struct Atlas {
    pub view: wgpu::TextureView,
    /// Number of images in a row.
    pub across: u32,
    /// Number of images of the bake.
    pub baked: u32,
}

/// Creates the texture and uploads the images of `bake`. With `sources`, reserves space for the
/// images of compact sources.
///
/// # Errors
/// The device cannot hold that many images.
pub(super) fn atlas(gpu: &Gpu, bake: &Bake, sources: bool) -> Result<Atlas, GpuError> {
    let (device, queue) = (&gpu.device, &gpu.queue);
    let side = bake.settings.resolution;
    let one = (side * side) as usize;
    let baked = (bake.texels.len() / one.max(1)) as u32;
    let added = if sources {
        image_count(bake.planes.len() as u32)
    } else {
        0
    };
    let count = (baked + added).max(1);
    let max_size = device.limits().max_texture_dimension_2d;
    let across = (4 * max_size / side).min(count);
    if count.div_ceil(across) > max_size / side {
        let (planes, lights) = (bake.planes.len(), bake.lights());
        let reason = format!(
            "{count} basis images of {planes} planes and {lights} lights; choose fewer planes, a \
             lower frequency or resolution under [planes]"
        );
        return Err(GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason,
        });
    }
    let written = wgpu::TextureUsages::STORAGE_BINDING;
    let usage = if sources {
        written
    } else {
        wgpu::TextureUsages::empty()
    };
    let texture = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("basis images"),
        size: wgpu::Extent3d {
            width: across * side / 4,
            height: count.div_ceil(across) * side,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba8Unorm,
        usage: usage | wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    upload_images(queue, &texture, bake, across);
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    Ok(Atlas {
        view,
        across,
        baked,
    })
}

/// Uploads the baked images in rows of `across`.
fn upload_images(queue: &wgpu::Queue, texture: &wgpu::Texture, bake: &Bake, across: u32) {
    let side = bake.settings.resolution;
    let one = (side * side) as usize;
    for (image, i) in bake.texels.chunks_exact(one).zip(0..) {
        let mut to = texture.as_image_copy();
        to.origin = wgpu::Origin3d {
            x: (i % across) * side / 4,
            y: (i / across) * side,
            z: 0,
        };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(side),
            rows_per_image: None,
        };
        let size = wgpu::Extent3d {
            width: side / 4,
            height: side,
            depth_or_array_layers: 1,
        };
        queue.write_texture(to, image, layout, size);
    }
}
