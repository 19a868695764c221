//! The exposure as a step of the frame: chooses it, compiles and records its passes.

use super::super::compiled::Device;
use super::super::frame_input::FrameInput;
use super::super::gpu::Gpu;
use super::super::passes::composite::CompositePass;
use super::super::passes::exposure::{ExposedPictures, ExposurePass};
use super::super::passes::shadow_buffer::SurfaceLight;
use super::super::passes::surroundings::SurroundingsPass;
use super::super::recorder::Recorder;
use super::super::response_table::{RealPicture, ResponseTable};
use super::super::shaders::Variant;
use super::super::textures::FrameTexture;
use super::choice::{ActiveExposure, Exposure, MAX_STOPS};
use super::control::{AutoLimits, Follower};
use super::meter::Meter;
use super::region::Region;
use penumbra_camera::Response;
use penumbra_interface::threads;
use penumbra_scene::Highlights;
use std::thread::JoinHandle;

/// The passes of exposures other than the camera's. While only the camera's own is requested, it
/// holds nothing and records nothing.
#[derive(Default)]
pub struct ExposureStage {
    active: ActiveExposure,
    follower: Option<Follower>,
    meter: Option<Meter>,
    /// Whether the next frame is measured.
    is_metering: bool,
    passes: Option<Box<ExposedPasses>>,
    /// The thread that compiles them, and for which variant.
    compiling: Option<(JoinHandle<ExposedPasses>, Variant)>,
    highlights: Highlights,
}

/// The passes that draw pictures in another exposure.
pub struct ExposedPasses {
    exposure: ExposurePass,
    surroundings: SurroundingsPass,
    composite: CompositePass,
}

impl ExposedPasses {
    /// Compiles them; `frame` is the layout that passes share.
    pub fn new(device: &Device, frame: &wgpu::BindGroupLayout, variant: Variant) -> Self {
        let variant = Variant {
            exposed: true,
            ..variant
        };
        Self {
            exposure: ExposurePass::new(device),
            surroundings: SurroundingsPass::new(device, frame, variant),
            composite: CompositePass::new(device, frame, variant),
        }
    }
}

/// How shadows and virtual lights change the picture that the meter measures.
#[derive(Clone, Copy)]
pub struct MeteredFrame {
    /// Whether shadows are subtracted instead of multiplied.
    pub subtract: bool,
    /// Whether the light of virtual lights is kept in a texture apart from the shadow buffer.
    pub lamps_apart: bool,
}

impl ExposureStage {
    /// The active exposure.
    pub const fn active(&self) -> ActiveExposure {
        self.active
    }

    /// Factor of the active exposure on linear light.
    pub fn factor(&self) -> f32 {
        self.active.stops.exp2()
    }

    /// Whether the active exposure differs from the camera's own.
    pub const fn is_changed(&self) -> bool {
        self.active.stops != 0.0
    }

    /// Whether there are passes that need [`ExposedPictures`].
    pub const fn has_passes(&self) -> bool {
        self.passes.is_some()
    }

    /// Discards the pipelines: the shaders have to be compiled again.
    pub fn forget_pipelines(&mut self) {
        self.passes = None;
    }

    /// Chooses the exposure of the next frame. `has_virtual`: virtual objects or lights are in it.
    pub fn choose(&mut self, gpu: &Gpu, input: &FrameInput<'_>, has_virtual: bool) {
        self.is_metering = false;
        self.highlights = input.highlights;
        match input.exposure {
            // Without virtual objects the picture is the camera's.
            _ if !input.show_virtual => self.set_fixed(0.0),
            Exposure::Camera => self.set_fixed(0.0),
            Exposure::Stops(stops) => self.set_fixed(clamp_stops(stops)),
            Exposure::Automatic { limits, seconds } => {
                self.follow(gpu, &limits, seconds);
                let lit = !input.lamps.is_empty() || limits.brightest > 0.0;
                self.is_metering = has_virtual && lit;
            }
        }
    }

    /// Sets an exposure of `stops`, and removes the meter.
    fn set_fixed(&mut self, stops: f32) {
        self.follower = None;
        self.meter = None;
        self.active = ActiveExposure {
            stops,
            target: stops,
            brightness: None,
        };
    }

    /// Follows the measured light within `limits`.
    fn follow(&mut self, gpu: &Gpu, limits: &AutoLimits, seconds: f64) {
        let meter = self.meter.get_or_insert_with(|| Meter::new(&gpu.device));
        let brightness = meter.begin(gpu);
        let target = clamp_stops(brightness.map_or(0.0, |b| b.target_stops(limits)));
        let from = self.active.stops;
        let follower = self.follower.get_or_insert_with(|| Follower::from(from));
        let stops = follower.follow(target, seconds, limits.adaptation_seconds);
        self.active = ActiveExposure {
            stops,
            target,
            brightness,
        };
    }

    /// Compiles the passes if they are needed now or, for an automatic exposure, soon: compiling
    /// takes longer than a frame. `in_background`, on a thread: until it has ended, the picture stays
    /// in the camera's own exposure.
    pub fn compile(
        &mut self,
        device: &Device,
        frame: &wgpu::BindGroupLayout,
        variant: Variant,
        in_background: bool,
    ) {
        let needed = self.is_changed() || self.follower.is_some();
        if !needed || self.passes.is_some() {
            return;
        }
        self.compiling
            .take_if(|(thread, of)| *of != variant && thread.is_finished());
        if in_background && self.compiling.is_none() {
            let (device, frame) = (device.clone(), frame.clone());
            let compile = move || ExposedPasses::new(&device, &frame, variant);
            let thread = threads::spawn("exposure", compile);
            self.compiling = thread.ok().map(|thread| (thread, variant));
        }
        if self.compiling.as_ref().is_some_and(|c| !c.0.is_finished()) {
            self.active.stops = 0.0;
            return;
        }
        let compiled = self
            .compiling
            .take()
            .and_then(|(thread, _)| thread.join().ok());
        let compiled = compiled.unwrap_or_else(|| ExposedPasses::new(device, frame, variant));
        self.passes = Some(Box::new(compiled));
    }

    /// Uploads the uniforms of the next frame, whose picture is `height` pixels high.
    pub fn upload(
        &self,
        queue: &wgpu::Queue,
        height: u32,
        response: &Response,
        metered: MeteredFrame,
    ) {
        if let Some(passes) = self.passes.as_ref().filter(|_| self.is_changed()) {
            let factor = self.factor();
            let region = Region::for_factor(factor, height);
            let change = (factor, self.highlights);
            passes.exposure.upload(queue, change, region, response);
        }
        if let Some(meter) = self.meter.as_ref().filter(|_| self.is_metering) {
            let MeteredFrame {
                subtract,
                lamps_apart,
            } = metered;
            meter.upload(queue, subtract, lamps_apart);
        }
    }

    /// Draws the camera picture in the exposure of the frame into `exposed` and into `output`, if
    /// that is not the camera's own.
    pub fn record<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        (camera, codes): (&'a FrameTexture, &'a ResponseTable),
        exposed: Option<&'a ExposedPictures>,
        output: &FrameTexture,
    ) -> RealPicture<'a> {
        let changed = self.is_changed();
        let highlights = (self.active.stops < 0.0).then_some(self.highlights);
        let passes = self.passes.as_mut().filter(|_| changed);
        let exposed = passes.zip(exposed).map(|(passes, exposed)| {
            let exposure = &mut passes.exposure;
            exposure.record(r, (camera, codes), highlights, exposed, output)
        });
        RealPicture {
            camera,
            exposed,
            codes,
        }
    }

    /// The passes that read the real picture, if it is in another exposure.
    pub fn passes(&mut self) -> Option<(&mut SurroundingsPass, &mut CompositePass)> {
        let changed = self.is_changed();
        let passes = self.passes.as_mut().filter(|_| changed)?;
        Some((&mut passes.surroundings, &mut passes.composite))
    }

    /// Measures the light that virtual lights add, for the exposure of later frames.
    pub fn record_meter(
        &mut self,
        r: &mut Recorder<'_>,
        real: RealPicture<'_>,
        light: SurfaceLight<'_>,
    ) {
        if let (true, Some(meter)) = (self.is_metering, &mut self.meter) {
            meter.record(r, real, light);
        }
    }

    /// Starts reading the measurement of a submitted frame.
    pub fn submitted(&mut self, index: &wgpu::SubmissionIndex) {
        if let Some(meter) = &mut self.meter {
            meter.submitted(index);
        }
    }
}

impl Drop for ExposureStage {
    fn drop(&mut self) {
        if let Some((thread, _)) = self.compiling.take() {
            let _ = thread.join();
        }
    }
}

/// Limits `stops` to the supported range; 0 for NaN.
const fn clamp_stops(stops: f32) -> f32 {
    if stops.is_nan() {
        return 0.0;
    }
    stops.clamp(-MAX_STOPS, MAX_STOPS)
}
