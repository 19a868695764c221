//! Puts scenes on the device beside the frame path.

use super::cover::Corners;
use super::gpu::Gpu;
use super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::shadow_slots::CasterHull;
use penumbra_scene::{Part, Scene};

/// Makes scenes ready for [`super::Compositor::show_scene`]; belongs to its compositor.
#[derive(Clone)]
pub struct SceneUploader {
    pub(super) gpu: Gpu,
    pub(super) layouts: SceneLayouts,
}

/// A scene on the device.
pub struct UploadedScene {
    pub(super) buffers: SceneBuffers,
    pub(super) boxes: Vec<Option<Corners>>,
    /// Of virtual casters that stand still, and of phantoms.
    pub(super) hulls: [CasterHull; 2],
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
