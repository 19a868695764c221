//! The passes that every frame runs, compiled.

use super::compiled::Device;
use super::passes::composite::CompositePass;
use super::passes::edge_tiles::EdgeTilesPass;
use super::passes::lamp_map::LampMapPass;
use super::passes::lamp_response::LampResponsePass;
use super::passes::phantom_geometry::PhantomGeometryPass;
use super::passes::shadow_buffer::ShadowBufferPass;
use super::passes::shadow_map::ShadowMapPass;
use super::passes::surroundings::SurroundingsPass;
use super::passes::tiles::TilesPass;
use super::passes::virtual_geometry::VirtualGeometryPass;
use super::scene_buffers::SceneLayouts;
use super::shaders::Variant;

/// The passes, in the order in which they run.
pub struct Pipelines {
    pub shadow_map: ShadowMapPass,
    pub lamp_map: LampMapPass,
    pub phantom_geometry: PhantomGeometryPass,
    pub virtual_geometry: VirtualGeometryPass,
    pub tiles: TilesPass,
    pub shadow_buffer: ShadowBufferPass,
    pub edge_tiles: EdgeTilesPass,
    pub lamp_response: LampResponsePass,
    pub surroundings: SurroundingsPass,
    pub composite: CompositePass,
}

impl Pipelines {
    /// Compiles all passes; `frame` and `scene` are the layouts that they share.
    pub fn new(
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        Self {
            shadow_map: ShadowMapPass::new(device, frame, scene),
            lamp_map: LampMapPass::new(device, scene),
            phantom_geometry: PhantomGeometryPass::new(device, frame, scene, variant),
            virtual_geometry: VirtualGeometryPass::new(device, frame, scene, variant),
            tiles: TilesPass::new(device, frame, variant),
            shadow_buffer: ShadowBufferPass::new(device, frame, variant),
            edge_tiles: EdgeTilesPass::new(device, frame, variant),
            lamp_response: LampResponsePass::new(device, frame, scene, variant),
            surroundings: SurroundingsPass::new(device, frame, variant),
            composite: CompositePass::new(device, frame, variant),
        }
    }
}
