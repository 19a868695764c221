//! Shadowing planes as a technique of the compositor.

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

/// Everything that the technique keeps: a bake on the device and what works on it.
pub struct PlanesStage {
    passes: SynthesisPasses,
    luminance: LuminancePass,
    synthesis: Synthesis,
    sources: Option<SourceStage>,
    dome: GeodesicDome,
    show: Option<MarkedPasses>,
    shown: bool,
    /// As they were baked.
    planes: Vec<ShadowingPlane>,
    world_from_bake: RigidTransform,
    /// Lights of faces, for shading, and of which light and shading they are.
    lights: Vec<DomeLight>,
    lights_of: Option<(u64, PlaneShading)>,
}

impl PlanesStage {
    /// Uploads a bake and compiles what sums it; for `sources` see
    /// [`crate::Compositor::set_bake_with_sources`]. May run on any thread.
    ///
    /// # Errors
    /// A bake of a dome that cannot be; more images than the device can hold.
    pub fn new(gpu: &Gpu, bake: &Bake, sources: Option<SourceBaker>) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let dome = GeodesicDome::new(bake.settings.frequency).ok_or_else(|| GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason: format!("a geodesic dome of frequency {}", bake.settings.frequency),
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
            show: None,
            shown: false,
            planes: bake.planes.clone(),
            world_from_bake: RigidTransform::IDENTITY,
            lights: Vec::new(),
            lights_of: None,
        })
    }

    /// Discards the passes that show planes: the shaders have to be compiled again.
    pub(crate) fn forget_pipelines(&mut self) {
        self.show = None;
    }

    /// Takes over the passes that show planes: they are the same for all bakes.
    pub(crate) fn take_pipelines(&mut self, before: Self) {
        self.show = before.show;
    }

    /// Moves the planes with a model that was moved as a whole since it was baked.
    pub(crate) fn place(&mut self, world_from_bake: RigidTransform) {
        self.world_from_bake = world_from_bake;
        self.synthesis.place(&self.planes, world_from_bake);
        self.lights_of = None;
        if let Some(sources) = &mut self.sources {
            sources.turn(world_from_bake.rotation.inverse().as_quat());
        }
    }

    /// The work of the last frame; `None` if its shadows did not come from planes. Waits for the
    /// device.
    pub(crate) fn work(&self, gpu: &Gpu) -> Result<Option<PlaneWork>, GpuError> {
        if !self.shown {
            return Ok(None);
        }
        let sources = self.sources.as_ref().map(|s| s.work).unwrap_or_default();
        Ok(Some(PlaneWork {
            sources: sources.sources,
            source_images: sources.images,
            ..self.synthesis.work(gpu)?
        }))
    }

    /// Uploads what planes need in this frame; `passes` compiles the passes that show planes from
    /// the layout of the sums. Returns false where planes are not the technique, or where they
    /// have no light.
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
        self.shown = false;
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
        self.show.get_or_insert_with(|| passes(layout));
        let clip_from_world = camera(pose.inverse().to_matrix());
        self.synthesis
            .prepare(queue, clip_from_world, pose.translation, choice.thresholds);
        self.shown = true;
        Ok(true)
    }

    /// Sums basis images under the light of this frame; `None` where the frame does not use
    /// planes.
    pub(crate) fn record(&mut self, r: &mut Recorder<'_>) -> Option<ShadowSource<'_>> {
        if !self.shown {
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
            self.show.as_ref()?,
            self.synthesis.group(),
        ))
    }

    /// The lights that shade virtual objects: those of the environment, or of faces.
    pub(crate) fn shade<'a>(
        &'a mut self,
        input: &FrameInput<'_>,
        uniform: &mut FrameUniform,
        lights: &'a [DomeLight],
    ) -> &'a [DomeLight] {
        let (low, high) = self.synthesis.reach();
        uniform.planes_low = low.as_vec3().extend(1.0).to_array();
        uniform.planes_high = high.as_vec3().extend(0.0).to_array();
        let shading = input.planes.map_or(PlaneShading::Irradiance, |p| p.shading);
        let faces = input.lighting.and_then(|l| Some((l, l.faces.as_ref()?)));
        let (Some((lighting, faces)), false) = (faces, shading == PlaneShading::Irradiance) else {
            return lights;
        };
        if self.lights_of != Some((lighting.generation, shading)) {
            self.light_faces(&sum_faces(faces), shading == PlaneShading::Six);
            self.lights_of = Some((lighting.generation, shading));
        }
        // Only the ground is left of what no light stands for: π/2 · L · (1 − n.z).
        let ground = Vec3::from_slice(&uniform.ground[..3]) * std::f32::consts::FRAC_PI_2;
        uniform.harmonics = [[0.0; 4]; 9];
        if uniform.params[2] > 0.0 {
            uniform.harmonics[0] = ground.extend(0.0).to_array();
            uniform.harmonics[2] = (-ground).extend(0.0).to_array();
        }
        &self.lights
    }

    /// One light per face, or the papers' six.
    fn light_faces(&mut self, sums: &[Vec3], six: bool) {
        self.lights.clear();
        let turn = self.world_from_bake.rotation.as_quat();
        if six {
            let six = self.dome.six_groups();
            let each = six.directions.iter().zip(six.sums(sums));
            self.lights
                .extend(each.map(|(d, s)| light_of(turn * *d, s)));
        } else {
            let each = self.dome.faces.iter().zip(sums);
            self.lights
                .extend(each.map(|(f, s)| light_of(turn * f.centre, *s)));
        }
    }
}

fn light_of(direction: Vec3, irradiance: Vec3) -> DomeLight {
    DomeLight {
        direction,
        irradiance,
        angular_radius: 0.0,
        kind: LightKind::Compact,
    }
}
