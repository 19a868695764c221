//! Bytes of a buffer that the device has written; for work that may wait.

use super::super::{Gpu, GpuError};

/// Waits for everything submitted and copies `buffer` out.
pub(super) fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer) -> Result<Vec<u8>, GpuError> {
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu.wait()?;
    let bytes = buffer.get_mapped_range(..).map(|range| range.to_vec());
    buffer.unmap();
    bytes.map_err(|error| GpuError::Failed {
        adapter: gpu.name.clone(),
        reason: error.to_string(),
    })
}
