//! One pass = one file here = one shader of the same name.

pub mod composite;
pub mod exposure;
pub mod lamp_map;
pub mod lamp_response;
pub mod phantom_geometry;
pub mod present;
pub mod shadow_buffer;
pub mod shadow_map;
pub mod surroundings;
pub mod tiles;
pub mod virtual_geometry;

/// A colour attachment that starts black.
pub const fn cleared(view: &wgpu::TextureView) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    Some(wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations {
            load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
            store: wgpu::StoreOp::Store,
        },
    })
}

/// A depth attachment that starts at `far`.
pub const fn cleared_depth(
    view: &wgpu::TextureView,
    far: f32,
) -> Option<wgpu::RenderPassDepthStencilAttachment<'_>> {
    Some(wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations {
            load: wgpu::LoadOp::Clear(far),
            store: wgpu::StoreOp::Store,
        }),
        stencil_ops: None,
    })
}

/// Records a pass that covers `view` with one triangle.
pub fn cover(
    encoder: &mut wgpu::CommandEncoder,
    label: &str,
    view: &wgpu::TextureView,
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
    pipeline: &wgpu::RenderPipeline,
    groups: &[&wgpu::BindGroup],
) {
    let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[cleared(view)],
        timestamp_writes,
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    for (group, index) in groups.iter().zip(0..) {
        pass.set_bind_group(index, *group, &[]);
    }
    pass.draw(0..3, 0..1);
}
