//! The data flow of one frame, from top to bottom: every intermediate picture has a name here, and
//! is handed from the pass that draws it to the passes that read it. [`prepare`](super::prepare)
//! uploads what the passes need besides.

use super::compositor::Compositor;
use super::frame_input::FrameInput;
use super::gpu::GpuError;
use super::lens::StraightPictures;
use super::passes::composite::CompositeInputs;
use super::passes::shadow_buffer::{ShadowSource, Surfaces};
use super::prepare::FramePlan;
use super::readback::Readback;
use super::recorder::Recorder;
use super::sized_resources::SizedResources;
use super::textures::FrameTexture;

impl Compositor {
    /// Composes one frame. Returns without waiting for the device; [`Self::read`] waits.
    ///
    /// # Errors
    /// The picture is empty or too large for the device; its light has more pixels than the device
    /// can read.
    pub fn compose(&mut self, input: &FrameInput<'_>) -> Result<(), GpuError> {
        let plan = self.prepare(input)?;
        let Some(pictures) = self.pictures.take() else {
            return Ok(());
        };
        let descriptor = wgpu::CommandEncoderDescriptor {
            label: Some("frame"),
        };
        let mut encoder = self.gpu.device.create_command_encoder(&descriptor);
        self.timer.begin_frame();
        let finished = self.record(&mut encoder, &plan, &pictures);
        self.fit_readback(finished.size())
            .record(&mut encoder, &finished.texture);
        self.timer.end_frame(&mut encoder);
        let submitted = self.gpu.queue.submit([encoder.finish()]);
        self.exposure.submitted(&submitted);
        self.pictures = Some(pictures);
        self.finished = Some(finished);
        Ok(())
    }

    /// Records all passes in their order; returns the finished picture.
    fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        plan: &FramePlan,
        pictures: &SizedResources,
    ) -> FrameTexture {
        let r = &mut Recorder {
            device: &self.gpu.device,
            encoder,
            timer: &mut self.timer,
        };
        let p = &mut self.pipelines;
        let (frame, scene) = (&self.light_maps.frame_group, &self.scene);
        let (codes, output) = (&self.response_table, &pictures.output);

        // The camera picture, undistorted.
        let camera = match &self.lens {
            Some(lens) => lens.straighten(r, &pictures.camera),
            None => &pictures.camera,
        };
        // The real picture: the same in the exposure of this frame.
        let exposed = pictures.exposed.as_ref();
        let exposed = self.exposure.record(r, (camera, codes), exposed, output);
        let real = exposed.unwrap_or(camera);

        // Shadow maps: casters as seen from lights.
        let shadow_maps = &self.shadow_maps;
        p.shadow_map
            .record(r, frame, scene, &self.chosen, shadow_maps);
        p.lamp_map.record(r, scene, &self.light_maps.lamps);

        // What the camera sees of the real scene's proxies and of the virtual objects.
        let phantoms = p
            .phantom_geometry
            .record(r, frame, scene, &pictures.phantoms);
        let virtual_surfaces =
            p.virtual_geometry
                .record(r, frame, scene, &pictures.virtual_surfaces);
        // Which lights matter in which tile.
        let seen = (phantoms, virtual_surfaces);
        let tiles = p
            .tiles
            .record(r, frame, seen, plan.covered, &pictures.tiles);
        let surfaces = Surfaces {
            phantoms,
            virtual_surfaces,
            tiles,
            covered_tiles: &pictures.covered_tiles,
        };

        // The light that each surface lacks, looked up in shadow maps or on shadowing planes.
        let sums = self.planes.as_mut().and_then(|planes| planes.record(r));
        let source = sums.unwrap_or(ShadowSource::Maps(shadow_maps));
        let unshadowed = if plan.subtract { 0.0 } else { 1.0 };
        let shadows =
            p.shadow_buffer
                .record(r, frame, &source, surfaces, unshadowed, &pictures.shadows);
        // The light that virtual lights add, where it is not a part of the shadow buffer.
        let lamp_light = &pictures.lamp_light;
        if plan.lamps_apart {
            p.lamp_response
                .record(r, frame, scene, (camera, codes), phantoms, lamp_light);
        }

        let (surroundings_pass, composite_pass) = match self.exposure.passes() {
            Some(passes) => passes,
            None => (&mut p.surroundings, &mut p.composite),
        };
        // What virtual objects reflect of the real scene, shadows included.
        let surroundings = surroundings_pass.record(
            r,
            frame,
            (real, codes),
            (shadows, lamp_light),
            &pictures.surroundings,
        );
        // The composed picture.
        let inputs = CompositeInputs {
            real,
            codes,
            surfaces,
            shadows,
            lamp_light,
            surroundings,
            gloss: &self.light_maps.gloss,
        };
        let composed = composite_pass.record(r, frame, &inputs, &pictures.kinds, output);

        // The same with the distortion of the camera.
        let distorted = match &mut self.lens {
            Some(lens) => lens.bend(
                r,
                &StraightPictures {
                    camera,
                    codes,
                    composed,
                    surface: &virtual_surfaces.surface[0],
                    exposed: exposed.is_some(),
                },
            ),
            None => composed,
        };
        // The same as seen from the pose of its display.
        let reproject = self.reproject.as_mut().filter(|_| plan.reprojected);
        let finished = match reproject {
            Some(stage) => stage.record(r, distorted),
            None => distorted,
        };
        // The light that virtual lights add, for the exposure of later frames.
        self.exposure
            .record_meter(r, (camera, codes), (shadows, lamp_light));
        finished.clone()
    }

    /// The buffer into which finished pictures of `size` are copied.
    fn fit_readback(&mut self, size: (u32, u32)) -> &Readback {
        let kept = self.readback.take().filter(|kept| kept.fits(size));
        self.readback
            .insert(kept.unwrap_or_else(|| Readback::new(&self.gpu.device, size)))
    }
}
