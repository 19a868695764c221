//! One run: each frame from its picture and its light to the outputs, and the counts.

use crate::context::RunContext;
use crate::display::DisplayLatency;
use crate::error::RigError;
use crate::frame::{Counts, PreparedFrame};
use crate::latency_monitor::LatencyState;
use crate::light::state::LightState;
use crate::light::updates::SceneUpdates;
use crate::planes::PlaneBakes;
use crate::poses::PoseFile;
use crate::rates::Rates;
use crate::report::{FrameCounts, InputCounts, Report, SkewMeter};
use crate::scenes::Scenes;
use crate::settings::{compositor_settings, exposure, live_settings};
use crate::source::Source;
use crate::status as published;
use crate::status::Published;
use penumbra_compositor::{Compositor, FrameInput, Gpu, LensOutput, Refresh};
use penumbra_config::Distortion;
use penumbra_config::Technique;
use penumbra_interface::{Clock, SystemClock};
use penumbra_lighting::{BrightestFollower, BrightestLight};
use penumbra_output::Screen;
use penumbra_output::files::FrameFolder;
use penumbra_picture::Picture;
use penumbra_scene::PlacedLamp;
use penumbra_status::RegistrationSource;
use penumbra_status::snapshot::SessionState;
use penumbra_status::{Settings, StageTimes};
use penumbra_sync::Provenance;
use penumbra_tracker_serial::freed::{FreedSender, Lens, optical_to_studio};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Where finished pictures go.
pub(super) struct Outlets {
    pub screen: Option<Box<dyn Screen>>,
    pub folder: Option<FrameFolder>,
    /// Who is told the scene camera's poses.
    pub pose_out: Option<FreedSender>,
    /// Where they are written.
    pub poses: Option<PoseFile>,
    /// Told how long pictures take to them.
    pub handing: Arc<DisplayLatency>,
}

/// The state of a run.
pub(super) struct Run {
    compositor: Compositor,
    screen: Option<Box<dyn Screen>>,
    folder: Option<FrameFolder>,
    pose_out: Option<FreedSender>,
    poses: Option<PoseFile>,
    handing: Arc<DisplayLatency>,
    settings: Settings,
    wished: tokio::sync::watch::Receiver<Settings>,
    stages: StageTimes,
    pub frames: FrameCounts,
    inputs: InputCounts,
    counts: Option<Counts>,
    latency: LatencyState,
    skew: SkewMeter,
    rates: Rates,
    light: LightState,
    scenes: Scenes,
    planes: PlaneBakes,
    follower: BrightestFollower,
    brightest: BrightestLight,
    /// Where they are in the picture at hand.
    lamps: Vec<PlacedLamp>,
    started: Instant,
    /// Something is on the screen.
    shown: bool,
    closed: bool,
}

impl Run {
    pub fn new(
        context: &RunContext,
        gpu: Gpu,
        outlets: Outlets,
        news: SceneUpdates,
    ) -> Result<Self, RigError> {
        let (config, setup) = (&context.config, &context.setup);
        let settings = compositor_settings(config, context.source.is_live(), gpu.software);
        let response = setup.calibration.scene_camera.response.clone();
        let mut compositor = Compositor::new(gpu, settings, response);
        compositor.set_lens_output(match config.registration.distortion {
            Distortion::Camera => LensOutput::Camera,
            Distortion::Undistorted => LensOutput::Undistorted,
        });
        let scenes = Scenes::new(context, &mut compositor, news)?;
        let Outlets {
            screen,
            folder,
            pose_out,
            poses,
            handing,
        } = outlets;
        Ok(Self {
            compositor,
            scenes,
            screen,
            folder,
            pose_out,
            poses,
            handing,
            settings: live_settings(config),
            wished: context.status.settings_receiver(),
            stages: StageTimes::default(),
            frames: FrameCounts::default(),
            inputs: InputCounts::default(),
            counts: None,
            latency: LatencyState::default(),
            skew: SkewMeter::default(),
            rates: Rates::default(),
            light: LightState::default(),
            planes: PlaneBakes::default(),
            follower: BrightestFollower::default(),
            brightest: BrightestLight::default(),
            lamps: Vec::new(),
            started: Instant::now(),
            shown: false,
            closed: false,
        })
    }

    pub fn is_over(&self, context: &RunContext) -> bool {
        let limit = context.options.frame_limit;
        let full = limit.is_some_and(|limit| self.frames.composed >= limit);
        let writer_gone = self.folder.as_ref().is_some_and(|f| !f.is_alive());
        full || self.closed || writer_gone || context.is_shutting_down()
    }

    /// One frame, from its picture and its light to the outputs.
    pub fn compose(
        &mut self,
        context: &RunContext,
        prepared: &PreparedFrame,
    ) -> Result<(), RigError> {
        let begun = Instant::now();
        self.stages.record("decode", prepared.decoding);
        self.stages.record("environment", prepared.lighting);
        self.take_settings();
        self.light.clone_from(&prepared.light);
        self.scenes.attend(
            context,
            &self.settings,
            &mut self.planes,
            &mut self.compositor,
        )?;
        self.draw(context, prepared)?;
        self.stages.record("composite", begun.elapsed());
        self.deliver(context, prepared)?;
        self.tell_pose(prepared);
        if let Some(poses) = &mut self.poses {
            poses.write(prepared)?;
        }
        for (pass, millis) in self.compositor.pass_times() {
            let time = Duration::from_secs_f64(millis * 1e-3);
            self.stages.record_gpu(pass, time);
        }
        self.planes.count(&self.compositor)?;
        self.stages.record("total", begun.elapsed());
        if context.source.is_live() {
            let latency = SystemClock
                .now()
                .nanos_since(prepared.frame.scene.arrived_at);
            let latency = Duration::from_nanos(latency.max(0).unsigned_abs());
            self.stages.record("arrival_to_picture", latency);
        }
        self.counts = Some(prepared.counts);
        self.frames.skipped += prepared.skipped;
        self.count(prepared);
        let environment = prepared.frame.environment.as_ref();
        let skew = environment.map(|e| e.skew_nanos);
        self.rates.composed(&prepared.counts.feed, skew);
        published::publish(&Published {
            status: &context.status,
            source: &context.source,
            prepared,
            stages: &self.stages,
            frames: &self.frames,
            rates: &self.rates,
            played: context.source.share_played(prepared.frame.scene.arrived_at),
            settings: &self.settings,
            planes: self.planes.status(),
            scene: self.scenes.status(),
            exposure: self.compositor.exposure(),
            brightest: self.brightest,
            stale_after_nanos: context.config.environment.stale_after_nanos,
        });
        Ok(())
    }

    /// No picture has come for a while: the last one stays, or a black one stands in its
    /// place, and the status goes on.
    pub fn idle(&mut self, context: &RunContext, counts: &Counts) -> Result<(), RigError> {
        if !self.shown {
            self.black(context)?;
        }
        if let Some(screen) = &mut self.screen {
            self.closed = !screen.show(&self.compositor);
        }
        if context.status.wants_picture() {
            self.publish_picture(context)?;
        }
        self.counts = Some(*counts);
        self.rates.idle(&counts.feed);
        published::publish_idle(&context.status, &context.source, &self.rates);
        Ok(())
    }

    fn black(&mut self, context: &RunContext) -> Result<(), RigError> {
        let (width, height) = context.picture_size();
        let pixels = width as usize * height as usize;
        let picture = Picture {
            width,
            height,
            rgba: [0, 0, 0, 255].repeat(pixels),
        };
        let camera = &context.setup.calibration.scene_camera.camera;
        self.compositor.compose(&FrameInput {
            show_virtual: false,
            ..FrameInput::new(&picture, camera)
        })?;
        self.shown = true;
        Ok(())
    }

    fn draw(&mut self, context: &RunContext, prepared: &PreparedFrame) -> Result<(), RigError> {
        if let Some(light) = &prepared.light.lighting {
            let (generation, seconds) = (light.generation, prepared.seconds);
            self.brightest = self.follower.follow(generation, &light.lights, seconds);
        }
        let scene_camera = &context.setup.calibration.scene_camera;
        let settings = &self.settings;
        let shadows = settings.technique != Technique::ImageBasedLighting;
        let refresh = context.config.shadows.refresh_per_frame;
        let scene = self.scenes.shown();
        scene.lamps_at(prepared.seconds, &mut self.lamps);
        self.compositor.compose(&FrameInput {
            seconds: prepared.seconds,
            picture: &prepared.picture,
            camera: &scene_camera.camera,
            vignetting: scene_camera.vignetting,
            rolling_shutter: prepared.rolling,
            world_from_camera: prepared.world_from_camera,
            reprojection: prepared.shown.map(|shown| shown.reprojection),
            lighting: prepared.light.lighting.as_deref(),
            indirect_light: prepared
                .light
                .near
                .as_deref()
                .filter(|_| settings.indirect_light),
            lamps: &self.lamps,
            lamp_response: settings.lamp_response,
            brightest: self.brightest.vector(),
            shadow_mode: settings.shadow_mode,
            shadow_strength: if shadows {
                settings.shadow_strength
            } else {
                0.0
            },
            refresh: Refresh::UpTo(refresh.count(settings.light_count) as usize),
            show_virtual: settings.virtual_object_visible,
            planes: self.planes.choice(settings, self.scenes.shown()),
            exposure: exposure(settings, prepared.seconds),
            highlights: settings.exposure_highlights,
        })?;
        self.shown = true;
        Ok(())
    }

    /// The picture to the window, the folder and whoever watches.
    fn deliver(&mut self, context: &RunContext, prepared: &PreparedFrame) -> Result<(), RigError> {
        let begun = Instant::now();
        if let Some(screen) = &mut self.screen {
            self.closed = !screen.show(&self.compositor);
        }
        let arrived_at = prepared.frame.scene.arrived_at;
        self.handing.add(SystemClock.now().nanos_since(arrived_at));
        let watched = context.status.wants_picture();
        if let Some(folder) = &self.folder {
            let mut picture = folder.spare();
            self.compositor.read(&mut picture)?;
            if watched {
                context.status.publish_picture(Arc::new(picture.clone()));
            }
            folder.write(prepared.index, picture);
        } else if watched {
            self.publish_picture(context)?;
        } else {
            self.compositor.gpu().wait()?;
        }
        self.stages.record("output", begun.elapsed());
        Ok(())
    }

    /// A message that cannot be sent is lost: the next one says more.
    fn tell_pose(&self, prepared: &PreparedFrame) {
        if let (Some(sender), Some(pose)) = (&self.pose_out, prepared.world_from_camera) {
            let _ = sender.send(optical_to_studio(pose), Lens::default());
        }
    }

    fn publish_picture(&self, context: &RunContext) -> Result<(), RigError> {
        let mut picture = Picture::default();
        self.compositor.read(&mut picture)?;
        context.status.publish_picture(Arc::new(picture));
        Ok(())
    }

    fn take_settings(&mut self) {
        if self.wished.has_changed().unwrap_or(false) {
            self.settings = self.wished.borrow_and_update().clone();
            self.compositor.set_light_budget(self.settings.light_count);
        }
    }

    fn count(&mut self, prepared: &PreparedFrame) {
        let frame = &prepared.frame;
        self.frames.composed += 1;
        match &frame.pose {
            None if prepared.registration.source == RegistrationSource::Markers => (),
            None => self.frames.without_pose += 1,
            Some(pose) if pose.provenance == Provenance::Predicted => {
                self.frames.predicted_pose += 1;
            }
            Some(_) => (),
        }
        match &frame.environment {
            Some(environment) => self.skew.add(environment.skew_nanos),
            None => self.frames.without_environment += 1,
        }
    }

    pub fn finish_loop(&mut self, context: &RunContext, counts: &Counts) {
        self.add(counts);
        self.counts = None;
        context.status.update(|s| s.session.loops += 1);
    }

    /// Pairing counts are of one loop, the others of all.
    fn add(&mut self, counts: &Counts) {
        self.latency = counts.latency;
        self.inputs.take(&counts.pairing);
        self.frames.in_session = counts.feed.scene_frames;
        self.inputs.environment_frames = counts.feed.environment_frames;
        self.inputs.poses = counts.feed.poses;
        self.inputs.damaged_stretches = counts.feed.damaged;
        self.inputs.skipped_tracker_bytes = counts.skipped_tracker_bytes;
    }

    pub fn into_report(mut self, context: &RunContext) -> Result<Report, RigError> {
        if let Some(counts) = self.counts.take() {
            self.add(&counts);
        }
        let none = self.frames.in_session == 0 && self.frames.composed == 0;
        if let Source::Recorded(session) = &context.source
            && none
            && !context.is_shutting_down()
        {
            return Err(RigError::Empty {
                path: session.path().to_owned(),
            });
        }
        if self.frames.composed > 0 {
            // Whoever opens the page after the end sees the last picture.
            self.publish_picture(context)?;
        }
        context
            .status
            .update(|s| s.session.enter(SessionState::Ended));
        if let Some(folder) = self.folder {
            folder.finish()?;
        }
        if let Some(poses) = self.poses {
            poses.finish()?;
        }
        let (width, height) = self.compositor.size().unwrap_or_default();
        let (lights, compact_lights) = self.light.count();
        Ok(Report {
            version: 1,
            session: context.source.name(),
            truncated: matches!(&context.source, Source::Recorded(s) if s.truncated()),
            adapter: self.compositor.gpu().name.clone(),
            resolution: [width, height],
            frames: self.frames,
            inputs: self.inputs,
            skew_ms: self.skew.skew(),
            tracker_latency: crate::latency_status::report(&self.latency),
            white_balance: self.light.white_balance.map(|status| (*status).clone()),
            lights,
            compact_lights,
            stages: self.stages,
            wall_seconds: self.started.elapsed().as_secs_f64(),
        })
    }
}
