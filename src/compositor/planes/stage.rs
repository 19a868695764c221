//! Shadowing planes as a step of the frame: uploads the light, sums basis images, and provides the
//! shadows and the lights of the frame.

use super::super::frame_input::FrameInput;
use super::super::gpu::{Gpu, GpuError};
use super::super::gpu_data::FrameUniform;
use super::super::passes::shadow_buffer::{MarkedPasses, ShadowSource};
use super::super::recorder::Recorder;
use super::luminance::LuminancePass;
use super::source_images::SourceBaker;
use super::source_stage::SourceStage;
use super::synthesis::{PlaneWork, Synthesis, SynthesisPasses};
use glam::{DMat4, Vec3};
use penumbra_interface::RigidTransform;
use penumbra_lighting::geodesic::{GeodesicDome, sum_faces};
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_scene::PlaneShading;
use penumbra_scene::planes::{Bake, ShadowingPlane};

/// Owns a bake on the device and the passes that sum it.
pub struct PlanesStage {
    passes: SynthesisPasses,
    luminance: LuminancePass,
    synthesis: Synthesis,
    sources: Option<SourceStage>,
    dome: GeodesicDome,
    /// The passes that draw the shadows of the planes.
    shadow_passes: Option<MarkedPasses>,
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
            shadow_passes: None,
            is_active: false,
            planes: bake.planes.clone(),
            world_from_bake: RigidTransform::IDENTITY,
            lights: Vec::new(),
            lights_made_for: None,
        })
    }

    /// Discards the shadow passes: the shaders have to be compiled again.
    pub(crate) fn forget_pipelines(&mut self) {
        self.shadow_passes = None;
    }

    /// Takes over the shadow passes of another stage: they are the same for all bakes.
    pub(crate) fn take_pipelines(&mut self, before: Self) {
        self.shadow_passes = before.shadow_passes;
    }

    /// Moves the planes with a model that was moved as a whole since it was baked.
    pub(crate) fn place(&mut self, world_from_bake: RigidTransform) {
        self.world_from_bake = world_from_bake;
        self.synthesis.place(&self.planes, world_from_bake);
        self.lights_made_for = None;
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
            sources: sources.sources,
            source_images: sources.images,
            ..self.synthesis.work(gpu)?
        }))
    }

    /// Uploads the light and the visible planes of this frame; `passes` compiles the shadow passes
    /// from the layout of the sums. Returns false if the frame does not use planes or has no light.
    ///
    /// # Errors
    /// The light has more pixels than the device can read.
    pub(crate) fn prepare(
        &mut self,
        gpu: &Gpu,
        input: &FrameInput<'_>,
        camera: impl Fn(DMat4) -> DMat4,
        augmented: bool,
        passes: impl FnOnce(&wgpu::BindGroupLayout) -> MarkedPasses,
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
        let uploaded = self
            .luminance
            .upload(device, queue, faces, lighting.generation);
        uploaded.map_err(|error| GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason: error.to_string(),
        })?;
        if let Some(sources) = &mut self.sources {
            sources.prepare(queue, faces);
        }
        let layout = &self.passes.shown_layout;
        self.shadow_passes.get_or_insert_with(|| passes(layout));
        let clip_from_world = camera(pose.inverse().to_matrix());
        self.synthesis
            .prepare(queue, clip_from_world, pose.translation, choice.thresholds);
        self.is_active = true;
        Ok(true)
    }

    /// Sums basis images under the light of this frame; `None` where the frame does not use
    /// planes.
    pub(crate) fn record(&mut self, r: &mut Recorder<'_>) -> Option<ShadowSource<'_>> {
        if !self.is_active {
            return None;
        }
        let changed = self.luminance.record(r.device, r.encoder, r.timer);
        let faces = self.luminance.buffer();
        let lights = match &mut self.sources {
            Some(sources) => sources.record(r.device, r.encoder, faces, changed),
            None => (faces, changed),
        };
        self.synthesis
            .record(r.device, r.encoder, r.timer, &self.passes, lights);
        Some(ShadowSource::Planes(
            self.shadow_passes.as_ref()?,
            self.synthesis.group(),
        ))
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
