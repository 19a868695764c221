//! The exposure's place in the frame: what is compiled, bound and recorded when.

use super::super::frame::FrameInput;
use super::super::gloss_maps::GlossMaps;
use super::super::passes::composite::{CompositeInputs, CompositePass};
use super::super::passes::exposure::{ExposureInputs, ExposurePass};
use super::super::passes::surroundings::{SurroundingsInputs, SurroundingsPass};
use super::super::shaders::Variant;
use super::super::targets::Targets;
use super::super::timing::Timer;
use super::super::{Compositor, Gpu};
use super::control::Follower;
use super::meter::Meter;
use super::{AutoLimits, Exposure, ExposureInForce, MOST_STOPS, Region};
use penumbra_scene::Highlights;

/// Everything about exposures. While they are the camera's own it holds nothing and records
/// nothing.
#[derive(Default)]
pub struct ExposureStation {
    in_force: ExposureInForce,
    follower: Option<Follower>,
    meter: Option<Meter>,
    /// The picture that is made next is measured.
    measures: bool,
    passes: Option<Box<ExposedPasses>>,
    highlights: Highlights,
}

/// What draws pictures in another exposure.
struct ExposedPasses {
    exposure: ExposurePass,
    surroundings: SurroundingsPass,
    composite: CompositePass,
}

/// What that binds for pictures of one size.
pub struct ExposedInputs {
    exposure: ExposureInputs,
    pub surroundings: SurroundingsInputs,
    pub composite: CompositeInputs,
}

impl ExposureStation {
    /// Factor on linear light.
    pub fn factor(&self) -> f32 {
        self.in_force.stops.exp2()
    }

    const fn changes(&self) -> bool {
        self.in_force.stops != 0.0
    }

    /// The shaders are to be compiled anew.
    pub fn forget_pipelines(&mut self) {
        self.passes = None;
    }

    /// The passes that read the picture, if it is in another exposure.
    pub fn passes(&self) -> Option<(&SurroundingsPass, &CompositePass)> {
        let passes = self.passes.as_ref().filter(|_| self.changes())?;
        Some((&passes.surroundings, &passes.composite))
    }

    pub fn bind(
        &self,
        device: &wgpu::Device,
        targets: &Targets,
        gloss: &GlossMaps,
    ) -> Option<ExposedInputs> {
        let passes = self.passes.as_ref()?;
        let exposure = passes.exposure.bind(device, targets);
        let picture = &exposure.linear.view;
        let bound = passes.composite.bind(device, targets, picture, gloss);
        Some(ExposedInputs {
            surroundings: passes.surroundings.bind(device, targets, picture),
            composite: bound,
            exposure,
        })
    }

    pub fn bind_meter(&self, device: &wgpu::Device, targets: &Targets) -> Option<wgpu::BindGroup> {
        Some(self.meter.as_ref()?.bind(device, targets))
    }

    /// Which exposure comes next. `seen`: virtual things are in the picture.
    fn choose(&mut self, gpu: &Gpu, input: &FrameInput<'_>, seen: bool) {
        self.measures = false;
        self.highlights = input.highlights;
        match input.exposure {
            // Without anything virtual the picture is the camera's.
            _ if !input.show_virtual => self.fix(0.0),
            Exposure::Camera => self.fix(0.0),
            Exposure::Stops(stops) => self.fix(sound(stops)),
            Exposure::Automatic { limits, seconds } => {
                self.follow(gpu, &limits, seconds);
                let lit = !input.lamps.is_empty() || limits.brightest > 0.0;
                self.measures = seen && lit;
            }
        }
    }

    fn fix(&mut self, stops: f32) {
        self.follower = None;
        self.meter = None;
        self.in_force = ExposureInForce {
            stops,
            wanted: stops,
            brightness: None,
        };
    }

    fn follow(&mut self, gpu: &Gpu, limits: &AutoLimits, seconds: f64) {
        let meter = self.meter.get_or_insert_with(|| Meter::new(&gpu.device));
        let brightness = meter.begin(gpu);
        let wanted = sound(brightness.map_or(0.0, |b| b.wanted(limits)));
        let from = self.in_force.stops;
        let follower = self.follower.get_or_insert_with(|| Follower::from(from));
        let stops = follower.follow(wanted, seconds, limits.adaptation_seconds);
        self.in_force = ExposureInForce {
            stops,
            wanted,
            brightness,
        };
    }

    /// The picture as it is shown, before anything reads it.
    pub fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        inputs: &ExposedInputs,
        targets: &Targets,
    ) {
        if let Some(passes) = &self.passes {
            let darker = self.in_force.stops < 0.0;
            let highlights = darker.then_some(self.highlights);
            passes
                .exposure
                .record(encoder, timer, &inputs.exposure, targets, highlights);
        }
    }

    /// Measures what virtual lights add, where that is wanted.
    pub fn record_meter(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        picture: Option<&wgpu::BindGroup>,
    ) {
        if let (true, Some(meter), Some(picture)) = (self.measures, &mut self.meter, picture) {
            meter.record((encoder, timer), picture);
        }
    }

    /// The frame was submitted.
    pub fn submitted(&mut self, index: &wgpu::SubmissionIndex) {
        if let Some(meter) = &mut self.meter {
            meter.submitted(index);
        }
    }
}

/// A number of stops that can be drawn.
const fn sound(stops: f32) -> f32 {
    if stops.is_nan() {
        return 0.0;
    }
    stops.clamp(-MOST_STOPS, MOST_STOPS)
}

impl Compositor {
    /// Chooses the picture's exposure, and compiles and binds what it needs when that is new.
    pub(in super::super) fn prepare_exposure(&mut self, input: &FrameInput<'_>, seen: bool) {
        let metered = self.exposure.meter.is_some();
        self.exposure.choose(&self.gpu, input, seen);
        // An automatic one is ready for the first lamp: compiling takes longer than a picture.
        let soon = self.exposure.changes() || self.exposure.follower.is_some();
        let new = soon && self.exposure.passes.is_none();
        if new {
            let variant = Variant {
                exposed: true,
                ..self.variant
            };
            let (device, frame) = (&self.gpu.device, &self.light_maps.frame_layout);
            self.exposure.passes = Some(Box::new(ExposedPasses {
                exposure: ExposurePass::new(device),
                surroundings: SurroundingsPass::new(device, frame, variant),
                composite: CompositePass::new(device, frame, variant),
            }));
        }
        if new || metered != self.exposure.meter.is_some() {
            self.rebind();
        }
        let queue = &self.gpu.queue;
        if let Some(passes) = self
            .exposure
            .passes
            .as_ref()
            .filter(|_| self.exposure.changes())
        {
            let factor = self.exposure.factor();
            let region = Region::for_factor(factor, input.picture.height);
            let change = (factor, input.highlights);
            passes
                .exposure
                .upload(queue, change, region, &self.response);
        }
        if let Some(meter) = self
            .exposure
            .meter
            .as_ref()
            .filter(|_| self.exposure.measures)
        {
            let (step, apart) = (self.settings.shadow_step, self.answers);
            meter.upload(queue, self.subtract, step, apart);
        }
    }

    /// The exposure of the newest picture.
    #[must_use]
    pub const fn exposure(&self) -> ExposureInForce {
        self.exposure.in_force
    }
}
