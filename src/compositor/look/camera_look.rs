//! The stage that suits a frame, and the blur field of the frame.

use super::super::cover::Corners;
use super::super::frame_input::FrameInput;
use super::super::lens::LensStage;
use super::super::moving::MovingPart;
use super::super::passes::shadow_buffer::Surfaces;
use super::super::recorder::Recorder;
use super::super::response_table::RealPicture;
use super::super::shaders::LookVariant;
use super::super::textures::FrameTexture;
use super::blur_field::{BlurField, BlurredBox};
use super::stage::{LookInputs, LookStage};
use crate::compiled::Device;
use penumbra_camera::PinholeCamera;
use penumbra_interface::threads;
use std::thread::JoinHandle;

/// The camera's look between frames. Empty until a frame asks for one.
#[derive(Default)]
pub struct CameraLook {
    stage: Option<Box<LookStage>>,
    /// A stage that is compiled for later frames.
    compiling: Option<JoinHandle<Box<LookStage>>>,
    /// Whether the look changes the frame.
    active: bool,
    field: BlurField,
    boxes: Vec<BlurredBox>,
}

/// Properties of a frame for which the passes are compiled.
pub struct LookFit {
    /// Samples a pixel of virtual surfaces.
    pub samples: u32,
    /// Whether the finished picture has the distortion of a lens.
    pub distorted: bool,
    /// Whether it is in another exposure than the camera's.
    pub exposed: bool,
    /// Whether passes are compiled on a thread: until that has ended, frames have no look.
    pub in_background: bool,
}

/// Boxes of the virtual parts, the moving ones of them, and the height of the ground.
type Parts<'a> = (&'a [Option<Corners>], &'a [MovingPart], Option<f64>);

impl CameraLook {
    /// Leaves the look out of the next frame, unless it is prepared.
    pub const fn leave_out(&mut self) {
        self.active = false;
    }

    /// Prepares the look of a frame in whose finished picture `camera` sees the scene; `factor` is
    /// that of the exposure.
    pub fn prepare(
        &mut self,
        gpu: (&Device, &wgpu::Queue),
        (camera, fit, factor): (&PinholeCamera, LookFit, f32),
        input: &FrameInput<'_>,
        (boxes, moving, ground): Parts<'_>,
    ) {
        self.place(input, boxes, moving);
        let extent = self.field.update(camera, input, &self.boxes, ground);
        if extent == 0.0 && input.look.noise.is_none() && input.look.spread.is_none() {
            return;
        }
        let size = (camera.width, camera.height);
        let variant = LookVariant {
            samples: fit.samples,
            distorted: fit.distorted,
            exposed: fit.exposed,
            spread: input.look.spread.is_some(),
            grain: input.look.noise.is_some(),
            taps: 1,
        };
        let kept = self.stage.take().filter(|s| s.suits(size, variant));
        let stage = kept.or_else(|| self.compiled(gpu, size, variant, fit.in_background));
        let Some(stage) = stage else { return };
        let stage = self.stage.insert(stage);
        stage.upload(gpu, &input.look, (&self.field, extent), factor);
        self.active = true;
    }

    /// The stage for pictures of `size`; `None` while it is compiled on a thread.
    fn compiled(
        &mut self,
        (device, queue): (&Device, &wgpu::Queue),
        size: (u32, u32),
        variant: LookVariant,
        in_background: bool,
    ) -> Option<Box<LookStage>> {
        if self.compiling.as_ref().is_some_and(|c| !c.is_finished()) {
            return None;
        }
        let done = self.compiling.take().and_then(|c| c.join().ok());
        if let Some(done) = done.filter(|stage| stage.suits(size, variant)) {
            return Some(done);
        }
        let cells = self.field.size();
        let (device, queue) = (device.clone(), queue.clone());
        let compile = move |blurs| {
            let mut stage = LookStage::new((&device, &queue), size, cells, variant);
            if blurs {
                stage.compile_blurs(&device);
            }
            Box::new(stage)
        };
        if !in_background {
            return Some(compile(false));
        }
        let thread = threads::spawn("look", move || compile(true));
        self.compiling = thread.ok();
        None
    }

    /// Draws the look over the finished picture, in place, if it changes the frame. `lens` is the
    /// stage of the camera if it distorts, `kinds` the depth buffer of the composite.
    pub fn record(
        &mut self,
        r: &mut Recorder<'_>,
        real: RealPicture<'_>,
        surfaces: &Surfaces<'_>,
        (lens, kinds): (Option<&LensStage>, &FrameTexture),
        picture: &FrameTexture,
    ) {
        let lens = lens.and_then(LensStage::distorted);
        let inputs = LookInputs {
            real: lens.map_or(real.shown(), |(raw, _)| raw),
            codes: real.codes,
            shape: &surfaces.virtual_surfaces.surface[0],
            tiles: [&surfaces.tiles.phantom.lights, surfaces.covered_tiles],
            kinds: lens.is_none().then_some(kinds),
            positions: lens.map(|(_, positions)| positions),
        };
        if let Some(stage) = self.stage.as_mut().filter(|_| self.active) {
            stage.record(r, &inputs, picture);
        }
    }

    /// Lists the boxes of the parts with their motion during the exposure.
    fn place(&mut self, input: &FrameInput<'_>, boxes: &[Option<Corners>], moving: &[MovingPart]) {
        self.boxes.clear();
        let half = input.look.motion.map_or(0.0, |m| 0.5 * m.seconds);
        for (index, corners) in boxes.iter().enumerate() {
            let Some(corners) = *corners else { continue };
            let part = moving.iter().find(|part| part.index == index);
            let moved = part.filter(|_| half > 0.0).map(|part| {
                let from_world = part.world.inverse();
                [-half, half].map(|t| part.motion.at(input.seconds + t) * from_world)
            });
            self.boxes.push(BlurredBox { corners, moved });
        }
    }
}
