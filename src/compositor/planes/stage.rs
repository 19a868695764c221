//! Shadowing planes as a step of the frame: sums basis images, and provides the shadows and the
//! lights of the frame.

use super::super::frame_input::FrameInput;
use super::super::gpu::{Gpu, GpuError};
use super::super::gpu_data::FrameUniform;
use super::super::passes::shadow_buffer::ShadowSource;
use super::super::recorder::Recorder;
use super::super::shaders::Variant;
use super::super::surface_light::CachedLight;
use super::on_pixels::PixelPlanes;
use super::on_surfaces::{SurfacePlanes, SurfaceShading};
use super::options::PlanesChoice;
use super::source_images::SourceBaker;
use super::synthesis::PlaneWork;
use super::visible_pages::Viewer;
use crate::compiled::Device;
use glam::{DMat4, DVec3, Vec3};
use penumbra_interface::RigidTransform;
use penumbra_lighting::geodesic::{FaceLight, GeodesicDome, sum_faces};
use penumbra_lighting::{DomeLight, LightKind, LightPlace};
use penumbra_scene::PlaneShading;
use penumbra_scene::planes::{Bake, ShadowingPlane};
use penumbra_surface_cache::{Bounds, ReceiverPage};
use std::sync::Arc;

/// To what planes are applied.
enum Applied {
    /// To each pixel, by the device.
    Pixels(Box<PixelPlanes>),
    /// To the texels of the surface cache, by the processor.
    Surfaces(Box<SurfacePlanes>),
}

/// Owns a bake with its sums.
pub struct PlanesStage {
    applied: Applied,
    dome: GeodesicDome,
    /// Whether compact sources are left to the surface cache.
    sources_apart: bool,
    /// Whether a picture waits for the images of compact sources.
    pub(crate) waits_for_sources: bool,
    viewer: Viewer,
    /// Whether the current frame uses planes.
    is_active: bool,
    /// The planes as they were baked.
    planes: Vec<ShadowingPlane>,
    world_from_bake: RigidTransform,
    /// Lights of faces, for shading.
    lights: Vec<DomeLight>,
    /// Generation of the light and the shading for which `lights` were made.
    lights_made_for: Option<(u64, PlaneShading)>,
}

impl PlanesStage {
    /// Takes over a bake: for the surface cache if there is one (`cached`), otherwise uploads it
    /// and compiles the passes that sum it; for `sources` see
    /// [`crate::Compositor::set_bake_with_sources`]. May run on any thread.
    ///
    /// # Errors
    /// The bake has an impossible dome, or more images than the device can hold.
    pub fn new(
        gpu: &Gpu,
        bake: &Bake,
        sources: Option<SourceBaker>,
        cached: bool,
    ) -> Result<Self, GpuError> {
        let dome = GeodesicDome::new(bake.settings.frequency).ok_or_else(|| GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason: format!(
                "the bake has a geodesic dome of unsupported frequency {}",
                bake.settings.frequency
            ),
        })?;
        Ok(Self {
            applied: if cached {
                Applied::Surfaces(Box::new(SurfacePlanes::new(bake, &dome)))
            } else {
                Applied::Pixels(Box::new(PixelPlanes::new(gpu, bake, sources)?))
            },
            dome,
            sources_apart: false,
            waits_for_sources: false,
            viewer: (DMat4::IDENTITY, DVec3::ZERO),
            is_active: false,
            planes: bake.planes.clone(),
            world_from_bake: RigidTransform::IDENTITY,
            lights: Vec::new(),
            lights_made_for: None,
        })
    }

    /// Renders the images of the compact sources in `light`, the light of the next frame, so that
    /// that frame does not wait for them. Without light they are rendered over frames.
    pub fn prepare_sources(&mut self, gpu: &Gpu, light: Option<&FaceLight>) {
        if let Applied::Pixels(pixels) = &mut self.applied
            && let Some(sources) = &mut pixels.sources
        {
            sources.begin(gpu, light);
        }
    }

    /// Leaves compact sources to the surface cache, which casts their shadows from where they are
    /// now, instead of giving them images of their own.
    pub(crate) const fn leave_sources_to_cache(&mut self) {
        self.sources_apart = true;
    }

    /// Whether the compact sources of a frame are left to the surface cache. The papers' shading by
    /// faces needs their light in the faces.
    pub(crate) fn leaves_sources(&self, input: &FrameInput<'_>) -> bool {
        let by_irradiance = |p: PlanesChoice| p.shading == PlaneShading::Irradiance;
        self.sources_apart && input.planes.is_some_and(by_irradiance)
    }

    /// Compiles the passes that apply planes, unless they are there; `frame` is the layout of a
    /// frame's data.
    pub(super) fn compile(
        &mut self,
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        variant: Variant,
    ) {
        if let Applied::Pixels(pixels) = &mut self.applied {
            pixels.compile(device, frame, variant);
        }
    }

    /// Chooses the planes that serve `pages`, unless that is done.
    pub(super) fn serve(&mut self, pages: &Arc<[ReceiverPage]>) {
        if let Applied::Surfaces(surfaces) = &mut self.applied {
            surfaces.serve(pages);
        }
    }

    /// Bounds of the pages of real surfaces in the surface cache that planes serve.
    pub(crate) fn served_bounds(&self) -> &[Bounds] {
        match &self.applied {
            Applied::Surfaces(surfaces) => surfaces.served_bounds(),
            Applied::Pixels(_) => &[],
        }
    }

    /// Takes over the passes of another stage, unless this one has some: they are the same for all
    /// bakes.
    pub(crate) fn take_pipelines(&mut self, before: Self) {
        if let (Applied::Pixels(pixels), Applied::Pixels(before)) =
            (&mut self.applied, before.applied)
        {
            pixels.take_pipelines(*before);
        }
    }

    /// Moves the planes with a model that was moved as a whole since it was baked.
    pub(crate) fn place(&mut self, world_from_bake: RigidTransform) {
        self.world_from_bake = world_from_bake;
        self.lights_made_for = None;
        match &mut self.applied {
            Applied::Surfaces(surfaces) => surfaces.place(&self.planes, world_from_bake),
            Applied::Pixels(pixels) => {
                pixels.synthesis.place(&self.planes, world_from_bake);
                if let Some(sources) = &mut pixels.sources {
                    sources.set_rotation(world_from_bake.rotation.inverse().as_quat());
                }
            }
        }
    }

    /// The work of the last frame; `None` if its shadows did not come from planes. Waits for the
    /// device where that does the work.
    pub(crate) fn work(&self, gpu: &Gpu) -> Result<Option<PlaneWork>, GpuError> {
        match &self.applied {
            _ if !self.is_active => Ok(None),
            Applied::Pixels(pixels) => pixels.work(gpu).map(Some),
            Applied::Surfaces(surfaces) => Ok(Some(surfaces.work())),
        }
    }

    /// Prepares the planes for a frame: sums them, or uploads its light and the visible planes for
    /// passes of `variant`; `frame` is the layout of its data and `cache` the scene's surface cache.
    /// Returns false if the frame does not use planes or has no light.
    ///
    /// # Errors
    /// The light has more pixels than the device can read.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        input: &FrameInput<'_>,
        camera: impl Fn(DMat4) -> DMat4,
        augmented: bool,
        (frame, variant): (&wgpu::BindGroupLayout, Variant),
        cache: Option<&CachedLight>,
    ) -> Result<bool, GpuError> {
        let was_active = std::mem::take(&mut self.is_active);
        let (Some(choice), Some(pose)) = (input.planes, input.world_from_camera) else {
            return Ok(false);
        };
        let Some((lighting, faces)) = input.lighting.and_then(|l| Some((l, l.faces.as_ref()?)))
        else {
            return Ok(false);
        };
        if !augmented {
            return Ok(false);
        }
        self.viewer = (camera(pose.inverse().to_matrix()), pose.translation);
        let leaves = self.leaves_sources(input);
        let light = (faces.as_ref(), lighting.generation);
        match &mut self.applied {
            Applied::Pixels(pixels) => {
                pixels.compile(&gpu.device, frame, variant);
                let waits = self.waits_for_sources;
                pixels.prepare(gpu, light, self.viewer, choice.thresholds, waits)?;
            }
            Applied::Surfaces(surfaces) => {
                if let Some(cache) = cache {
                    surfaces.serve(cache.pages());
                }
                if !was_active {
                    surfaces.expire();
                }
                surfaces.sum(light, leaves, choice.thresholds);
            }
        }
        self.is_active = true;
        Ok(true)
    }

    /// Has the device sum basis images under the light of this frame. Returns what pixels look up;
    /// `None` where they look up the surface cache or the frame does not use planes.
    pub(crate) fn record(&mut self, r: &mut Recorder<'_>) -> Option<ShadowSource<'_>> {
        match &mut self.applied {
            Applied::Pixels(pixels) if self.is_active => pixels.record(r),
            _ => None,
        }
    }

    /// Returns the lights that shade virtual objects: `lights` of the environment, or those of
    /// faces. Writes the light on surfaces into `cache`, if there is one.
    pub(crate) fn shade<'a>(
        &'a mut self,
        input: &FrameInput<'_>,
        uniform: &mut FrameUniform,
        lights: &'a [DomeLight],
        (queue, cache): (&wgpu::Queue, Option<&CachedLight>),
    ) -> &'a [DomeLight] {
        let (low, high) = match &self.applied {
            Applied::Pixels(pixels) => pixels.synthesis.bounds(),
            Applied::Surfaces(surfaces) => surfaces.placed().bounds,
        };
        uniform.planes_low = low.as_vec3().extend(1.0).to_array();
        uniform.planes_high = high.as_vec3().extend(0.0).to_array();
        let shading = input.planes.map_or(PlaneShading::Irradiance, |p| p.shading);
        let is_by_faces = self.shade_by_faces(input, shading, uniform);
        let lights = if is_by_faces { &self.lights } else { lights };
        if let (Applied::Surfaces(surfaces), Some(cache)) = (&mut self.applied, cache) {
            let frame = SurfaceShading {
                uniform,
                lights,
                shading,
                indirect: input.indirect_light,
            };
            surfaces.write(queue, &self.viewer, &frame, cache);
        }
        lights
    }

    /// Replaces the environment by lights of faces, if the `shading` wants that.
    fn shade_by_faces(
        &mut self,
        input: &FrameInput<'_>,
        shading: PlaneShading,
        uniform: &mut FrameUniform,
    ) -> bool {
        let faces = input.lighting.and_then(|l| Some((l, l.faces.as_ref()?)));
        let (Some((lighting, faces)), false) = (faces, shading == PlaneShading::Irradiance) else {
            return false;
        };
        if self.lights_made_for != Some((lighting.generation, shading)) {
            self.light_faces(&sum_faces(faces), shading == PlaneShading::Six);
            self.lights_made_for = Some((lighting.generation, shading));
        }
        // Of the light that no dome light represents, only the ground's remains: π/2 · L · (1 −
        // n.z).
        let ground = Vec3::from_slice(&uniform.ground[..3]) * std::f32::consts::FRAC_PI_2;
        uniform.harmonics = [[0.0; 4]; 9];
        if uniform.params[2] > 0.0 {
            uniform.harmonics[0] = ground.extend(0.0).to_array();
            uniform.harmonics[2] = (-ground).extend(0.0).to_array();
        }
        true
    }

    /// Makes one light per face or, with `six`, the papers' six lights.
    fn light_faces(&mut self, sums: &[Vec3], six: bool) {
        self.lights.clear();
        let rotation = self.world_from_bake.rotation.as_quat();
        if six {
            let six = self.dome.six_groups();
            let each = six.directions.iter().zip(six.sums(sums));
            self.lights
                .extend(each.map(|(d, s)| directional_light(rotation * *d, s)));
        } else {
            let each = self.dome.faces.iter().zip(sums);
            self.lights
                .extend(each.map(|(f, s)| directional_light(rotation * f.centre, *s)));
        }
    }
}

fn directional_light(direction: Vec3, irradiance: Vec3) -> DomeLight {
    DomeLight {
        direction,
        irradiance,
        angular_radius: 0.0,
        kind: LightKind::Compact,
        place: LightPlace::FAR,
    }
}
