//! Uploads scenes to the device, beside the frame path.

use super::caster_hull::CasterHull;
use super::cover::Corners;
use super::exposure::stage::ExposedPasses;
use super::gpu::Gpu;
use super::pipelines::Pipelines;
use super::reflections::NearbyScene;
use super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::shaders::{SceneNeeds, Variant};
use super::surface_light::KeptLight;
use crate::compiled::Device;
use penumbra_scene::{Part, Scene};
use penumbra_surface_cache::{CacheOptions, SurfaceCache};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The light of the newest picture; `None` before the first.
pub(crate) type NewestLight = Arc<Mutex<Option<KeptLight>>>;

/// The variant of the newest picture, and whether it has passes in another exposure than the
/// camera's; `None` before the passes are first compiled.
pub(crate) type NewestVariant = Arc<Mutex<Option<(Variant, bool)>>>;

/// Prepares scenes for [`crate::Compositor::show_scene`] of the compositor that returned it.
#[derive(Clone)]
pub struct SceneUploader {
    pub(crate) gpu: Gpu,
    pub(crate) layouts: SceneLayouts,
    pub(crate) frame_layout: wgpu::BindGroupLayout,
    pub(crate) variant: NewestVariant,
    /// Sizes of the surface cache; `None` without one.
    pub(crate) cache: Option<CacheOptions>,
    /// The light of the newest picture: with it, the cache of a scene is shown at once.
    pub(crate) light: NewestLight,
}

/// A scene on the device.
pub struct UploadedScene {
    device: Device,
    pub(crate) buffers: SceneBuffers,
    pub(crate) boxes: Vec<Option<Corners>>,
    /// Hulls of static virtual casters and of phantoms.
    pub(crate) hulls: [CasterHull; 2],
    pub(crate) cache: Option<SurfaceCache>,
    /// What glossy surfaces mirror, if there are any.
    pub(crate) nearby: Option<NearbyScene>,
    pub(crate) needs: SceneNeeds,
}

impl SceneUploader {
    /// Uploads `scene`. `casters` are its virtual parts as they cast shadows: the parts themselves
    /// or simplified copies.
    #[must_use]
    pub fn upload(&self, scene: &Scene, casters: &[Part]) -> UploadedScene {
        let Gpu { device, queue, .. } = &self.gpu;
        let cache = self.cache.as_ref();
        let cache = cache.map(|options| self.lit_cache(scene, casters, options));
        let layouts = &self.layouts;
        let buffers = SceneBuffers::upload(device, queue, layouts, scene, casters, cache.as_ref());
        let details = buffers.virtual_parts.iter().map(|part| &part.details);
        let boxes = details.map(|d| d.corners().copied()).collect();
        let casters = [&buffers.virtual_casters, &buffers.phantom_casters];
        let nearby = NearbyScene::new(scene);
        let needs = SceneNeeds::of(scene, nearby.is_some());
        self.compile(needs);
        UploadedScene {
            device: device.clone(),
            hulls: casters.map(|c| CasterHull::around(&c.positions)),
            boxes,
            buffers,
            cache,
            nearby,
            needs,
        }
    }
}

impl SceneUploader {
    /// Compiles what the first frame with a scene needs, so that it does not have to.
    fn compile(&self, needs: SceneNeeds) {
        let Some((known, is_exposed)) = *lock(&self.variant) else {
            return;
        };
        let variant = known.with_scene(needs);
        if variant == known {
            return;
        }
        let device = &self.gpu.device;
        Pipelines::new(device, &self.frame_layout, &self.layouts, variant);
        if is_exposed {
            ExposedPasses::new(device, &self.frame_layout, variant);
        }
    }

    fn lit_cache(&self, scene: &Scene, casters: &[Part], options: &CacheOptions) -> SurfaceCache {
        let mut cache = SurfaceCache::new(scene, casters, options);
        let newest = lock(&self.light);
        if let Some(light) = newest.clone() {
            drop(newest);
            let light = light.light();
            let all: Vec<usize> = (0..light.lights.len()).collect();
            cache.update(&light, &all);
        }
        cache
    }
}

impl UploadedScene {
    /// Returns whether the scene is on the device of `gpu`, not on one that was lost.
    #[must_use]
    pub fn is_on(&self, gpu: &Gpu) -> bool {
        self.device == gpu.device
    }
}

pub(crate) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
