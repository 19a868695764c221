//! Reads buffers that the device has written. Blocks, so it is not for the frame path.

use super::super::gpu::{Gpu, GpuError};

/// Waits for all submitted work and passes the bytes of `buffer` to `read`.
pub(super) fn with_bytes<T>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    read: impl FnOnce(&[u8]) -> T,
) -> Result<T, GpuError> {
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu.wait()?;
    let result = buffer.get_mapped_range(..).map(|range| read(&range));
    buffer.unmap();
    result.map_err(|error| GpuError::Failed {
        adapter: gpu.name.clone(),
        reason: error.to_string(),
    })
}

/// Waits for all submitted work and returns a copy of the bytes of `buffer`.
pub(super) fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
    with_bytes(gpu, buffer, <[u8]>::to_vec)
}
