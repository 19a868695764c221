//! Shadowing planes on the device: luminances, sums, images of compact sources, and look-ups for
//! each pixel.

use super::super::compiled::Device;
use super::super::gpu::{Gpu, GpuError};
use super::super::passes::shadow_buffer::{MarkedPasses, ShadowBufferPass, ShadowSource};
use super::super::recorder::Recorder;
use super::super::shaders::Variant;
use super::luminance::LuminancePass;
use super::options::Thresholds;
use super::source_images::SourceBaker;
use super::source_stage::SourceStage;
use super::synthesis::{PlaneWork, Synthesis, SynthesisPasses};
use super::visible_pages::Viewer;
use penumbra_lighting::geodesic::FaceLight;
use penumbra_scene::planes::Bake;

/// A bake on the device and the passes that sum it and apply it to pixels.
pub(super) struct PixelPlanes {
    passes: SynthesisPasses,
    luminance: LuminancePass,
    pub synthesis: Synthesis,
    pub sources: Option<SourceStage>,
    /// The passes that apply the planes, and the variant for which they are compiled.
    shown: Option<(Variant, MarkedPasses)>,
}

impl PixelPlanes {
    /// Uploads a bake and compiles the passes that sum it.
    ///
    /// # Errors
    /// The device cannot hold that many images.
    pub fn new(gpu: &Gpu, bake: &Bake, sources: Option<SourceBaker>) -> Result<Self, GpuError> {
        let device = &gpu.device;
        let passes = SynthesisPasses::new(device);
        let synthesis = Synthesis::new(gpu, &passes, bake, sources.is_some())?;
        let targets = synthesis.source_targets();
        let sources = sources.map(|baker| SourceStage::new(device, baker, &targets));
        Ok(Self {
            sources,
            synthesis,
            luminance: LuminancePass::for_adapter(gpu),
            passes,
            shown: None,
        })
    }

    /// Compiles the passes that apply planes, unless they are there; `frame` is the layout of a
    /// frame's data.
    pub fn compile(&mut self, device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) {
        if self.shown.as_ref().is_none_or(|(v, _)| *v != variant) {
            let sums = &self.passes.shown_layout;
            let passes = ShadowBufferPass::by_planes(device, frame, sums, variant);
            self.shown = Some((variant, passes));
        }
    }

    /// Takes over the passes that apply planes, unless there are some: they are the same for all
    /// bakes.
    pub fn take_pipelines(&mut self, before: Self) {
        self.shown = self.shown.take().or(before.shown);
    }

    /// Uploads the light and the planes that the viewer sees; `waits`: images of compact sources
    /// are rendered at once.
    ///
    /// # Errors
    /// The light has more pixels than the device can read.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        (faces, generation): (&FaceLight, u64),
        viewer: Viewer,
        thresholds: Thresholds,
        waits: bool,
    ) -> Result<(), GpuError> {
        let Gpu { device, queue, .. } = gpu;
        let uploaded = self.luminance.upload(device, queue, faces, generation);
        uploaded.map_err(|error| GpuError::Unfit {
            adapter: gpu.name.clone(),
            reason: error.to_string(),
        })?;
        if let Some(sources) = &mut self.sources {
            sources.prepare(queue, faces, waits);
        }
        self.synthesis.prepare(queue, viewer, thresholds);
        Ok(())
    }

    /// Sums basis images; returns what pixels look up.
    pub fn record(&mut self, r: &mut Recorder<'_>) -> Option<ShadowSource<'_>> {
        let changed = self.luminance.record(r.device, r.encoder, r.timer);
        let faces = self.luminance.buffer();
        let lights = match &mut self.sources {
            Some(sources) => sources.record(r.device, r.encoder, faces, changed),
            None => (faces, changed),
        };
        self.synthesis
            .record(r.device, r.encoder, r.timer, &self.passes, lights);
        let (_, passes) = self.shown.as_ref()?;
        Some(ShadowSource::Planes(passes, self.synthesis.group()))
    }

    /// The work of the last frame; waits for the device.
    ///
    /// # Errors
    /// The device failed.
    pub fn work(&self, gpu: &Gpu) -> Result<PlaneWork, GpuError> {
        let sources = self.sources.as_ref().map(|s| s.work).unwrap_or_default();
        Ok(PlaneWork {
            sources: sources.sources,
            source_images: sources.images,
            ..self.synthesis.work(gpu)?
        })
    }
}
