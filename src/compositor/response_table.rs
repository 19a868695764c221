//! The camera's response curve on the GPU.

use super::textures::FrameTexture;
use crate::compiled::Device;
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
    pub fn new(device: &Device, queue: &wgpu::Queue, response: &Response) -> Self {
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

/// The real picture of a frame.
#[derive(Clone, Copy)]
pub struct RealPicture<'a> {
    /// The undistorted camera picture.
    pub camera: &'a FrameTexture,
    /// The same in another exposure, linear, if the frame is shown in one.
    pub exposed: Option<&'a FrameTexture>,
    pub codes: &'a ResponseTable,
}

impl<'a> RealPicture<'a> {
    /// The picture in the exposure of the frame.
    pub fn shown(&self) -> &'a FrameTexture {
        self.exposed.unwrap_or(self.camera)
    }
}
