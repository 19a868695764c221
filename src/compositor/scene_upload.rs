//! Uploads scenes to the device, beside the frame path.

use super::caster_hull::CasterHull;
use super::cover::Corners;
use super::gpu::Gpu;
use super::scene_buffers::{SceneBuffers, SceneLayouts};
use penumbra_scene::{Part, Scene};

/// Prepares scenes for [`crate::Compositor::show_scene`] of the compositor that returned it.
#[derive(Clone)]
pub struct SceneUploader {
    pub(crate) gpu: Gpu,
    pub(crate) layouts: SceneLayouts,
}

/// A scene on the device.
pub struct UploadedScene {
    pub(crate) buffers: SceneBuffers,
    pub(crate) boxes: Vec<Option<Corners>>,
    /// Hulls of static virtual casters and of phantoms.
    pub(crate) hulls: [CasterHull; 2],
}

impl SceneUploader {
    /// Uploads `scene`. `casters` are its virtual parts as they cast shadows: the parts
    /// themselves or simplified copies.
    #[must_use]
    pub fn upload(&self, scene: &Scene, casters: &[Part]) -> UploadedScene {
        let Gpu { device, queue, .. } = &self.gpu;
        let buffers = SceneBuffers::upload(device, queue, &self.layouts, scene, casters);
        let details = buffers.virtual_parts.iter().map(|part| &part.details);
        let boxes = details.map(|d| d.corners().copied()).collect();
        let casters = [&buffers.virtual_casters, &buffers.phantom_casters];
        UploadedScene {
            hulls: casters.map(|c| CasterHull::around(&c.positions)),
            boxes,
            buffers,
        }
    }
}
