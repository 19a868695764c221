//! Shadowing planes as a step of the frame: uploads the light, sums basis images, and provides the
//! shadows and the lights of the frame.

use super::super::frame_input::FrameInput;
use super::super::gpu::{Gpu, GpuError};
use super::super::gpu_data::FrameUniform;
use super::super::passes::shadow_buffer::{MarkedPasses, ShadowBufferPass, ShadowSource};
use super::super::recorder::Recorder;
use super::super::shaders::Variant;
use super::super::surface_light::{AtlasPages, CachedLight};
use super::choice::Planes;
use super::luminance::LuminancePass;
use super::on_surfaces::{ServedSurfaces, SurfacePasses, Viewer};
use super::options::PlanesChoice;
use super::source_images::SourceBaker;
use super::source_stage::SourceStage;
use super::synthesis::{PlaneWork, Synthesis, SynthesisPasses};
use glam::{DMat4, DVec3, Vec3};
use penumbra_interface::RigidTransform;
use penumbra_lighting::geodesic::{FaceLight, GeodesicDome, sum_faces};
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_scene::PlaneShading;
use penumbra_scene::planes::{Bake, ShadowingPlane};
use penumbra_surface_cache::Bounds;
use std::sync::Arc;

/// How planes are applied.
enum PlanePasses {
    /// To each pixel.
    Pixels(MarkedPasses),
    /// To the texels of the surface cache.
    Surfaces(SurfacePasses),
}

/// Generations of the light and of the indirect light, uploads of light that is kept apart, and the
/// shading.
type WrittenFor = (u64, u64, u64, PlaneShading);

/// Owns a bake on the device and the passes that sum it.
pub struct PlanesStage {
    passes: SynthesisPasses,
    luminance: LuminancePass,
    synthesis: Synthesis,
    sources: Option<SourceStage>,
    dome: GeodesicDome,
    /// The passes that apply the planes, and the variant for which they are compiled.
    passes_for: Option<(Variant, PlanePasses)>,
    /// The surface cache with the planes that serve it.
    served: Option<ServedSurfaces>,
    /// Of each plane the depths that it sees; `side²` of them, or none.
    depths: Vec<Vec<u16>>,
    side: usize,
    /// Whether compact sources are left to the surface cache, where there is one.
    sources_apart: bool,
    /// Whether a picture waits for the images of compact sources.
    pub(crate) waits_for_sources: bool,
    /// Number of compact sources that are left to it in this frame.
    left_sources: usize,
    /// What the light in the surface cache was made for.
    written_for: Option<WrittenFor>,
    light_now: Option<(u64, u64, PlaneShading)>,
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
    /// Uploads a bake and compiles the passes that sum it; for `sources` see
    /// [`crate::Compositor::set_bake_with_sources`]. May run on any thread.
    ///
    /// # Errors
    /// The bake has an impossible dome, or more images than the device can hold.
    pub fn new(gpu: &Gpu, bake: &Bake, sources: Option<SourceBaker>) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let dome = GeodesicDome::new(bake.settings.frequency).ok_or_else(|| GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason: format!(
                "the bake has a geodesic dome of unsupported frequency {}",
                bake.settings.frequency
            ),
        })?;
        let passes = SynthesisPasses::new(device);
        let synthesis = Synthesis::new(gpu, &passes, bake, sources.is_some())?;
        let targets = synthesis.source_targets();
        let sources = sources.map(|baker| SourceStage::new(device, baker, &targets));
        Ok(Self {
            sources,
            synthesis,
            luminance: LuminancePass::for_adapter(gpu),
            passes,
            dome,
            passes_for: None,
            served: None,
            depths: bake.receivers.iter().map(|r| r.depths.clone()).collect(),
            side: bake.settings.resolution as usize,
            sources_apart: false,
            waits_for_sources: false,
            left_sources: 0,
            written_for: None,
            light_now: None,
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
        if let Some(sources) = &mut self.sources {
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
        device: &wgpu::Device,
        frame: &wgpu::BindGroupLayout,
        variant: Variant,
    ) {
        if self.passes_for.as_ref().is_some_and(|(v, _)| *v == variant) {
            return;
        }
        let sums = &self.passes.shown_layout;
        let passes = if variant.cached {
            PlanePasses::Surfaces(SurfacePasses::new(device, [frame, sums], variant))
        } else {
            let passes = ShadowBufferPass::by_planes(device, frame, sums, variant);
            PlanePasses::Pixels(passes)
        };
        self.passes_for = Some((variant, passes));
    }

    /// Chooses the planes that serve `pages`, unless that is done.
    pub(super) fn serve(&mut self, gpu: &Gpu, pages: &Arc<AtlasPages>) {
        let Some((_, PlanePasses::Surfaces(passes))) = &self.passes_for else {
            return;
        };
        if self.served.as_ref().is_some_and(|s| s.is_of(pages)) {
            return;
        }
        let (all, real) = self.synthesis.planes();
        let planes = Planes {
            all: &all,
            real,
            depths: &self.depths,
            side: self.side,
        };
        self.served = Some(ServedSurfaces::new(gpu, passes, &planes, pages.clone()));
        self.written_for = None;
    }

    /// Bounds of the pages of real surfaces in the surface cache that planes serve.
    pub(crate) fn served_bounds(&self) -> &[Bounds] {
        self.served.as_ref().map_or(&[], ServedSurfaces::bounds)
    }

    /// Takes over the passes of another stage, unless this one has some: they are the same for all
    /// bakes.
    pub(crate) fn take_pipelines(&mut self, before: Self) {
        self.passes_for = self.passes_for.take().or(before.passes_for);
    }

    /// Moves the planes with a model that was moved as a whole since it was baked.
    pub(crate) fn place(&mut self, world_from_bake: RigidTransform) {
        self.world_from_bake = world_from_bake;
        self.synthesis.place(&self.planes, world_from_bake);
        self.lights_made_for = None;
        self.served = None;
        if let Some(sources) = &mut self.sources {
            sources.set_rotation(world_from_bake.rotation.inverse().as_quat());
        }
    }

    /// The work of the last frame; `None` if its shadows did not come from planes. Waits for the
    /// device.
    pub(crate) fn work(&self, gpu: &Gpu) -> Result<Option<PlaneWork>, GpuError> {
        if !self.is_active {
            return Ok(None);
        }
        let sources = self.sources.as_ref().map(|s| s.work).unwrap_or_default();
        Ok(Some(PlaneWork {
            sources: sources.sources + self.left_sources,
            source_images: sources.images,
            ..self.synthesis.work(gpu)?
        }))
    }

    /// Uploads the light and the visible planes of this frame, whose passes are those of `variant`;
    /// `frame` is the layout of its data and `cache` the scene's surface cache. Returns false if the
    /// frame does not use planes or has no light.
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
        self.is_active = false;
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
        let Gpu { device, queue, .. } = gpu;
        let leaves = self.leaves_sources(input);
        self.left_sources = if leaves { faces.sources.len() } else { 0 };
        self.luminance.leave_sources_out(leaves);
        let uploaded = self
            .luminance
            .upload(device, queue, faces, lighting.generation);
        uploaded.map_err(|error| GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason: error.to_string(),
        })?;
        if let Some(sources) = &mut self.sources {
            sources.prepare(queue, faces, self.waits_for_sources);
        }
        self.compile(device, frame, variant);
        if let Some(cache) = cache {
            self.serve(gpu, cache.pages().0);
        }
        // Light on surfaces is kept for any viewer.
        self.viewer = (camera(pose.inverse().to_matrix()), pose.translation);
        let view = cache.is_none().then_some(self.viewer);
        self.synthesis.prepare(queue, view, choice.thresholds);
        let indirect = input.indirect_light.map_or(0, |light| light.generation);
        self.light_now = Some((lighting.generation, indirect, choice.shading));
        self.is_active = true;
        Ok(true)
    }

    /// Sums basis images under the light of this frame, and writes it into the surface `cache`, if
    /// there is one; `uncached` is the group of the frame without the cache. Returns what pixels
    /// look up; `None` where they look up the cache or the frame does not use planes.
    pub(crate) fn record(
        &mut self,
        r: &mut Recorder<'_>,
        (queue, uncached): (&wgpu::Queue, &wgpu::BindGroup),
        cache: Option<&CachedLight>,
    ) -> Option<ShadowSource<'_>> {
        if !self.is_active {
            self.written_for = None;
            return None;
        }
        let changed = self.luminance.record(r.device, r.encoder, r.timer);
        let faces = self.luminance.buffer();
        let lights = match &mut self.sources {
            Some(sources) => sources.record(r.device, r.encoder, faces, changed),
            None => (faces, changed),
        };
        let changed = lights.1;
        self.synthesis
            .record(r.device, r.encoder, r.timer, &self.passes, lights);
        let sums = self.synthesis.group();
        match &self.passes_for.as_ref()?.1 {
            PlanePasses::Pixels(passes) => return Some(ShadowSource::Planes(passes, sums)),
            PlanePasses::Surfaces(passes) => {
                let (Some(served), Some(cache)) = (&mut self.served, cache) else {
                    return None;
                };
                let (_, atlas, uploads) = cache.pages();
                let (light, indirect, shading) = self.light_now?;
                let now = Some((light, indirect, uploads, shading));
                if changed || std::mem::replace(&mut self.written_for, now) != now {
                    served.expire();
                }
                served.prepare(queue, &self.viewer, indirect);
                served.record(r, passes, [uncached, sums], atlas);
            }
        }
        None
    }

    /// Returns the lights that shade virtual objects: `lights` of the environment, or those of
    /// faces.
    pub(crate) fn shade<'a>(
        &'a mut self,
        input: &FrameInput<'_>,
        uniform: &mut FrameUniform,
        lights: &'a [DomeLight],
    ) -> &'a [DomeLight] {
        let (low, high) = self.synthesis.bounds();
        uniform.planes_low = low.as_vec3().extend(1.0).to_array();
        uniform.planes_high = high.as_vec3().extend(0.0).to_array();
        let shading = input.planes.map_or(PlaneShading::Irradiance, |p| p.shading);
        uniform.counts[2] = u32::from(self.leaves_sources(input));
        let faces = input.lighting.and_then(|l| Some((l, l.faces.as_ref()?)));
        let (Some((lighting, faces)), false) = (faces, shading == PlaneShading::Irradiance) else {
            return lights;
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
        &self.lights
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
    }
}
