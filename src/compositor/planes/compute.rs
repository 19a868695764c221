//! Buffers of compute passes.

use crate::compiled::Device;

/// Creates a buffer of `bytes` bytes (at least 16), zeroed.
pub(super) fn buffer_of(
    device: &Device,
    label: &str,
    bytes: u64,
    usage: wgpu::BufferUsages,
) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: bytes.max(16).next_multiple_of(16),
        usage,
        mapped_at_creation: false,
    })
}

/// Creates a storage buffer with `contents`, or with zeros if they are empty.
pub(super) fn storage<T: bytemuck::Pod>(
    device: &Device,
    queue: &wgpu::Queue,
    label: &str,
    contents: &[T],
) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
    let bytes: &[u8] = bytemuck::cast_slice(contents);
    let buffer = buffer_of(device, label, bytes.len() as u64, usage);
    // Writes are multiples of four bytes.
    let length = bytes.len() - bytes.len() % 4;
    if length > 0 {
        queue.write_buffer(&buffer, 0, &bytes[..length]);
    }
    buffer
}
