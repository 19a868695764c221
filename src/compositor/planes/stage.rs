//! Shadowing planes as a technique of the compositor.

use super::super::frame::{FrameInput, clip_from_camera};
use super::super::gpu_data::FrameUniform;
use super::super::passes::shadow_buffer::MarkedPasses;
use super::super::timing::Timer;
use super::super::{Compositor, Gpu, GpuError};
use super::luminance::LuminancePass;
use super::source_images::SourceBaker;
use super::source_stage::SourceStage;
use super::synthesis::{PlaneWork, Synthesis, SynthesisPasses, Thresholds};
use glam::Vec3;
use penumbra_interface::RigidTransform;
use penumbra_lighting::geodesic::{GeodesicDome, sum_faces};
use penumbra_lighting::{DomeLight, LightKind};
use penumbra_scene::PlaneShading;
use penumbra_scene::planes::{Bake, ShadowingPlane};

/// How planes are used in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanesChoice {
    /// When sums are made anew.
    pub thresholds: Thresholds,
    /// What virtual objects are shaded by.
    pub shading: PlaneShading,
}

/// Everything that the technique keeps: a bake on the device and what works on it.
pub struct PlanesStage {
    passes: SynthesisPasses,
    luminance: LuminancePass,
    synthesis: Synthesis,
    sources: Option<SourceStage>,
    dome: GeodesicDome,
    show: Option<MarkedPasses>,
    shown: bool,
    device: wgpu::Device,
    /// As they were baked.
    planes: Vec<ShadowingPlane>,
    world_from_bake: RigidTransform,
    /// Lights of faces, for shading, and of which light and shading they are.
    lights: Vec<DomeLight>,
    lights_of: Option<(u64, PlaneShading)>,
}

impl Compositor {
    /// Puts a bake in force, or takes it away. It must be one of the scene that is shown.
    ///
    /// # Errors
    /// A bake of a dome that cannot be; more images than the device can hold.
    pub fn set_bake(&mut self, bake: Option<&Bake>) -> Result<(), GpuError> {
        self.set_bake_with_sources(bake, None)
    }

    /// The same; with `sources`, made of this bake, the brightest compact sources of light get
    /// images of their own, drawn from their true directions, instead of those of the faces in
    /// which they lie.
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
            self.show_planes(Box::new(PlanesStage::new(&self.gpu, bake, sources)?));
        }
        Ok(())
    }

    /// Puts in force what [`PlanesStage::new`] made of a bake, on whichever thread.
    pub fn show_planes(&mut self, mut stage: Box<PlanesStage>) {
        let before = self.planes.take();
        // What shows planes is the same for all bakes.
        stage.show = before.and_then(|before| before.show);
        self.planes = Some(stage);
    }

    /// Carries the planes along with a model that was moved as a whole since it was baked; light
    /// has to come from a dome that the caller turns with it.
    pub fn move_planes(&mut self, world_from_bake: RigidTransform) {
        if let Some(stage) = &mut self.planes {
            stage.world_from_bake = world_from_bake;
            stage.synthesis.place(&stage.planes, world_from_bake);
            stage.lights_of = None;
            if let Some(sources) = &mut stage.sources {
                sources.turn(world_from_bake.rotation.inverse().as_quat());
            }
        }
    }

    /// What planes had to do in the last frame; `None` while they are not the technique. Waits
    /// for the device.
    ///
    /// # Errors
    /// The device failed.
    pub fn plane_work(&self) -> Result<Option<PlaneWork>, GpuError> {
        let stage = self.planes.as_deref().filter(|stage| stage.shown);
        let work = |stage: &PlanesStage| {
            let sources = stage.sources.as_ref().map(|s| s.work).unwrap_or_default();
            Ok(PlaneWork {
                sources: sources.sources,
                source_images: sources.images,
                ..stage.synthesis.work(&self.gpu)?
            })
        };
        stage.map(work).transpose()
    }

    /// Uploads what planes need in this frame. False where they are not the technique, or
    /// where there is no light for them.
    ///
    /// # Errors
    /// More pixels of light than the device can read.
    pub(in super::super) fn prepare_planes(
        &mut self,
        input: &FrameInput<'_>,
        augmented: bool,
    ) -> Result<bool, GpuError> {
        let Some(stage) = &mut self.planes else {
            return Ok(false);
        };
        stage.shown = false;
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
        let Gpu { device, queue, .. } = &self.gpu;
        let uploaded = stage
            .luminance
            .upload(device, queue, faces, lighting.generation);
        uploaded.map_err(|error| GpuError::Unfit {
            adapter: self.gpu.name.clone(),
            reason: error.to_string(),
        })?;
        if let Some(sources) = &mut stage.sources {
            sources.prepare(queue, faces);
        }
        let frame = &self.light_maps.frame_layout;
        let (shadows, shown) = (&self.pipelines.shadow_buffer, &stage.passes.shown_layout);
        stage
            .show
            .get_or_insert_with(|| shadows.of_planes(device, frame, shown, self.variant));
        let clip_from_world = clip_from_camera(input.camera) * pose.inverse().to_matrix();
        stage
            .synthesis
            .prepare(queue, clip_from_world, pose.translation, choice.thresholds);
        stage.shown = true;
        Ok(true)
    }
}

impl PlanesStage {
    /// Uploads a bake and compiles what sums it; for `sources` see
    /// [`Compositor::set_bake_with_sources`].
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
            device: device.clone(),
            planes: bake.planes.clone(),
            world_from_bake: RigidTransform::IDENTITY,
            lights: Vec::new(),
            lights_of: None,
        })
    }

    /// Whether this frame's shadows come from planes.
    pub(in super::super) fn is_shown(&self) -> bool {
        self.shown
    }

    /// The shaders are to be compiled anew.
    pub(in super::super) fn forget_pipelines(&mut self) {
        self.show = None;
    }

    /// Sums; the passes that show the sums, and what they bind.
    pub(in super::super) fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
    ) -> Option<(&MarkedPasses, &wgpu::BindGroup)> {
        let changed = self.luminance.record(&self.device, encoder, timer);
        let faces = self.luminance.buffer();
        let lights = match &mut self.sources {
            Some(sources) => sources.record(&self.device, encoder, faces, changed),
            None => (faces, changed),
        };
        self.synthesis
            .record(&self.device, encoder, timer, &self.passes, lights);
        Some((self.show.as_ref()?, self.synthesis.group()))
    }

    /// The lights that shade virtual objects: those of the environment, or of faces.
    pub(in super::super) fn shade<'a>(
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
