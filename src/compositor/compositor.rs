//! The compositor: its state between frames, and the setters of scene, settings and bake.

use super::cover::Cover;
use super::exposure::choice::ActiveExposure;
use super::exposure::stage::ExposureStage;
use super::gpu::{Gpu, GpuError};
use super::lens::{LensOutput, LensStage};
use super::light_maps::LightMaps;
use super::look::CameraLook;
use super::passes::shadow_map::DomeShadowMaps;
use super::pipelines::Pipelines;
use super::planes::{PlaneWork, PlanesStage, PlanesUploader, SourceBaker};
use super::readback::Readback;
use super::reflections::ReflectionsStage;
use super::reproject::ReprojectStage;
use super::response_table::ResponseTable;
use super::scene_buffers::{SceneBuffers, SceneLayouts};
use super::scene_upload::{NewestLight, NewestVariant, SceneUploader, UploadedScene, lock};
use super::settings::CompositorSettings;
use super::shaders::Variant;
use super::shadow_slots::ShadowSlots;
use super::sized_resources::SizedResources;
use super::surface_light::CachedLight;
use super::textures::FrameTexture;
use super::timing::Timer;
use penumbra_camera::Response;
use penumbra_interface::RigidTransform;
use penumbra_lighting::DomeLight;
use penumbra_picture::Picture;
use penumbra_scene::planes::Bake;
use penumbra_scene::{Part, Scene};
use penumbra_surface_cache::CacheOptions;

/// Share of its angular radius by which a light may turn before the shadows that it casts on the
/// surface cache are renewed: a seventh of a penumbra's half width. Dome lights follow the noise of
/// every environment picture.
const TURNED: f32 = 0.15;

/// Composes augmented pictures: [`Compositor::compose`] draws one frame.
pub struct Compositor {
    pub(crate) gpu: Gpu,
    pub(crate) settings: CompositorSettings,
    pub(crate) timer: Timer,

    // The camera.
    pub(crate) response: Response,
    pub(crate) response_table: ResponseTable,
    pub(crate) lens_output: LensOutput,
    /// `None` for cameras without distortion.
    pub(crate) lens: Option<LensStage>,

    // The passes, and the variant of the shaders for which they are compiled.
    pub(crate) variant: Variant,
    pub(crate) layouts: SceneLayouts,
    /// Compiled by the first frame of a variant.
    pub(crate) pipelines: Option<Pipelines>,
    /// For uploaders.
    pub(crate) newest_variant: NewestVariant,
    pub(crate) exposure: ExposureStage,
    pub(crate) planes: Option<Box<PlanesStage>>,
    pub(crate) look: CameraLook,
    pub(crate) reflections: ReflectionsStage,
    pub(crate) reproject: Option<Box<ReprojectStage>>,

    // The scene.
    pub(crate) scene: SceneBuffers,
    pub(crate) cover: Cover,

    // The light.
    pub(crate) light_maps: LightMaps,
    /// Light that is kept on surfaces, if the settings want that.
    pub(crate) surface_light: Option<CachedLight>,
    pub(crate) newest_light: NewestLight,
    /// Compact lights that shadowing planes leave to it.
    pub(crate) compact_lights: Vec<DomeLight>,
    /// The near lights of this frame with shadow maps, where nothing blocks them.
    pub(crate) near_lights: Vec<DomeLight>,
    /// Tiles of the picture with shadows on real surfaces, by the surface cache.
    pub(crate) shadow_tiles: Vec<[u32; 4]>,
    pub(crate) shadow_maps: DomeShadowMaps,
    pub(crate) slots: ShadowSlots,
    /// Shadow maps that are drawn in this frame.
    pub(crate) chosen: Vec<usize>,
    /// Generation of the radiance map that was uploaded last.
    pub(crate) radiance_generation: Option<u64>,
    /// Generation of the indirect light that was uploaded last.
    pub(crate) indirect_generation: u64,

    // The pictures.
    pub(crate) pictures: Option<SizedResources>,
    pub(crate) finished: Option<FrameTexture>,
    pub(crate) readback: Option<Readback>,
}

impl Compositor {
    /// A compositor for a camera with the given `response`. The first frame compiles the passes.
    #[must_use]
    pub fn new(gpu: Gpu, mut settings: CompositorSettings, response: Response) -> Self {
        settings.light_budget = settings.light_budget.clamp(1, gpu.max_lights());
        let (device, queue) = (&gpu.device, &gpu.queue);
        let layouts = SceneLayouts::new(device);
        let light_maps = LightMaps::new(device, settings.light_budget);
        let variant = Variant {
            samples: settings.samples,
            soft: settings.soft_samples.max(1),
            cached: settings.cached,
            ..Variant::PLAIN
        };
        let map_size = settings.map_size();
        Self {
            timer: Timer::new(device, queue, gpu.timestamps),
            response_table: ResponseTable::new(device, queue, &response),
            response,
            lens_output: LensOutput::Camera,
            lens: None,
            variant,
            pipelines: None,
            newest_variant: NewestVariant::default(),
            exposure: ExposureStage::default(),
            planes: None,
            look: CameraLook::default(),
            reflections: ReflectionsStage::new(device, settings.reflection_step),
            reproject: None,
            scene: SceneBuffers::upload(device, queue, &layouts, &Scene::default(), &[], None),
            cover: Cover::default(),
            layouts,
            light_maps,
            surface_light: None,
            newest_light: NewestLight::default(),
            compact_lights: Vec::new(),
            near_lights: Vec::new(),
            shadow_tiles: Vec::new(),
            shadow_maps: DomeShadowMaps::new(device, map_size, settings.light_budget),
            slots: ShadowSlots::with_tolerance(if settings.cached { TURNED } else { 0.0 }),
            chosen: Vec::with_capacity(settings.light_budget as usize),
            radiance_generation: None,
            indirect_generation: 0,
            pictures: None,
            finished: None,
            readback: None,
            settings,
            gpu,
        }
    }

    /// Replaces the scene. `casters` are its virtual parts as they cast shadows: the parts
    /// themselves or simplified copies.
    pub fn set_scene(&mut self, scene: &Scene, casters: &[Part]) {
        let uploaded = self.uploader().upload(scene, casters);
        self.show_scene(uploaded);
    }

    /// Returns an uploader that prepares scenes for [`Self::show_scene`] on any thread.
    #[must_use]
    pub fn uploader(&self) -> SceneUploader {
        SceneUploader {
            gpu: self.gpu.clone(),
            layouts: self.layouts.clone(),
            frame_layout: self.light_maps.frame_layout.clone(),
            variant: self.newest_variant.clone(),
            cache: self.settings.cached.then_some(CacheOptions {
                pages: self.settings.cache_pages,
                map_size: self.settings.map_size() as usize,
                lights: self.settings.light_budget as usize,
            }),
            light: self.newest_light.clone(),
        }
    }

    /// Compiles the passes for the scene that is shown and for a camera with `vignetting` and a
    /// `rolling_shutter`, so that the first frame does not have to.
    pub fn compile(&mut self, vignetting: bool, rolling_shutter: bool) {
        self.set_variant(Variant {
            rolling_shutter: self.variant.rolling_shutter || rolling_shutter,
            vignetting: self.variant.vignetting || vignetting,
            ..self.variant
        });
        self.pipelines = Some(self.compiled());
        self.publish_variant();
    }

    /// Has the passes taken from those of `variant`, or compiled for it, by the next frame.
    pub(crate) fn set_variant(&mut self, variant: Variant) {
        if variant != self.variant {
            self.variant = variant;
            self.exposure.forget_pipelines();
            self.pipelines = None;
        }
    }

    /// Tells uploaders for which variant they have to compile.
    pub(crate) fn publish_variant(&self) {
        *lock(&self.newest_variant) = Some((self.variant, self.exposure.has_passes()));
    }

    /// The passes for the variant.
    pub(crate) fn compiled(&self) -> Pipelines {
        let frame = &self.light_maps.frame_layout;
        Pipelines::new(&self.gpu.device, frame, &self.layouts, self.variant)
    }

    /// Virtual parts, by number, whose surfaces are too rough to keep light on: nothing casts a shadow
    /// on them.
    #[must_use]
    pub fn without_shadows(&self) -> &[usize] {
        self.surface_light
            .as_ref()
            .map_or(&[], CachedLight::left_out)
    }

    /// Replaces the scene by one that was uploaded before.
    pub fn show_scene(&mut self, scene: UploadedScene) {
        self.scene = scene.buffers;
        self.cover.set_boxes(scene.boxes);
        self.reflections.set_scene(scene.nearby);
        self.set_variant(self.variant.with_scene(scene.needs));
        self.light_maps
            .bind_screens(&self.gpu.device, &self.scene.screens);
        // The new scene may need the radiance maps of Phong's lobes.
        self.forget_uploaded_light();
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let in_background = self.settings.in_background;
        let cached = scene
            .cache
            .map(|cache| CachedLight::new(device, queue, cache, in_background));
        self.surface_light = cached.map(|(light, textures)| {
            self.light_maps.bind_cache(device, textures);
            light
        });
        let [virtual_hull, phantom_hull] = scene.hulls;
        let moving = self.scene.moving.iter();
        let moving = moving.map(|part| (part.hull.clone(), part.world.as_mat4()));
        self.slots
            .set_casters(virtual_hull.with_moving(moving), phantom_hull);
    }

    /// Changes the maximum number of dome lights; at most [`Gpu::max_lights`]. Every shadow map is drawn again with the next
    /// frame.
    pub fn set_light_budget(&mut self, lights: u32) {
        let lights = lights.clamp(1, self.gpu.max_lights());
        if lights == self.settings.light_budget {
            return;
        }
        self.settings.light_budget = lights;
        let device = &self.gpu.device;
        let cache = self.light_maps.take_cache(device);
        self.light_maps = LightMaps::new(device, lights);
        self.light_maps.bind_cache(device, cache);
        self.light_maps.bind_screens(device, &self.scene.screens);
        self.shadow_maps = DomeShadowMaps::new(device, self.settings.map_size(), lights);
        self.slots.forget();
        self.forget_uploaded_light();
    }

    /// Chooses the form in which pictures of a lens with distortion are returned.
    pub fn set_lens_output(&mut self, output: LensOutput) {
        self.lens_output = output;
    }

    /// Activates a bake of the scene that is shown, or removes it.
    ///
    /// # Errors
    /// The bake has an impossible dome, or more images than the device can hold.
    pub fn set_bake(&mut self, bake: Option<&Bake>) -> Result<(), GpuError> {
        self.set_bake_with_sources(bake, None)
    }

    /// Like [`Self::set_bake`]; with `sources`, made of this bake, the brightest compact sources of
    /// light get images of their own, drawn from their true directions, instead of those of the
    /// faces in which they lie. Where light is kept on surfaces, all of them cast their shadows there.
    ///
    /// # Errors
    /// As [`Self::set_bake`].
    pub fn set_bake_with_sources(
        &mut self,
        bake: Option<&Bake>,
        sources: Option<SourceBaker>,
    ) -> Result<(), GpuError> {
        self.planes = None;
        if let Some(bake) = bake {
            let sources = sources.map(|baker| || Some(baker));
            let stage = self.planes_uploader().upload(bake, sources)?;
            self.show_planes(Box::new(stage));
        }
        Ok(())
    }

    /// Returns an uploader that prepares bakes for [`Self::show_planes`] on any thread.
    #[must_use]
    pub fn planes_uploader(&self) -> PlanesUploader {
        PlanesUploader {
            gpu: self.gpu.clone(),
            frame_layout: self.light_maps.frame_layout.clone(),
            variant: self.variant,
            pages: self
                .surface_light
                .as_ref()
                .map(|light| light.pages().clone()),
        }
    }

    /// Activates a bake that was uploaded before.
    pub fn show_planes(&mut self, mut stage: Box<PlanesStage>) {
        stage.waits_for_sources = self.settings.waits_for_sources;
        if let Some(before) = self.planes.take() {
            stage.take_pipelines(*before);
        }
        self.planes = Some(stage);
    }

    /// Moves the planes with a model that was moved as a whole since it was baked. The caller must
    /// rotate the dome from which the light comes in the same way.
    pub fn move_planes(&mut self, world_from_bake: RigidTransform) {
        if let Some(stage) = &mut self.planes {
            stage.place(world_from_bake);
        }
    }

    /// The work of shadowing planes in the last frame; `None` if it did not use them. Waits for the
    /// device.
    ///
    /// # Errors
    /// The device was lost, ran out of memory or refused a command.
    pub fn plane_work(&self) -> Result<Option<PlaneWork>, GpuError> {
        match &self.planes {
            Some(stage) => stage.work(&self.gpu),
            None => Ok(None),
        }
    }

    /// Waits for the last frame and copies its picture into `picture`.
    ///
    /// # Errors
    /// The device was lost, ran out of memory or refused a command; no frame was composed yet.
    pub fn read(&self, picture: &mut Picture) -> Result<(), GpuError> {
        match &self.readback {
            Some(readback) => readback.read(&self.gpu, picture),
            None => Err(GpuError::Failed {
                adapter: self.gpu.name.clone(),
                reason: "no frame was composed yet".to_owned(),
            }),
        }
    }

    /// Width and height of the last finished picture, pixels.
    #[must_use]
    pub fn size(&self) -> Option<(u32, u32)> {
        Some(self.finished.as_ref()?.size())
    }

    /// The last finished picture on the device, for display.
    #[must_use]
    pub fn output(&self) -> Option<&wgpu::TextureView> {
        Some(&self.finished.as_ref()?.view)
    }

    /// The exposure of the last frame.
    #[must_use]
    pub const fn exposure(&self) -> ActiveExposure {
        self.exposure.active()
    }

    /// The device.
    #[must_use]
    pub const fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Number of shadow maps that the last frame drew again.
    #[must_use]
    pub const fn maps_refreshed(&self) -> usize {
        self.chosen.len()
    }

    /// Texels a side of the shadow maps in use.
    #[must_use]
    pub const fn shadow_map_size(&self) -> u32 {
        self.settings.map_size()
    }

    /// Time that each pass of the last frame took on the device, milliseconds; waits for it.
    #[must_use]
    pub fn pass_times(&self) -> Vec<(&'static str, f64)> {
        self.timer.read(&self.gpu.device)
    }

    fn forget_uploaded_light(&mut self) {
        self.radiance_generation = None;
        self.indirect_generation = 0;
    }
}
