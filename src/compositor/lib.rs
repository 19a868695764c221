//! The only module that records GPU commands: camera picture, pose, light and scene go
//! in, the augmented picture comes out.
//!
//! [`frame`] tells the whole frame top to bottom. Passes own immutable pipelines
//! (`passes/`); what changes with the picture's size is in `targets`, what changes with
//! the scene in `scene_buffers`, what changes with the light in `light_maps`, `gloss_maps`,
//! `lamp_maps` and `shadow_slots`; [`exposure`] says in which exposure all of it is shown.

mod bindings;
mod cover;
mod detail;
mod emitters;
pub mod exposure;
pub mod frame;
mod frame_uniform;
mod gloss_maps;
pub mod gpu;
mod gpu_data;
mod lamp_coverage;
mod lamp_layers;
mod lamp_maps;
mod lamp_screens;
mod lens;
mod light_maps;
mod moving;
mod near_maps;
mod passes;
pub mod planes;
pub mod readback;
pub mod reference;
mod reproject;
mod scene_buffers;
mod scene_motion;
mod scene_upload;
mod shaders;
mod shadow_slots;
mod targets;
pub mod timing;

pub use exposure::Exposure;
pub use frame::{FrameInput, LampResponse, ShadowMode};
pub use gpu::{Gpu, GpuError};
pub use lens::LensOutput;
pub use passes::present::PresentPass;
pub use reproject::Reprojection;
pub use scene_upload::{SceneUploader, UploadedScene};
pub use shadow_slots::Refresh;

use cover::Cover;
use exposure::ExposureStation;
use frame::Pipelines;
use lens::LensStage;
use light_maps::LightMaps;
use passes::shadow_map::ShadowMaps;
use penumbra_camera::Vignetting;
use penumbra_camera::{Response, RollingShutter};
use penumbra_scene::{Part, PlacedLamp, Scene};
use planes::PlanesStage;
use reproject::ReprojectStage;
use scene_buffers::{SceneBuffers, SceneLayouts};
use shaders::{MAX_LIGHTS, Variant};
use shadow_slots::ShadowSlots;
use std::sync::Arc;
use targets::{Target, Targets};
use timing::Timer;

/// What is chosen before the first frame.
#[derive(Clone, Debug, PartialEq)]
pub struct CompositorSettings {
    /// Greatest number of dome lights, one shadow map each.
    pub light_budget: u32,
    /// Texels a side of a shadow map.
    pub shadow_map_size: u32,
    /// Picture pixels per shadow-buffer texel, each way: a power of two.
    pub shadow_step: u32,
    /// Samples a pixel at the edges of virtual objects: 1 or 4.
    pub samples: u32,
    /// Look-ups of a shadow map per light and point, spread over the light's extent; 1 =
    /// hard shadows, the cheapest.
    pub soft_samples: u32,
}

impl CompositorSettings {
    /// Best for a real GPU, or, with `software`, for a software driver.
    #[must_use]
    pub const fn for_adapter(software: bool) -> Self {
        Self {
            light_budget: 64,
            shadow_map_size: 512,
            shadow_step: if software { 4 } else { 1 },
            samples: 4,
            soft_samples: if software { 1 } else { 8 },
        }
    }
}

/// The augmented picture's maker.
pub struct Compositor {
    gpu: Gpu,
    settings: CompositorSettings,
    pipelines: Pipelines,
    variant: Variant,
    layouts: SceneLayouts,
    timer: Timer,
    light_maps: LightMaps,
    maps: (ShadowMaps, ShadowMaps),
    slots: ShadowSlots,
    chosen: Vec<usize>,
    cover: Cover,
    scene: SceneBuffers,
    sized: Option<frame::Sized>,
    response: Response,
    radiance_generation: Option<u64>,
    near_generation: u64,
    refreshed: usize,
    subtract: bool,
    /// Real surfaces answer lamps in a pass of their own.
    answers: bool,
    planes: Option<Box<PlanesStage>>,
    exposure: ExposureStation,
    /// Where the camera's lens bends straight lines.
    lens: Option<Arc<LensStage>>,
    lens_output: LensOutput,
    rolling: Option<RollingShutter>,
    fading: Option<Vignetting>,
    /// Where pictures are turned to the eye they are shown to, and what does it.
    reprojection: Option<Reprojection>,
    reproject: Option<Box<ReprojectStage>>,
}

impl Compositor {
    /// Compiles everything.
    #[must_use]
    pub fn new(gpu: Gpu, settings: CompositorSettings, response: Response) -> Self {
        let device = &gpu.device;
        let layouts = SceneLayouts::new(device);
        let light_maps = LightMaps::new(device, settings.light_budget);
        let variant = Variant {
            samples: settings.samples,
            soft: settings.soft_samples.max(1),
            lamps: false,
            areas: false,
            phong: false,
            fine: settings.shadow_step == 1,
            exposed: false,
            rolling: false,
            fading: false,
        };
        let pipelines = Pipelines::new(device, &light_maps.frame_layout, &layouts, variant);
        Self {
            timer: Timer::new(device, &gpu.queue, gpu.timestamps),
            maps: make_maps(device, &settings),
            slots: ShadowSlots::default(),
            chosen: Vec::with_capacity(settings.light_budget as usize),
            scene: SceneBuffers::upload(device, &gpu.queue, &layouts, &Scene::default(), &[]),
            cover: Cover::default(),
            sized: None,
            radiance_generation: None,
            near_generation: 0,
            refreshed: 0,
            subtract: false,
            answers: false,
            planes: None,
            exposure: ExposureStation::default(),
            lens: None,
            lens_output: LensOutput::Camera,
            rolling: None,
            fading: None,
            reprojection: None,
            reproject: None,
            gpu,
            settings,
            pipelines,
            variant,
            layouts,
            light_maps,
            response,
        }
    }

    /// Replaces the scene. `casters` are its virtual parts as they cast shadows: the parts
    /// themselves or simplified copies.
    pub fn set_scene(&mut self, scene: &Scene, casters: &[Part]) {
        let uploaded = self.uploader().upload(scene, casters);
        self.show_scene(uploaded);
    }

    /// Makes scenes ready for [`Self::show_scene`], on whichever thread.
    #[must_use]
    pub fn uploader(&self) -> SceneUploader {
        SceneUploader {
            gpu: self.gpu.clone(),
            layouts: self.layouts.clone(),
        }
    }

    /// Replaces the scene by one that lies on the device already.
    pub fn show_scene(&mut self, scene: UploadedScene) {
        self.scene = scene.buffers;
        self.cover.set_boxes(scene.boxes);
        self.light_maps
            .bind_screens(&self.gpu.device, &self.scene.screens);
        // Phong's lobes may be wanted now.
        self.radiance_generation = None;
        self.near_generation = 0;
        let [virtual_hull, phantom_hull] = scene.hulls;
        let moving = self.scene.moving.iter();
        let moving = moving.map(|part| (part.hull.clone(), part.world.as_mat4()));
        self.slots
            .set_casters(virtual_hull.with_moving(moving), phantom_hull);
    }

    /// Changes the greatest number of dome lights. Every map is drawn anew with the next
    /// frame.
    pub fn set_light_budget(&mut self, lights: u32) {
        let lights = lights.clamp(1, MAX_LIGHTS);
        if lights == self.settings.light_budget {
            return;
        }
        self.settings.light_budget = lights;
        let device = &self.gpu.device;
        self.light_maps = LightMaps::new(device, lights);
        self.light_maps.bind_screens(device, &self.scene.screens);
        self.maps = make_maps(device, &self.settings);
        self.slots.forget();
        self.radiance_generation = None;
        self.near_generation = 0;
        self.rebind();
    }

    /// Size of the pictures made so far.
    #[must_use]
    pub fn size(&self) -> Option<(u32, u32)> {
        let sized = self.sized.as_ref()?;
        let straight = (sized.targets.width, sized.targets.height);
        Some(self.lens.as_ref().map_or(straight, |lens| lens.size()))
    }

    /// The finished picture, for showing it.
    #[must_use]
    pub fn output(&self) -> Option<&wgpu::TextureView> {
        Some(&self.finished(self.sized.as_ref()?).view)
    }

    /// The last of the stages that there are.
    fn finished<'a>(&'a self, sized: &'a frame::Sized) -> &'a Target {
        let turned = self
            .reproject
            .as_ref()
            .filter(|_| self.reprojection.is_some());
        turned.map_or_else(|| self.unturned(&sized.targets), |stage| &stage.output)
    }

    /// The picture for the instant that it was taken at.
    fn unturned<'a>(&'a self, targets: &'a Targets) -> &'a Target {
        let bent = self.lens.as_ref().and_then(|lens| lens.output());
        bent.unwrap_or(&targets.output)
    }

    /// The device.
    #[must_use]
    pub const fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Shadow maps drawn in the last frame.
    #[must_use]
    pub const fn maps_refreshed(&self) -> usize {
        self.refreshed
    }

    /// Milliseconds each pass of the last frame took on the device; waits for it.
    #[must_use]
    pub fn pass_times(&self) -> Vec<(&'static str, f64)> {
        self.timer.read(&self.gpu.device)
    }

    /// How the camera moves while it reads the pictures to come, where its rows are read one
    /// after the other. The pose is that of the middle row.
    pub const fn set_rolling(&mut self, rolling: Option<RollingShutter>) {
        self.rolling = rolling;
    }

    /// How the camera's picture fades towards its edge: virtual objects fade alike.
    pub const fn set_fading(&mut self, fading: Option<Vignetting>) {
        self.fading = fading;
    }

    /// Compiles the shaders anew when the first lamp or area lamp or Phong's first lobe comes.
    fn fit_variant(&mut self, lamps: &[PlacedLamp]) {
        let wanted = Variant {
            lamps: self.variant.lamps || !lamps.is_empty(),
            areas: self.variant.areas || lamps.iter().any(|lamp| lamp.area.is_some()),
            phong: self.variant.phong || self.scene.has_phong,
            rolling: self.variant.rolling || self.rolling.is_some(),
            fading: self.variant.fading || self.fading.is_some(),
            ..self.variant
        };
        if wanted != self.variant {
            self.variant = wanted;
            if let Some(planes) = &mut self.planes {
                planes.forget_pipelines();
            }
            self.exposure.forget_pipelines();
            let frame = &self.light_maps.frame_layout;
            self.pipelines = Pipelines::new(&self.gpu.device, frame, &self.layouts, self.variant);
            self.rebind();
        }
    }

    /// Texels a side of the shadow maps in use.
    #[must_use]
    pub const fn shadow_map_size(&self) -> u32 {
        map_size(&self.settings)
    }

    fn make_targets(&self, width: u32, height: u32) -> Targets {
        let s = &self.settings;
        Targets::new(&self.gpu.device, width, height, s.samples, s.shadow_step)
    }
}

/// Lights from which on maps are made smaller: more lights share the work of drawing the
/// shadows' shapes, and 384 maps of full size would take 800 MB.
const MANY_LIGHTS: u32 = 96;

const fn map_size(settings: &CompositorSettings) -> u32 {
    if settings.light_budget > MANY_LIGHTS {
        settings.shadow_map_size / 2
    } else {
        settings.shadow_map_size
    }
}

fn make_maps(device: &wgpu::Device, settings: &CompositorSettings) -> (ShadowMaps, ShadowMaps) {
    let maps = |label| ShadowMaps::new(device, label, map_size(settings), settings.light_budget);
    (maps("virtual shadow maps"), maps("phantom shadow maps"))
}
