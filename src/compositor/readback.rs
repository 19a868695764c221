//! Copies the finished picture into memory.

use super::gpu::{Gpu, GpuError};
use crate::compiled::Device;
use penumbra_picture::Picture;

/// A buffer into which pictures of one size are copied.
pub struct Readback {
    buffer: wgpu::Buffer,
    width: u32,
    height: u32,
    row: u32,
}

impl Readback {
    /// Allocates the buffer for pictures of `width` × `height` pixels.
    #[must_use]
    pub fn new(device: &Device, (width, height): (u32, u32)) -> Self {
        let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: u64::from(row) * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        Self {
            buffer,
            width,
            height,
            row,
        }
    }

    /// Whether the buffer was made for pictures of this size.
    #[must_use]
    pub const fn fits(&self, size: (u32, u32)) -> bool {
        self.width == size.0 && self.height == size.1
    }

    /// Records the copy of `texture`.
    pub fn record(&self, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) {
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &self.buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(self.row),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d {
                width: self.width,
                height: self.height,
                depth_or_array_layers: 1,
            },
        );
    }

    /// Waits for the copy and moves it into `picture`, whose memory is reused.
    ///
    /// # Errors
    /// The device was lost, ran out of memory or refused a command.
    pub fn read(&self, gpu: &Gpu, picture: &mut Picture) -> Result<(), GpuError> {
        let failed = |reason: String| GpuError::Failed {
            adapter: gpu.name.clone(),
            reason,
        };
        self.buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        gpu.wait()?;
        let mapped = self
            .buffer
            .get_mapped_range(..)
            .map_err(|e| failed(e.to_string()))?;
        (picture.width, picture.height) = (self.width, self.height);
        picture.rgba.clear();
        for row in mapped.chunks_exact(self.row as usize) {
            picture
                .rgba
                .extend_from_slice(&row[..4 * self.width as usize]);
        }
        drop(mapped);
        self.buffer.unmap();
        Ok(())
    }
}
