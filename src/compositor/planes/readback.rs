//! Bytes of a buffer that the device has written; for what may wait.

use super::super::gpu::{Gpu, GpuError};

/// Waits for everything submitted and shows `buffer` to `look`.
pub(super) fn look_at<T>(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    look: impl FnOnce(&[u8]) -> T,
) -> Result<T, GpuError> {
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu.wait()?;
    let seen = buffer.get_mapped_range(..).map(|range| look(&range));
    buffer.unmap();
    seen.map_err(|error| GpuError::Failed {
        adapter: gpu.name.clone(),
        reason: error.to_string(),
    })
}

/// The same, copied.
pub(super) fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
    look_at(gpu, buffer, <[u8]>::to_vec)
}
