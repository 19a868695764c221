//! The camera's response curve on the GPU.

use penumbra_camera::Response;

/// Entries of the table of the inverse response.
pub const ENCODING: u32 = 4096;

/// The response and its inverse: linear light of the 256 codes, then [`ENCODING`] codes at equally
/// spaced square roots of linear light.
pub struct ResponseTable {
    pub buffer: wgpu::Buffer,
}

impl ResponseTable {
    /// Uploads the table of `response`.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, response: &Response) -> Self {
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("response table"),
            size: 4 * u64::from(256 + ENCODING),
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let encoding: Vec<f32> = (0..ENCODING)
            .map(|i| {
                let root = i as f32 / (ENCODING - 1) as f32;
                response.encoded_from_linear(root * root)
            })
            .collect();
        let decoding = bytemuck::cast_slice(&response.linear_from_code()[..]);
        queue.write_buffer(&buffer, 0, decoding);
        queue.write_buffer(&buffer, 1024, bytemuck::cast_slice(&encoding));
        Self { buffer }
    }

    /// The table as a resource of a bind group.
    pub fn binding(&self) -> wgpu::BindingResource<'_> {
        self.buffer.as_entire_binding()
    }
}
