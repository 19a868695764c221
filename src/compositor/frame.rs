//! Records the passes of one frame in the order of its data flow: every intermediate picture is a
//! named value that goes from the pass that draws it to the passes that read it.
//! [`prepare`](super::prepare) uploads their other inputs.

use super::compositor::Compositor;
use super::frame_input::FrameInput;
use super::gpu::GpuError;
use super::passes::composite::CompositeInputs;
use super::passes::shadow_buffer::{ShadowPictures, ShadowSource, SurfaceLight, Surfaces};
use super::pipelines::Pipelines;
use super::prepare::FramePlan;
use super::readback::Readback;
use super::recorder::Recorder;
use super::scene_buffers::SceneBuffers;
use super::shaders::Variant;
use super::sized_resources::SizedResources;
use super::textures::{FrameTexture, TILE};

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
        let mut passes = self.pipelines.take().unwrap_or_else(|| self.compiled());
        let finished = self.record(&mut encoder, &mut passes, &plan, &pictures);
        self.pipelines = Some(passes);
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
        p: &mut Pipelines,
        plan: &FramePlan,
        pictures: &SizedResources,
    ) -> FrameTexture {
        let r = &mut Recorder {
            device: &self.gpu.device,
            encoder,
            timer: &mut self.timer,
        };
        self.cover.set_drawn();
        let (frame, scene) = (&self.light_maps.frame_group, &self.scene);
        let (codes, output) = (&self.response_table, &pictures.output);

        // The real picture: the camera's, undistorted, and in the exposure of this frame.
        let camera = match &self.lens {
            Some(lens) => lens.undistort(r, &pictures.camera),
            None => &pictures.camera,
        };
        let exposed = pictures.exposed.as_ref();
        let real = self.exposure.record(r, (camera, codes), exposed, output);

        // Shadow maps: casters as seen from lights.
        let dome = &self.shadow_maps;
        if !self.variant.cached {
            p.shadow_map.record(r, frame, scene, &self.chosen, dome);
        }
        p.lamp_map.record(r, scene, &self.light_maps.lamps);

        // Basis images under this frame's light.
        let planes = self.planes.as_mut();
        let sums = planes.and_then(|planes| planes.record(r));

        // The surfaces that the camera sees, real and virtual, and the light that each lacks,
        // looked up in the surface cache, in shadow maps or on shadowing planes.
        let surfaces = p.record_surfaces(r, frame, scene, (self.variant, plan), pictures);
        let source = sums.unwrap_or(ShadowSource::Maps(dome));
        let shadows = p.record_shadows(r, frame, &source, surfaces, plan, pictures);

        // The light that virtual lights add to real surfaces, unless the shadow buffer holds it.
        if plan.lamps_apart {
            let (pass, phantoms) = (&mut p.lamp_response, surfaces.phantoms);
            pass.record(r, frame, scene, real, phantoms, &pictures.lamp_light);
        }
        let light = SurfaceLight {
            shadows,
            lamp_light: &pictures.lamp_light,
        };

        // The surroundings that virtual objects reflect, and the composed picture.
        let (surroundings_pass, composite_pass) = match self.exposure.passes() {
            Some(passes) => passes,
            None => (&mut p.surroundings, &mut p.composite),
        };
        let shown = (light, surfaces.phantoms);
        let surroundings = surroundings_pass.record(r, frame, real, shown, &pictures.surroundings);
        let inputs = CompositeInputs {
            real,
            surfaces,
            light,
            edge_tiles: &pictures.edge_tiles,
            surroundings,
            gloss: &self.light_maps.gloss,
            nearby: self.reflections.picture(),
        };
        let composed = composite_pass.record(r, frame, &inputs, &pictures.kinds, output);

        // The composed picture with the distortion of the camera, and with its look on everything
        // virtual, warped to the display pose.
        let lens = self.lens.as_mut();
        let distorted = lens.map(|lens| lens.distort(r, real, composed, surfaces).clone());
        let distorted = distorted.as_ref().unwrap_or(composed);
        let stages = (self.lens.as_ref(), &pictures.kinds);
        self.look.record(r, real, &surfaces, stages, distorted);
        let finished = match &mut self.reproject {
            Some(stage) if plan.reprojected => stage.record(r, distorted),
            _ => distorted,
        };

        // The light that virtual lights add, measured for the exposure of later frames.
        self.exposure.record_meter(r, real, light);
        finished.clone()
    }

    /// The buffer into which finished pictures of `size` are copied.
    fn fit_readback(&mut self, size: (u32, u32)) -> &Readback {
        let kept = self.readback.take().filter(|kept| kept.fits(size));
        self.readback
            .insert(kept.unwrap_or_else(|| Readback::new(&self.gpu.device, size)))
    }
}

impl Pipelines {
    /// Draws the visible surfaces, and sorts them into tiles by the lights that matter there.
    fn record_surfaces<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        scene: &SceneBuffers,
        (variant, plan): (Variant, &FramePlan),
        pictures: &'a SizedResources,
    ) -> Surfaces<'a> {
        let shadow = (&pictures.shadows.phantom_shadow, plan.unshadowed());
        let phantoms = self
            .phantom_geometry
            .record(r, frame, scene, shadow, &pictures.phantoms);
        let virtual_surfaces = &pictures.virtual_surfaces;
        let pixels = [plan.cleared, plan.covered].map(|tiles| pixels_of(tiles, pictures.size));
        self.virtual_geometry
            .record(r, frame, scene, pixels, virtual_surfaces);
        let seen = (phantoms, virtual_surfaces);
        // Where light is kept on surfaces, only virtual lights depend on the tile.
        let tiles = if variant.cached && !variant.lamps {
            &pictures.tiles
        } else {
            self.tiles
                .record(r, frame, seen, plan.covered, &pictures.tiles)
        };
        Surfaces {
            phantoms,
            virtual_surfaces,
            tiles,
            covered_tiles: &pictures.covered_tiles,
        }
    }

    /// Draws the light that surfaces lose, and finds the tiles in which real edges matter to it.
    fn record_shadows<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        frame: &wgpu::BindGroup,
        source: &ShadowSource<'_>,
        surfaces: Surfaces<'_>,
        plan: &FramePlan,
        pictures: &'a SizedResources,
    ) -> &'a ShadowPictures {
        let shadows = &pictures.shadows;
        self.shadow_buffer
            .record(r, frame, source, surfaces, plan.unshadowed(), shadows);
        // Subtraction does not examine edges.
        if !plan.subtract {
            self.edge_tiles
                .record(r, frame, surfaces, shadows, &pictures.edge_tiles);
        }
        shadows
    }
}

/// The rectangle of pixels that a rectangle of tiles (x, y, width, height) covers in a picture of
/// `size`.
fn pixels_of([x, y, across, down]: [u32; 4], (width, height): (u32, u32)) -> [u32; 4] {
    let (left, top) = (x * TILE, y * TILE);
    let (right, bottom) = ((x + across) * TILE, (y + down) * TILE);
    [left, top, right.min(width) - left, bottom.min(height) - top]
}
