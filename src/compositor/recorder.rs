//! The context in which passes record their commands into a frame.

use super::compiled::Device;
use super::timing::Timer;

/// The command encoder of a frame, the device that makes bind groups, and the timer of passes.
pub struct Recorder<'a> {
    pub device: &'a Device,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub timer: &'a mut Timer,
}

impl Recorder<'_> {
    /// Records a timed pass that covers `output` with one triangle.
    pub fn cover(
        &mut self,
        label: &'static str,
        output: &wgpu::TextureView,
        pipeline: &wgpu::RenderPipeline,
        groups: &[&wgpu::BindGroup],
    ) {
        let span = self.timer.span(label, true, true);
        cover(self.encoder, label, output, span, pipeline, groups);
    }
}

/// A colour attachment that is cleared to transparent black.
pub const fn cleared(view: &wgpu::TextureView) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    colour(view, wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT))
}

/// A colour attachment.
pub const fn colour(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations {
            load,
            store: wgpu::StoreOp::Store,
        },
    })
}

/// A depth attachment that is cleared to `far`.
pub const fn cleared_depth(
    view: &wgpu::TextureView,
    far: f32,
) -> Option<wgpu::RenderPassDepthStencilAttachment<'_>> {
    depth(view, wgpu::LoadOp::Clear(far))
}

/// A depth attachment.
pub const fn depth(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<f32>,
) -> Option<wgpu::RenderPassDepthStencilAttachment<'_>> {
    Some(wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations {
            load,
            store: wgpu::StoreOp::Store,
        }),
        stencil_ops: None,
    })
}

/// Binds `groups` in order.
pub fn bind_all(pass: &mut wgpu::RenderPass<'_>, groups: &[&wgpu::BindGroup]) {
    for (group, index) in groups.iter().zip(0..) {
        pass.set_bind_group(index, *group, &[]);
    }
}

/// Records a pass that covers `output` with one triangle.
pub fn cover(
    encoder: &mut wgpu::CommandEncoder,
    label: &str,
    output: &wgpu::TextureView,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    pipeline: &wgpu::RenderPipeline,
    groups: &[&wgpu::BindGroup],
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[cleared(output)],
        timestamp_writes,
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    bind_all(&mut pass, groups);
    pass.draw(0..3, 0..1);
}
