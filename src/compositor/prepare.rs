//! Prepares a frame: fits everything that depends on the camera, the size and the light, and
//! uploads the frame's data. The passes are recorded afterwards by `frame`.

use super::compositor::Compositor;
use super::exposure::stage::MeteredFrame;
use super::frame_input::FrameInput;
use super::frame_uniform::{UniformInputs, frame_uniform};
use super::frame_view::FrameView;
use super::gpu::GpuError;
use super::gpu_data::LightUniform;
use super::lens::{LensOutput, LensStage};
use super::look::LookFit;
use super::moving::upload;
use super::passes::exposure::ExposedPictures;
use super::reflections::ReflectionTiles;
use super::reproject::ReprojectStage;
use super::shaders::Variant;
use super::sized_resources::SizedResources;
use super::surface_light::mark_tiles;
use super::textures::TILE;
use glam::DMat4;
use penumbra_camera::PinholeCamera;
use penumbra_lighting::place::near_lights;
use penumbra_lighting::{DomeLight, LightKind, Lighting};
use penumbra_scene::{IndirectLight, LampResponse, ShadowMode};
use penumbra_surface_cache::SurfaceLight;

/// Ratio of the texels of a virtual light's maps to those of a dome light's, each way, where soft
/// shadows are affordable or where area lamps divide maps into views: shadows of virtual lights
/// have sharp edges, and such lights are few. Otherwise both have the same size.
const LAMP_MAP_RATIO: u32 = 2;

/// Decisions about a frame that its passes follow.
pub struct FramePlan {
    /// Whether shadows are subtracted instead of multiplied.
    pub subtract: bool,
    /// Whether virtual lights act on real surfaces by the paper's response, in a pass of its own.
    pub lamps_apart: bool,
    /// Rectangle of tiles (x, y, width, height) that virtual surfaces may cover.
    pub covered: [u32; 4],
    /// Rectangle of tiles in which the picture of virtual surfaces must be cleared.
    pub cleared: [u32; 4],
    /// Whether the finished picture is warped to another pose.
    pub reprojected: bool,
}

impl FramePlan {
    /// The plan of a frame, `has_virtual` with virtual objects, before its tiles are known.
    fn of(input: &FrameInput<'_>, has_virtual: bool) -> Self {
        let by_paper = input.lamp_response == LampResponse::Paper;
        Self {
            subtract: input.shadow_mode == ShadowMode::Subtract,
            lamps_apart: has_virtual && !input.lamps.is_empty() && by_paper,
            covered: [0; 4],
            cleared: [0; 4],
            reprojected: input.reprojection.is_some(),
        }
    }

    /// The change of the picture without shadow: a factor, or what is subtracted.
    pub const fn unshadowed(&self) -> f64 {
        if self.subtract { 0.0 } else { 1.0 }
    }
}

impl Compositor {
    /// Prepares a frame.
    ///
    /// # Errors
    /// The picture is empty or too large for the device; its light has more pixels than the device
    /// can read.
    pub(crate) fn prepare(&mut self, input: &FrameInput<'_>) -> Result<FramePlan, GpuError> {
        self.place_moving_parts(input.seconds);
        self.fit_lens(input);
        self.fit_reprojection(input);
        let view = FrameView::new(input, self.lens.as_ref());
        self.fit_variant(input);
        self.fit_pictures(view.size)?;
        self.upload_radiance(input);
        self.upload_picture(input);
        let mut plan = self.upload_frame(input, &view)?;
        self.publish_variant();
        let tiles = ReflectionTiles {
            covered: self.cover.tiles(),
            across: view.size.0.div_ceil(TILE),
            rectangle: self.cover.rectangle(),
        };
        let (queue, response) = (&self.gpu.queue, &self.response);
        self.reflections
            .update(queue, (input, &view), response, tiles);
        self.cover.keep_mirrors(|tile| self.reflections.shows(tile));
        if let Some(pictures) = &self.pictures {
            pictures.covered_tiles.upload(queue, self.cover.tiles(), 1);
        }
        plan.covered = self.cover.rectangle();
        plan.cleared = self.cover.rectangle_to_clear();
        Ok(plan)
    }

    /// Moves all moving parts to their placement at `seconds` since the session began, as they
    /// are drawn and as they cast shadows.
    fn place_moving_parts(&mut self, seconds: f64) {
        let mut moved = false;
        let buffers = (&self.scene.virtual_buffer, &self.scene.caster_places);
        for (number, part) in self.scene.moving.iter_mut().enumerate() {
            let world = part.motion.at(seconds);
            if world == part.world {
                continue;
            }
            part.world = world;
            moved = true;
            upload(&self.gpu.queue, part, number, buffers);
            self.slots.move_caster(number, world.as_mat4());
            if let Some(light) = &mut self.surface_light {
                light.place(part.index, world);
            }
            self.reflections.place(part.index, world);
            if let Some(corners) = part.placed_corners() {
                self.cover.set_box(part.index, corners);
                if let Some(drawn) = self.scene.virtual_parts.get_mut(part.index) {
                    drawn.details.set_corners(corners);
                }
            }
        }
        if moved {
            self.slots.casters_moved();
        }
    }

    /// Replaces the lens stage when the camera or the lens output has changed.
    fn fit_lens(&mut self, input: &FrameInput<'_>) {
        let camera = input.camera;
        let output = (self.lens_output, !input.look.is_none());
        let distorts = camera.distortion != [0.0; 5];
        let suits = self.lens.as_ref().map(|lens| lens.suits(camera, output));
        if suits.unwrap_or(!distorts) {
            return;
        }
        let gpu = (&self.gpu.device, &self.gpu.queue);
        self.lens = LensStage::new(gpu, camera, output, self.variant);
    }

    /// Creates the reprojection stage when it is first requested and when the camera has changed,
    /// and uploads the pose.
    fn fit_reprojection(&mut self, input: &FrameInput<'_>) {
        let Some(reprojection) = &input.reprojection else {
            return;
        };
        let camera = PinholeCamera {
            distortion: match self.lens_output {
                LensOutput::Camera => input.camera.distortion,
                LensOutput::Undistorted => [0.0; 5],
            },
            ..input.camera.clone()
        };
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let kept = self.reproject.take().filter(|stage| stage.suits(&camera));
        let stage = kept.unwrap_or_else(|| ReprojectStage::new((device, queue), camera).into());
        stage.upload(queue, reprojection);
        self.reproject = Some(stage);
    }

    /// Has the shaders compiled again when the first rolling shutter, vignetting, or virtual light
    /// that the scene does not have appears.
    fn fit_variant(&mut self, input: &FrameInput<'_>) {
        let known = self.variant;
        self.set_variant(Variant {
            lamps: known.lamps || !input.lamps.is_empty(),
            areas: known.areas || input.lamps.iter().any(|lamp| lamp.area.is_some()),
            rolling_shutter: known.rolling_shutter || input.rolling_shutter.is_some(),
            vignetting: known.vignetting || input.vignetting.is_some(),
            ..known
        });
    }

    /// Allocates the pictures of a frame when their size has changed.
    fn fit_pictures(&mut self, size: (u32, u32)) -> Result<(), GpuError> {
        let cached = self.variant.cached;
        let fits = |p: &SizedResources| p.size == size && p.cached == cached;
        if self.pictures.as_ref().is_some_and(fits) {
            return Ok(());
        }
        let max = self.gpu.device.limits().max_texture_dimension_2d;
        if size.0 == 0 || size.1 == 0 || size.0 > max || size.1 > max {
            return Err(GpuError::Unfit {
                adapter: self.gpu.name.clone(),
                reason: format!(
                    "pictures of {}×{} pixels (at most {max} each way)",
                    size.0, size.1
                ),
            });
        }
        self.pictures = Some(SizedResources::new(&self.gpu.device, size, self.variant));
        Ok(())
    }

    /// Uploads the radiance map and the indirect light when they are new.
    fn upload_radiance(&mut self, input: &FrameInput<'_>) {
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        if let Some(lighting) = input.lighting
            && self.radiance_generation != Some(lighting.generation)
        {
            let gloss = &mut self.light_maps.gloss;
            gloss.write(device, queue, &lighting.radiance, self.scene.has_phong);
            self.radiance_generation = Some(lighting.generation);
        }
        if let Some(indirect) = input.indirect_light
            && self.indirect_generation != indirect.generation
        {
            self.light_maps.write_indirect(queue, indirect);
            self.indirect_generation = indirect.generation;
        }
    }

    /// Uploads the camera picture: to the lens stage, or directly where the lens does not distort.
    fn upload_picture(&self, input: &FrameInput<'_>) {
        let Some(pictures) = &self.pictures else {
            return;
        };
        let lens = self.lens.as_ref();
        let texture = lens.map_or(&pictures.camera, |lens| &lens.raw);
        texture.upload(&self.gpu.queue, &input.picture.rgba, 4);
    }

    /// Uploads the frame's uniforms, lights, tiles and virtual lights.
    fn upload_frame(
        &mut self,
        input: &FrameInput<'_>,
        view: &FrameView,
    ) -> Result<FramePlan, GpuError> {
        let something = !(self.scene.virtual_parts.is_empty() && input.lamps.is_empty());
        let augmented = input.show_virtual && something;
        let has_virtual =
            augmented && input.lighting.is_some() && input.world_from_camera.is_some();
        let plan = FramePlan::of(input, has_virtual);
        let lights = match input.lighting {
            Some(lighting) if has_virtual => lighting.lights.as_slice(),
            _ => &[],
        };
        let lights = &lights[..lights.len().min(self.settings.light_budget as usize)];
        self.prepare_exposure(input, view, &plan, has_virtual);
        let by_planes = self.prepare_planes(input, view, augmented)?;
        // Planes need no shadow maps.
        let shadowing = if by_planes { &[] } else { lights };
        let map_size = self.settings.map_size();
        // Light that is kept on surfaces needs none on the device.
        let cached = self.variant.cached;
        if cached {
            self.update_surface_light(input, view, (lights, by_planes), has_virtual);
        } else {
            self.slots
                .schedule(shadowing, map_size, input.refresh, &mut self.chosen);
        }
        let mapped = if cached { &[] } else { shadowing };
        near_lights(lights, &mut self.near_lights);
        let mut uniform = frame_uniform(&UniformInputs {
            input,
            view,
            augmented,
            lights: mapped.len() as u32,
            near: &self.near_lights,
            lamps_apart: plan.lamps_apart,
            ground_height: self.scene.ground_height,
            highest_surroundings_level: self.highest_surroundings_level(),
            highest_gloss_level: self.light_maps.gloss.highest_level(),
            exposure_factor: self.exposure.factor(),
        });
        let lamps = if has_virtual { input.lamps } else { &[] };
        self.scene.emitters.place(&self.gpu.queue, lamps);
        self.find_cover(input, view, augmented && input.lighting.is_some());
        let stage = self.planes.as_mut().filter(|_| by_planes);
        let cache = (&self.gpu.queue, self.surface_light.as_ref());
        let lights = stage.map_or(lights, |s| s.shade(input, &mut uniform, lights, cache));
        let slots = &self.slots;
        let each = lights.iter().enumerate().map(|(i, light)| {
            if by_planes {
                // Planes are lit by the faces of a distant dome.
                LightUniform::unmapped(&light.far())
            } else if cached {
                LightUniform::unmapped(light)
            } else {
                slots.uniform(i, light)
            }
        });
        self.light_maps.write_frame(&self.gpu.queue, &uniform, each);
        self.upload_lamps(input, has_virtual);
        self.prepare_look(input, view, has_virtual);
        Ok(plan)
    }

    fn highest_surroundings_level(&self) -> u32 {
        let pictures = self.pictures.as_ref();
        pictures.map_or(0, |p| p.surroundings.highest_level())
    }

    /// Brings the light of the dome's `lights` on surfaces up to date, `by_planes` the visibility of
    /// compact sources alone, if planes leave them out; and finds the tiles of the picture in which
    /// surfaces show shadows.
    fn update_surface_light(
        &mut self,
        input: &FrameInput<'_>,
        view: &FrameView,
        (lights, by_planes): (&[DomeLight], bool),
        has_virtual: bool,
    ) {
        let (Some(pictures), Some(light)) = (&self.pictures, &mut self.surface_light) else {
            return;
        };
        let queue = &self.gpu.queue;
        let tiles = &pictures.tiles.phantom.lights;
        let (across, down) = tiles.size();
        self.shadow_tiles.clear();
        self.shadow_tiles.resize((across * down) as usize, [0; 4]);
        self.chosen.clear();
        let seen = (input.lighting, input.world_from_camera);
        let planes = self.planes.as_ref().filter(|_| by_planes);
        let is_ready = light.keep_apart(by_planes);
        if let (true, (Some(lighting), Some(pose))) = (has_virtual, seen) {
            let in_background = self.settings.in_background && !by_planes;
            let own = (lighting, lights, input.indirect_light);
            let budget = self.settings.light_budget as usize;
            let (lighting, lights, indirect) = kept_light(input, own, in_background, budget);
            let surface_light = SurfaceLight::new(lighting, lights, indirect);
            if self.settings.in_background
                && let Ok(mut newest) = self.newest_light.try_lock()
            {
                newest.get_or_insert_default().keep(&surface_light);
            }
            if input.is_start {
                light.start_again(queue);
            }
            if is_ready && light.collect(queue) {
                let compact = &mut self.compact_lights;
                let lights = planes.map_or(lights, |planes| {
                    let left = lights.iter().filter(|_| planes.leaves_sources(input));
                    compact.clear();
                    let left = left.filter(|light| light.kind == LightKind::Compact);
                    compact.extend(left.copied());
                    compact
                });
                let (size, chosen) = (self.settings.map_size(), &mut self.chosen);
                self.slots.schedule(lights, size, input.refresh, chosen);
                if by_planes {
                    light.renew(lights, chosen);
                } else {
                    light.update(queue, &surface_light, chosen);
                }
            }
            let clip_from_world = view.clip_from_world(pose.inverse().to_matrix());
            let margin = rolling_shutter_margin(input, view);
            let tiles = &mut self.shadow_tiles;
            let served = planes.map_or(&[][..], |planes| planes.served_bounds());
            for shadowed in [light.shadowed(), served] {
                mark_tiles(shadowed, clip_from_world, view.size, (TILE, margin), tiles);
            }
        }
        tiles.upload(queue, bytemuck::cast_slice(&self.shadow_tiles), 16);
    }

    /// Chooses the exposure, has its passes compiled, allocates their pictures and uploads it.
    fn prepare_exposure(
        &mut self,
        input: &FrameInput<'_>,
        view: &FrameView,
        plan: &FramePlan,
        has_virtual: bool,
    ) {
        let device = &self.gpu.device;
        self.exposure.choose(&self.gpu, input, has_virtual);
        self.exposure.compile(
            device,
            &self.light_maps.frame_layout,
            self.variant,
            self.settings.in_background,
        );
        if let Some(pictures) = self
            .pictures
            .as_mut()
            .filter(|_| self.exposure.has_passes())
        {
            let size = pictures.size;
            pictures
                .exposed
                .get_or_insert_with(|| ExposedPictures::new(device, size));
        }
        let metered = MeteredFrame {
            subtract: plan.subtract,
            lamps_apart: plan.lamps_apart,
        };
        let queue = &self.gpu.queue;
        self.exposure
            .upload(queue, view.size.1, &self.response, metered);
    }

    /// Fits the stage of the camera's look and uploads its data.
    fn prepare_look(&mut self, input: &FrameInput<'_>, view: &FrameView, has_virtual: bool) {
        self.look.leave_out();
        if !has_virtual || input.look.is_none() {
            return;
        }
        let distorted = self
            .lens
            .as_ref()
            .is_some_and(|lens| lens.distorted().is_some());
        let camera = if distorted { &view.own } else { &view.camera };
        let factor = self.exposure.factor();
        let fit = LookFit {
            samples: self.settings.samples,
            distorted,
            exposed: self.exposure.is_changed(),
            in_background: self.settings.in_background,
        };
        let gpu = (&self.gpu.device, &self.gpu.queue);
        let parts = self.cover.boxes();
        let scene = (
            parts,
            self.scene.moving.as_slice(),
            self.scene.ground_height,
        );
        self.look.prepare(gpu, (camera, fit, factor), input, scene);
    }

    /// Prepares shadowing planes; false where the frame does not use them.
    fn prepare_planes(
        &mut self,
        input: &FrameInput<'_>,
        view: &FrameView,
        augmented: bool,
    ) -> Result<bool, GpuError> {
        let Some(stage) = &mut self.planes else {
            return Ok(false);
        };
        stage.prepare(
            &self.gpu,
            input,
            |camera_from_world| view.clip_from_world(camera_from_world),
            augmented,
            (&self.light_maps.frame_layout, self.variant),
            self.surface_light.as_ref(),
        )
    }

    /// Finds the tiles that virtual objects may cover, and chooses levels of detail.
    fn find_cover(&mut self, input: &FrameInput<'_>, view: &FrameView, visible: bool) {
        let pose = input.world_from_camera.filter(|_| visible);
        let camera_from_world = pose.map_or(DMat4::IDENTITY, |p| p.inverse().to_matrix());
        let clip_from_world = view.clip_from_world(camera_from_world);
        let emitters = self.scene.emitters.boxes();
        let mirrors = self.reflections.mirrors();
        self.cover.set_margin(rolling_shutter_margin(input, view));
        self.cover.update(
            clip_from_world,
            view.size,
            pose.is_some(),
            emitters,
            mirrors,
        );
        let focal = view.camera.focal.max_element();
        for part in &mut self.scene.virtual_parts {
            part.details.choose(clip_from_world, focal);
        }
    }

    /// Uploads the virtual lights and lists their shadow maps that are out of date.
    fn upload_lamps(&mut self, input: &FrameInput<'_>, has_virtual: bool) {
        let lamps = if has_virtual { input.lamps } else { &[] };
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        let areas = lamps.iter().any(|lamp| lamp.area.is_some());
        let ratio = if areas || self.variant.soft > 1 {
            LAMP_MAP_RATIO
        } else {
            1
        };
        let size = ratio * self.settings.map_size();
        let (casters, screens) = (self.slots.casters(), &self.scene.screens);
        self.light_maps
            .write_lamps(device, queue, (lamps, screens), casters, size);
    }
}

/// Displacement, pixels, that a rolling shutter gives to anything at least half a metre away: tiles
/// are found without it.
fn rolling_shutter_margin(input: &FrameInput<'_>, view: &FrameView) -> f64 {
    let Some(shutter) = &input.rolling_shutter else {
        return 0.0;
    };
    let rows = f64::from(view.own.height);
    let per_row = shutter.rotation_per_row.length() + shutter.translation_per_row.length();
    2.0 * view.camera.focal.max_element() * rows * per_row
}

/// The light, its dome lights within the budget, and its indirect light.
type LightOnSurfaces<'a> = (&'a Lighting, &'a [DomeLight], Option<&'a IndirectLight>);

/// The light for which the light on surfaces is computed: that of the picture, its `own`, or, where it is
/// computed in the background and therefore shown with the next picture, that of the next one.
fn kept_light<'a>(
    input: &FrameInput<'a>,
    own: LightOnSurfaces<'a>,
    in_background: bool,
    budget: usize,
) -> LightOnSurfaces<'a> {
    let is_later = in_background && !input.is_start;
    let coming = input.coming_light.filter(|_| is_later);
    coming.map_or(own, |coming| {
        let lights = coming.lighting.lights.as_slice();
        let lights = &lights[..lights.len().min(budget)];
        (coming.lighting, lights, coming.indirect)
    })
}
