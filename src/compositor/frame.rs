//! One frame, top to bottom.

use super::exposure::{ExposedInputs, Exposure};
use super::gpu_data::LightUniform;
use super::passes::composite::{CompositeInputs, CompositePass};
use super::passes::lamp_map::LampMapPass;
use super::passes::lamp_response::LampResponsePass;
use super::passes::phantom_geometry::PhantomGeometryPass;
use super::passes::shadow_buffer::{ShadowBufferInputs, ShadowBufferPass};
use super::passes::shadow_map::ShadowMapPass;
use super::passes::surroundings::{SurroundingsInputs, SurroundingsPass};
use super::passes::tiles::TilesPass;
use super::passes::virtual_geometry::VirtualGeometryPass;
use super::planes::PlanesChoice;
use super::readback::Readback;
use super::scene_buffers::SceneLayouts;
use super::shaders::Variant;
use super::targets::{ENCODING, Targets};
use super::{Compositor, GpuError, Refresh};
use glam::{DMat4, DVec4, Vec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_lighting::Lighting;
use penumbra_picture::Picture;
use penumbra_scene::Highlights;
pub use penumbra_scene::ShadowMode;
use penumbra_scene::{IndirectLight, PlacedLamp};

/// How real surfaces answer lamps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LampResponse {
    /// Picture ÷ estimated irradiance = albedo: the picture is multiplied by
    /// 1 + lamps / what arrives.
    #[default]
    Intrinsic,
    /// DiVerdi and Höllerer 2004, section 4.2: a blend of N·L and the picture's own relief is
    /// added.
    Paper {
        /// To the brightest physical light, world, times its dominance
        /// ([`penumbra_lighting::BrightestLight::vector`]).
        brightest: Vec3,
    },
}

/// What a frame is made of.
pub struct FrameInput<'a> {
    /// The scene camera's picture.
    pub picture: &'a Picture,
    /// The scene camera.
    pub camera: &'a PinholeCamera,
    /// Its pose at the middle of the exposure; `None` shows the camera's picture alone.
    pub world_from_camera: Option<RigidTransform>,
    /// The light; `None` shows the camera's picture alone.
    pub lighting: Option<&'a Lighting>,
    /// What virtual objects throw back onto the real scene under that light, if it is known.
    pub near: Option<&'a IndirectLight>,
    /// Lamps that shine in the picture only; after [`penumbra_scene::lamps::MOST_LAMPS`] they are left out.
    pub lamps: &'a [PlacedLamp],
    /// How real surfaces answer them.
    pub lamp_response: LampResponse,
    /// How shadows combine.
    pub shadow_mode: ShadowMode,
    /// 0 = no shadows, 1 = as strong as the light says.
    pub shadow_strength: f32,
    /// Which shadow maps are drawn again.
    pub refresh: Refresh,
    /// Draw virtual objects at all.
    pub show_virtual: bool,
    /// Shadows by shadowing planes instead of the dome's maps, once something is baked
    /// ([`Compositor::set_bake`]).
    pub planes: Option<PlanesChoice>,
    /// In which exposure all of it is shown.
    pub exposure: Exposure,
    /// What clipped areas become in a shorter one.
    pub highlights: Highlights,
}

/// All pipelines.
pub struct Pipelines {
    shadow_map: ShadowMapPass,
    lamp_map: LampMapPass,
    lamp_response: LampResponsePass,
    phantom_geometry: PhantomGeometryPass,
    virtual_geometry: VirtualGeometryPass,
    tiles: TilesPass,
    pub(super) shadow_buffer: ShadowBufferPass,
    surroundings: SurroundingsPass,
    composite: CompositePass,
}

impl Pipelines {
    pub(super) fn new(
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        scene: &SceneLayouts,
        variant: Variant,
    ) -> Self {
        Self {
            shadow_map: ShadowMapPass::new(device, frame, scene),
            lamp_map: LampMapPass::new(device, scene),
            lamp_response: LampResponsePass::new(device, frame, scene, variant),
            phantom_geometry: PhantomGeometryPass::new(device, frame, scene, variant),
            virtual_geometry: VirtualGeometryPass::new(device, frame, scene, variant),
            tiles: TilesPass::new(device, frame, variant),
            shadow_buffer: ShadowBufferPass::new(device, frame, variant),
            surroundings: SurroundingsPass::new(device, frame, variant),
            composite: CompositePass::new(device, frame, variant),
        }
    }
}

/// What depends on the picture's size.
pub struct Sized {
    pub(super) targets: Targets,
    tiles: wgpu::BindGroup,
    shadow_buffer: ShadowBufferInputs,
    lamp_response: wgpu::BindGroup,
    surroundings: SurroundingsInputs,
    composite: CompositeInputs,
    /// In place of the last two, for pictures in another exposure.
    exposed: Option<ExposedInputs>,
    metered: Option<wgpu::BindGroup>,
    lens: Option<wgpu::BindGroup>,
    reproject: Option<wgpu::BindGroup>,
    readback: Readback,
}

/// Distance of the near plane, metres: nearer than any hand-held object is looked at.
pub(super) const NEAR: f64 = 0.02;

/// A lamp's maps have so many times the texels of a dome light's, each way, where there is time
/// for soft shadows, and where areas divide them into views: lamps' shadows have sharp
/// edges, and there are few. Else as many, which are a picture's pixels across its casters.
const LAMP_MAPS: u32 = 2;

impl Compositor {
    /// Makes one picture. Nothing is waited for; [`Self::read`] does that.
    ///
    /// # Errors
    /// The picture is too large for the device.
    pub fn compose(&mut self, input: &FrameInput<'_>) -> Result<(), GpuError> {
        self.fit_lens(input.camera);
        self.fit_reprojection(input);
        match self.lens.clone() {
            None => self.prepare(input, input.picture)?,
            Some(lens) => {
                let straight = FrameInput {
                    picture: &lens.blank,
                    camera: &lens.straight,
                    ..*input
                };
                self.prepare(&straight, input.picture)?;
            }
        }
        let Some(sized) = self.sized.take() else {
            return Ok(());
        };
        let descriptor = wgpu::CommandEncoderDescriptor {
            label: Some("frame"),
        };
        let mut encoder = self.gpu.device.create_command_encoder(&descriptor);
        self.timer.begin_frame();
        self.record(&mut encoder, &sized);
        let output = self.finished(&sized);
        sized.readback.record(&mut encoder, &output.texture);
        self.timer.end_frame(&mut encoder);
        let submitted = self.gpu.queue.submit([encoder.finish()]);
        self.exposure.submitted(&submitted);
        self.sized = Some(sized);
        Ok(())
    }

    /// Waits for the last frame and takes its picture.
    ///
    /// # Errors
    /// The device was lost, or nothing was composed yet.
    pub fn read(&self, picture: &mut Picture) -> Result<(), GpuError> {
        match &self.sized {
            Some(sized) => sized.readback.read(self, picture),
            None => Err(GpuError::Failed {
                adapter: self.gpu.name.clone(),
                reason: "no frame was composed yet".to_owned(),
            }),
        }
    }

    /// The passes in their order.
    fn record(&mut self, encoder: &mut wgpu::CommandEncoder, sized: &Sized) {
        let p = &self.pipelines;
        let timer = &mut self.timer;
        let frame = &self.light_maps.frame_group;
        let (scene, t) = (&self.scene, &sized.targets);
        // The camera's picture as another exposure shows it, where one is wanted.
        let exposed = self.exposure.passes().zip(sized.exposed.as_ref());
        // A bent picture made straight.
        if let Some(lens) = &self.lens {
            lens.record_in(encoder, timer, t);
        }
        if let Some((_, inputs)) = exposed {
            self.exposure.record(encoder, timer, inputs, t);
        }
        // What casts, seen from the lights whose maps are out of date.
        let maps = (&self.maps.0, &self.maps.1);
        p.shadow_map
            .record(encoder, timer, frame, scene, maps, &self.chosen);
        // The same from lamps that have moved.
        let lamps = &self.light_maps.lamps;
        p.lamp_map
            .record(&self.gpu.device, encoder, timer, scene, lamps);
        // What the camera sees of the real scene's proxies and of the virtual objects.
        p.phantom_geometry.record(encoder, timer, frame, scene, t);
        p.virtual_geometry.record(encoder, timer, frame, scene, t);
        // Where in the picture which light could be missing.
        p.tiles.record(
            encoder,
            timer,
            [frame, &sized.tiles],
            t,
            self.cover.rectangle(),
        );
        // What light each of those surfaces lacks.
        let unshadowed = if self.subtract { 0.0 } else { 1.0 };
        let inputs = &sized.shadow_buffer;
        let planes = self.planes.as_mut().filter(|stage| stage.is_shown());
        let (passes, shadows) = match planes.and_then(|stage| stage.record(encoder, timer)) {
            Some(by_planes) => by_planes,
            None => (p.shadow_buffer.by_maps(), &inputs.maps),
        };
        let groups = [frame, shadows, &inputs.surfaces];
        passes.record(encoder, timer, groups, t, unshadowed);
        // What lamps add to them by the paper's response, if it is wanted.
        if self.answers {
            let groups = [frame, &sized.lamp_response];
            p.lamp_response.record(encoder, timer, groups, scene, t);
        }
        let ((surroundings, composite), inputs) = match exposed {
            Some((passes, inputs)) => (passes, (&inputs.surroundings, &inputs.composite)),
            None => (
                (&p.surroundings, &p.composite),
                (&sized.surroundings, &sized.composite),
            ),
        };
        // What virtual objects mirror of the real scene, shadows included.
        surroundings.record(encoder, timer, frame, inputs.0, t);
        // The picture.
        composite.record(encoder, timer, frame, inputs.1, t);
        // Bent again, as the camera sees.
        if let Some(lens) = &self.lens {
            lens.record_out(encoder, timer, sized.lens.as_ref(), exposed.is_some());
        }
        // Turned to where it is seen from.
        let turned = self
            .reproject
            .as_ref()
            .filter(|_| self.reprojection.is_some());
        if let Some((stage, inputs)) = turned.zip(sized.reproject.as_ref()) {
            stage.record(encoder, timer, inputs);
        }
        // How much light virtual lights bring, for the exposure of pictures to come.
        self.exposure
            .record_meter(encoder, timer, sized.metered.as_ref());
    }

    /// Everything that is uploaded; `picture` as the camera took it.
    fn prepare(&mut self, input: &FrameInput<'_>, picture: &Picture) -> Result<(), GpuError> {
        self.fit_variant(input.lamps);
        let mut rebind = self.fit_targets(input.picture)?;
        if let Some(lighting) = input.lighting
            && self.radiance_generation != Some(lighting.generation)
        {
            let (device, queue) = (&self.gpu.device, &self.gpu.queue);
            rebind |= self.light_maps.gloss.write(
                device,
                queue,
                &lighting.radiance,
                self.scene.has_phong,
            );
            self.radiance_generation = Some(lighting.generation);
        }
        if rebind {
            self.rebind();
        }
        if let Some(near) = input.near
            && self.near_generation != near.generation
        {
            self.light_maps.write_near(&self.gpu.queue, near);
            self.near_generation = near.generation;
        }
        self.upload_picture(picture);
        self.upload_frame(input)
    }

    fn upload_frame(&mut self, input: &FrameInput<'_>) -> Result<(), GpuError> {
        let something = !(self.scene.virtual_parts.is_empty() && input.lamps.is_empty());
        let augmented = input.show_virtual && something;
        let lights = match (input.lighting, input.world_from_camera) {
            (Some(lighting), Some(_)) if augmented => lighting.lights.as_slice(),
            _ => &[],
        };
        let lights = &lights[..lights.len().min(self.settings.light_budget as usize)];
        let size = self.shadow_map_size();
        self.subtract = input.shadow_mode == ShadowMode::Subtract;
        let seen = augmented && input.lighting.is_some() && input.world_from_camera.is_some();
        self.answers =
            seen && !input.lamps.is_empty() && input.lamp_response != LampResponse::Intrinsic;
        self.prepare_exposure(input, seen);
        let by_planes = self.prepare_planes(input, augmented)?;
        // Planes need no maps.
        let mapped = if by_planes { &[] } else { lights };
        self.slots
            .schedule(mapped, size, input.refresh, &mut self.chosen);
        self.refreshed = self.chosen.len();
        let mut uniform = self.frame_uniform(input, mapped.len(), augmented);
        let lamps = if seen { input.lamps } else { &[] };
        self.scene.emitters.place(&self.gpu.queue, lamps);
        self.upload_cover(input, augmented && input.lighting.is_some());
        let stage = self.planes.as_mut().filter(|_| by_planes);
        let lights = stage.map_or(lights, |stage| stage.shade(input, &mut uniform, lights));
        let slots = &self.slots;
        let each = lights.iter().enumerate().map(|(i, light)| {
            if by_planes {
                LightUniform::unmapped(light)
            } else {
                slots.uniform(i, light)
            }
        });
        let (device, queue) = (&self.gpu.device, &self.gpu.queue);
        self.light_maps.write_frame(queue, &uniform, each);
        let (casters, screens) = (slots.casters(), &self.scene.screens);
        let areas = lamps.iter().any(|lamp| lamp.area.is_some());
        let fine = areas || self.variant.soft > 1;
        let lamp_size = if fine { LAMP_MAPS * size } else { size };
        self.light_maps
            .write_lamps(device, queue, (lamps, screens), casters, lamp_size);
        Ok(())
    }

    /// Pixels by which a rolling shutter moves anything that is half a metre away or more;
    /// tiles are found without it.
    fn rolling_margin(&self, camera: &PinholeCamera) -> f64 {
        let Some(rolling) = self.rolling else {
            return 0.0;
        };
        let own = self.own_camera(camera);
        let rows = f64::from(own.height);
        let way = rolling.rotation_per_row.length() + rolling.translation_per_row.length();
        2.0 * camera.focal.max_element() * rows * way
    }

    /// Tells the tiles that virtual objects lie in.
    fn upload_cover(&mut self, input: &FrameInput<'_>, augmented: bool) {
        let size = (input.picture.width, input.picture.height);
        let pose = input.world_from_camera.filter(|_| augmented);
        let camera_from_world = pose.map_or(DMat4::IDENTITY, |p| p.inverse().to_matrix());
        let clip_from_world = clip_from_camera(input.camera) * camera_from_world;
        let emitters = self.scene.emitters.boxes();
        self.cover.set_margin(self.rolling_margin(input.camera));
        self.cover
            .update(clip_from_world, size, pose.is_some(), emitters);
        let focal = input.camera.focal.max_element();
        for part in &mut self.scene.virtual_parts {
            part.details.choose(clip_from_world, focal);
        }
        let Some(sized) = &self.sized else { return };
        let texture = &sized.targets.covered.texture;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(texture.width()),
            rows_per_image: None,
        };
        let to = texture.as_image_copy();
        self.gpu
            .queue
            .write_texture(to, self.cover.tiles(), layout, texture.size());
    }

    fn fit_targets(&mut self, picture: &Picture) -> Result<bool, GpuError> {
        let size = (picture.width, picture.height);
        let sized = self.sized.as_ref().map(|s| &s.targets);
        if sized.is_some_and(|t| (t.width, t.height) == size) {
            return Ok(false);
        }
        let largest = self.gpu.device.limits().max_texture_dimension_2d;
        if size.0 == 0 || size.1 == 0 || size.0 > largest || size.1 > largest {
            return Err(GpuError::Unfit {
                adapter: self.gpu.name.clone(),
                reason: format!(
                    "pictures of {}×{} pixels (at most {largest} each way)",
                    size.0, size.1
                ),
            });
        }
        let targets = self.make_targets(size.0, size.1);
        write_response(&self.gpu.queue, &targets, &self.response);
        self.sized = Some(self.bind(targets));
        Ok(false)
    }

    pub(super) fn rebind(&mut self) {
        if let Some(sized) = self.sized.take() {
            self.sized = Some(self.bind(sized.targets));
        }
    }

    fn bind(&self, targets: Targets) -> Sized {
        let (device, p) = (&self.gpu.device, &self.pipelines);
        let maps = (&self.maps.0, &self.maps.1);
        let light = &self.light_maps;
        let camera = &targets.camera.view;
        Sized {
            tiles: p.tiles.bind(device, &targets),
            shadow_buffer: p.shadow_buffer.bind(device, maps, &targets),
            lamp_response: p.lamp_response.bind(device, &targets),
            surroundings: p.surroundings.bind(device, &targets, camera),
            composite: p.composite.bind(device, &targets, camera, &light.gloss),
            exposed: self.exposure.bind(device, &targets, &light.gloss),
            metered: self.exposure.bind_meter(device, &targets),
            lens: self
                .lens
                .as_ref()
                .and_then(|lens| lens.bind(device, &targets)),
            reproject: self
                .reproject
                .as_ref()
                .map(|stage| stage.bind(device, &self.unturned(&targets).view)),
            readback: {
                let straight = (targets.width, targets.height);
                let lens = self.lens.as_ref();
                let (width, height) = lens.map_or(straight, |lens| lens.size());
                Readback::new(device, width, height)
            },
            targets,
        }
    }

    fn upload_picture(&self, picture: &Picture) {
        let Some(sized) = &self.sized else { return };
        let straight = &sized.targets.camera.texture;
        let texture = self
            .lens
            .as_ref()
            .map_or(straight, |lens| &lens.raw.texture);
        self.gpu.queue.write_texture(
            texture.as_image_copy(),
            &picture.rgba,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(4 * picture.width),
                rows_per_image: None,
            },
            texture.size(),
        );
    }
}

/// Projection of the camera frame (+X right, +Y down, +Z forward) to clip space with
/// reversed depth and the far plane at infinity. Pixel (0, 0) is the centre of the
/// top-left pixel, so the left edge of the picture lies at −0.5.
pub(super) fn clip_from_camera(camera: &PinholeCamera) -> DMat4 {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let (f, c) = (camera.focal, camera.centre);
    DMat4::from_cols(
        DVec4::new(2.0 * f.x / w, 0.0, 0.0, 0.0),
        DVec4::new(0.0, -2.0 * f.y / h, 0.0, 0.0),
        DVec4::new(
            2.0 * (c.x + 0.5) / w - 1.0,
            1.0 - 2.0 * (c.y + 0.5) / h,
            0.0,
            1.0,
        ),
        DVec4::new(0.0, 0.0, NEAR, 0.0),
    )
}

/// Uploads the response and its inverse.
pub(super) fn write_response(queue: &wgpu::Queue, targets: &Targets, response: &Response) {
    let encoding: Vec<f32> = (0..ENCODING)
        .map(|i| {
            let root = i as f32 / (ENCODING - 1) as f32;
            response.encoded_from_linear(root * root)
        })
        .collect();
    let decoding = bytemuck::cast_slice(&response.linear_from_code()[..]);
    queue.write_buffer(&targets.codes, 0, decoding);
    queue.write_buffer(&targets.codes, 1024, bytemuck::cast_slice(&encoding));
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;
    use glam::{DVec2, DVec3};

    #[test]
    fn the_projection_agrees_with_the_camera_model() {
        let camera = PinholeCamera {
            width: 640,
            height: 480,
            focal: DVec2::new(700.0, 701.5),
            centre: DVec2::new(322.3, 237.1),
            distortion: [0.0; 5],
        };
        for p in [DVec3::new(0.1, -0.2, 1.5), DVec3::new(-0.4, 0.3, 0.9)] {
            let clip = clip_from_camera(&camera) * p.extend(1.0);
            let ndc = clip.truncate() / clip.w;
            let frame = DVec2::new((ndc.x + 1.0) * 320.0, (1.0 - ndc.y) * 240.0);
            let pixel = camera.project(p).unwrap();
            assert!((frame - pixel - DVec2::splat(0.5)).length() < 1e-9);
            assert!((ndc.z - NEAR / p.z).abs() < 1e-12);
        }
    }
}
