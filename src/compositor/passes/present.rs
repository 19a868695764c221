//! Shows the finished picture on a window surface, as large as it fits.

use super::super::bindings::{PipelineSpec, Slot, group, layout, sampler, view};
use super::super::compiled::Device;
use super::super::recorder::cover;
use super::super::shaders;

/// The pass.
pub struct PresentPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    smooth: wgpu::Sampler,
    placement: wgpu::Buffer,
    srgb: bool,
}

impl PresentPass {
    /// Compiles the pass for surfaces of `surface_format`.
    pub fn new(device: &Device, surface_format: wgpu::TextureFormat) -> Self {
        let shader = shaders::shader("present", shaders::Variant::PLAIN);
        let layout = layout(
            device,
            "present",
            &[Slot::Texture, Slot::Sampler, Slot::Uniform],
        );
        let pipeline = PipelineSpec {
            label: "present",
            shader: &shader,
            groups: &[&layout],
            vertex: "cover",
            buffers: &[],
            fragment: Some("present"),
            targets: &[surface_format],
            colours: wgpu::ColorWrites::ALL,
            depth: None,
            cull: None,
            samples: 1,
        }
        .build(device);
        let smooth = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let placement = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("placement"),
            size: 32,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        Self {
            pipeline,
            layout,
            smooth,
            placement,
            srgb: surface_format.is_srgb(),
        }
    }

    /// Records the pass: shows `picture` on `surface`, each with its width and height in pixels.
    pub fn record(
        &self,
        (device, queue): (&Device, &wgpu::Queue),
        encoder: &mut wgpu::CommandEncoder,
        (picture, picture_size): (&wgpu::TextureView, (u32, u32)),
        (surface, surface_size): (&wgpu::TextureView, (u32, u32)),
    ) {
        let placement = placement(picture_size, surface_size, self.srgb);
        queue.write_buffer(&self.placement, 0, bytemuck::cast_slice(&placement));
        let inputs = group(
            device,
            "present",
            &self.layout,
            &[
                view(picture),
                sampler(&self.smooth),
                self.placement.as_entire_binding(),
            ],
        );
        cover(
            encoder,
            "present",
            surface,
            None,
            &self.pipeline,
            &[&inputs],
        );
    }
}

/// Twin of WGSL `Placement`: the largest centred rectangle with the picture's aspect ratio.
fn placement(picture: (u32, u32), surface: (u32, u32), srgb: bool) -> [f32; 8] {
    let (pw, ph) = (picture.0 as f32, picture.1 as f32);
    let (sw, sh) = (surface.0.max(1) as f32, surface.1.max(1) as f32);
    let zoom = (sw / pw).min(sh / ph);
    let (x, y) = (sw / (pw * zoom), sh / (ph * zoom));
    [
        x,
        y,
        0.5 - 0.5 * x,
        0.5 - 0.5 * y,
        sw,
        sh,
        f32::from(u8::from(srgb)),
        0.0,
    ]
}

#[cfg(test)]
mod tests {
    use super::placement;

    #[test]
    fn wide_window_has_bars_left_and_right() {
        let [sx, sy, ox, oy, ..] = placement((640, 480), (1920, 1080), false);
        assert!((sy - 1.0).abs() < 1e-6 && oy.abs() < 1e-6);
        // The picture's left edge (u = 0) lies at (1920 − 1440) / 2 = 240 pixels.
        assert!((240.0 / 1920.0 * sx + ox).abs() < 1e-5);
    }
}
