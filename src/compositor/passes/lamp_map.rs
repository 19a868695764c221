//! Draws all casters into the shadow maps of the virtual lights that have moved.

use super::super::bindings::{CachedGroup, DepthTest, POSITION_LAYOUT, PipelineSpec, Slot};
use super::super::compiled::Device;
use super::super::lamp_maps::LampMaps;
use super::super::recorder::{Recorder, cleared_depth};
use super::super::scene_buffers::{SceneBuffers, SceneLayouts, draw_casters};
use super::super::shaders;

/// The pass.
pub struct LampMapPass {
    pipeline: wgpu::RenderPipeline,
    views: CachedGroup,
}

impl LampMapPass {
    pub fn new(device: &Device, scene: &SceneLayouts) -> Self {
        let shader = shaders::shader("lamp_map", shaders::Variant::PLAIN);
        // Not the group of the frame: that holds the maps that are drawn here.
        let views = CachedGroup::from_slots(device, "lamp views", &[Slot::Uniform]);
        let pipeline = PipelineSpec {
            label: "lamp_map",
            shader: &shader,
            groups: &[&views.layout, &scene.part],
            vertex: "lamp_caster",
            buffers: &[POSITION_LAYOUT],
            fragment: None,
            targets: &[],
            colours: wgpu::ColorWrites::ALL,
            depth: Some(DepthTest::NEAREST),
            cull: None,
            samples: 1,
        }
        .build(device);
        Self { pipeline, views }
    }

    /// Draws the layers that are out of date.
    pub fn record(&mut self, r: &mut Recorder<'_>, scene: &SceneBuffers, maps: &LampMaps) {
        let Some(last) = maps.draws.len().checked_sub(1) else {
            return;
        };
        let views = [maps.views.as_entire_binding()];
        let views = self.views.get(r.device, &views);
        for (k, draw) in maps.draws.iter().enumerate() {
            let layer = &maps.layers[draw.layer as usize];
            let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("lamp_map"),
                depth_stencil_attachment: cleared_depth(layer, 0.0),
                timestamp_writes: r.timer.span("lamp_map", k == 0, k == last),
                ..Default::default()
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, views, &[]);
            for (tile, view) in (0..draw.across * draw.across).zip(draw.view..) {
                let side = maps.size() / draw.across;
                let [x, y] = [tile % draw.across, tile / draw.across].map(|c| (c * side) as f32);
                pass.set_viewport(x, y, side as f32, side as f32, 0.0, 1.0);
                let places = &scene.caster_places;
                draw_casters(&mut pass, places, scene.virtual_caster_meshes(), view);
                draw_casters(&mut pass, places, scene.phantom_caster_meshes(), view);
            }
        }
    }
}
