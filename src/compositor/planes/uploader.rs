//! Uploads bakes to the device, beside the frame path.

use super::super::gpu::{Gpu, GpuError};
use super::super::shaders::Variant;
use super::source_images::SourceBaker;
use super::stage::PlanesStage;
use penumbra_scene::planes::Bake;
use penumbra_surface_cache::ReceiverPage;
use std::sync::Arc;

/// Prepares bakes for [`crate::Compositor::show_planes`] of the compositor that returned it.
pub struct PlanesUploader {
    /// The device of the compositor.
    pub gpu: Gpu,
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    /// The variant of frames.
    pub(crate) variant: Variant,
    /// The surface cache of the scene, if there is one.
    pub(crate) pages: Option<Arc<[ReceiverPage]>>,
}

impl PlanesUploader {
    /// Uploads a bake and compiles everything that frames with it need. With `sources`, compact
    /// sources cast shadows from their true directions: by images that what it returns bakes, or
    /// from the surface cache.
    ///
    /// # Errors
    /// The bake has an impossible dome, or more images than the device can hold.
    pub fn upload(
        &self,
        bake: &Bake,
        sources: Option<impl FnOnce() -> Option<SourceBaker>>,
    ) -> Result<PlanesStage, GpuError> {
        let by_cache = self.variant.cached && sources.is_some();
        let baker = sources.filter(|_| !by_cache).and_then(|baker| baker());
        let mut stage = PlanesStage::new(&self.gpu, bake, baker, self.variant.cached)?;
        if by_cache {
            stage.leave_sources_to_cache();
        }
        stage.compile(&self.gpu.device, &self.frame_layout, self.variant);
        if let Some(pages) = &self.pages {
            stage.serve(pages);
        }
        Ok(stage)
    }
}
