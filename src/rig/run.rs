//! The state of a run: composes each prepared frame, passes it to the outputs and counts it.

mod recovery;

use crate::composites::Composites;
use crate::context::RunContext;
use crate::damage::DamageLog;
use crate::display::DisplayLatency;
use crate::error::RigError;
use crate::frame::{Counts, PreparedFrame};
use crate::latency_monitor::LatencyState;
use crate::light::state::LightState;
use crate::light::updates::SceneUpdates;
use crate::picture_problems::PictureProblems;
use crate::planes::PlaneBakes;
use crate::playback::HOLD_INTERVAL;
use crate::poses::PoseFile;
use crate::rates::Rates;
use crate::rectifier::Rectifier;
use crate::report::{FrameCounts, InputCounts, Report, SkewMeter};
use crate::scenes::Scenes;
use crate::settings::{compositor_settings, exposure, live_settings, look};
use crate::source::Source;
use crate::status as published;
use crate::status::Published;
use penumbra_compositor::{ComingLight, Compositor, FrameInput, Gpu, LensOutput, Refresh};
use penumbra_config::Distortion;
use penumbra_config::Technique;
use penumbra_interface::{Clock, DeviceKind, SystemClock};
use penumbra_lighting::{BrightestFollower, BrightestLight};
use penumbra_output::Screen;
use penumbra_output::files::FrameFolder;
use penumbra_picture::{Picture, PictureError};
use penumbra_scene::{IndirectLight, PlacedLamp};
use penumbra_status::RegistrationSource;
use penumbra_status::snapshot::SessionState;
use penumbra_status::{Playback, Settings, StageTimes};
use penumbra_sync::Provenance;
use penumbra_tracker_serial::freed::{FreedSender, Lens, optical_to_studio};
use std::cell::OnceCell;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The outputs of composed pictures and their poses.
pub(super) struct Outputs {
    pub screen: Option<Box<dyn Screen>>,
    pub folder: Option<FrameFolder>,
    /// Sends the scene camera's poses by FreeD.
    pub pose_out: Option<FreedSender>,
    /// The file to which the poses are written.
    pub poses: Option<PoseFile>,
    /// Measures the time from a picture's arrival to the screen.
    pub display_latency: Arc<DisplayLatency>,
}

/// Compiles the compositor of a run on `gpu`.
fn compositor(context: &RunContext, gpu: Gpu) -> Compositor {
    let config = &context.config;
    // Files can be compared; a viewer of the screen or the stream would rather not wait.
    let reproducible = config.output.writes_all() || context.is_unhurried();
    let settings = compositor_settings(config, gpu.software, reproducible);
    let response = context.setup.calibration.scene_camera.response.clone();
    let mut compositor = Compositor::new(gpu, settings, response);
    compositor.set_lens_output(match config.registration.distortion {
        Distortion::Camera => LensOutput::Camera,
        Distortion::Undistorted => LensOutput::Undistorted,
    });
    compositor
}

/// Returns the indirect light to be shown.
fn indirect<'a>(light: &'a LightState, settings: &Settings) -> Option<&'a IndirectLight> {
    let light = light.indirect.as_deref();
    light.filter(|_| settings.indirect_light)
}

/// Returns where a recording wants the composited pictures.
fn composites(source: &Source) -> Option<&Composites> {
    match source {
        Source::Live(live) => Some(&*live.contents.composites).filter(|c| c.wanted()),
        Source::Recorded(_) => None,
    }
}

/// The state of a run.
pub(super) struct Run {
    compositor: Compositor,
    /// Undistorts the camera's picture for comparisons with the undistorted composite.
    rectifier: OnceCell<Rectifier>,
    screen: Option<Box<dyn Screen>>,
    folder: Option<FrameFolder>,
    pose_out: Option<FreedSender>,
    poses: Option<PoseFile>,
    display_latency: Arc<DisplayLatency>,
    settings: Settings,
    requested: tokio::sync::watch::Receiver<Settings>,
    playback: tokio::sync::watch::Receiver<Playback>,
    /// The newest frame of a recording, for a pause.
    kept: Option<Box<PreparedFrame>>,
    /// Number of pictures composed again during pauses.
    repeated: u64,
    /// Whether the picture stands still.
    holds: bool,
    /// Whether the frame has been composed before.
    is_again: bool,
    stages: StageTimes,
    pub frames: FrameCounts,
    pub damage: DamageLog,
    problems: PictureProblems,
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
    /// The virtual lights at the time of the current frame.
    lamps: Vec<PlacedLamp>,
    started: Instant,
    /// Whether a picture has been composed.
    has_picture: bool,
    /// Whether the log names the tracker's wrong station.
    warned_of_station: bool,
    /// Whether the user has closed the screen.
    is_closed: bool,
    /// Number of times that the graphics device was lost since the last composed picture.
    successive_losses: u32,
    /// When it was lost, until the next picture is composed.
    lost_at: Option<Instant>,
    /// An error that did not end the run.
    late_error: Option<RigError>,
}

impl Run {
    /// Creates the compositor with the initial scene.
    ///
    /// # Errors
    /// The session's scene cannot be read, or the system cannot start a thread.
    pub fn new(
        context: &RunContext,
        gpu: Gpu,
        outputs: Outputs,
        scene_updates: SceneUpdates,
    ) -> Result<Self, RigError> {
        let config = &context.config;
        let mut compositor = compositor(context, gpu);
        let scenes = Scenes::new(context, &mut compositor, scene_updates)?;
        let vignetting = context.setup.calibration.scene_camera.vignetting;
        compositor.compile(vignetting.is_some(), config.registration.row_seconds != 0.0);
        let Outputs {
            screen,
            folder,
            pose_out,
            poses,
            display_latency,
        } = outputs;
        Ok(Self {
            compositor,
            rectifier: OnceCell::new(),
            scenes,
            screen,
            folder,
            pose_out,
            poses,
            display_latency,
            settings: live_settings(config),
            requested: context.status.settings_receiver(),
            playback: context.status.playback_receiver(),
            kept: None,
            repeated: 0,
            holds: false,
            is_again: false,
            stages: StageTimes::default(),
            frames: FrameCounts::default(),
            problems: PictureProblems::default(),
            damage: match &context.source {
                Source::Recorded(session) => DamageLog::new(session.damage(), &context.status),
                Source::Live(_) => DamageLog::default(),
            },
            inputs: InputCounts::default(),
            counts: None,
            latency: LatencyState::default(),
            skew: SkewMeter::default(),
            rates: Rates::default(),
            light: LightState::default(),
            planes: PlaneBakes::new(context),
            follower: BrightestFollower::default(),
            brightest: BrightestLight::default(),
            lamps: Vec::new(),
            started: Instant::now(),
            has_picture: false,
            warned_of_station: false,
            is_closed: false,
            successive_losses: 0,
            lost_at: None,
            late_error: None,
        })
    }

    /// Returns whether the run must end: frame limit, closed screen, failed writer or shutdown.
    pub fn is_over(&self, context: &RunContext) -> bool {
        let limit = context.options.frame_limit;
        let is_full = limit.is_some_and(|limit| self.frames.composed >= limit);
        let has_writer_ended = self.folder.as_ref().is_some_and(|f| !f.is_alive());
        is_full || self.is_closed || has_writer_ended || context.is_shutting_down()
    }

    /// During a pause: composes the newest frame again, so that settings take effect, and returns
    /// true. A frame of before a jump is not held.
    ///
    /// # Errors
    /// As [`Self::compose`].
    pub fn hold(&mut self, context: &RunContext) -> Result<bool, RigError> {
        let playback = *self.playback.borrow();
        let is_held = |frame: &mut Box<PreparedFrame>| frame.jumps == playback.jumps;
        self.holds = playback.paused;
        let Some(frame) = self.kept.take_if(|f| playback.paused && is_held(f)) else {
            return Ok(false);
        };
        let begun = Instant::now();
        self.repeated += 1;
        self.is_again = true;
        let composed = self.compose(context, &frame);
        self.is_again = false;
        self.kept = Some(frame);
        composed?;
        std::thread::sleep(HOLD_INTERVAL.saturating_sub(begun.elapsed()));
        Ok(true)
    }

    /// Keeps a composed frame of a recording and returns the frame that it replaces, or a frame of
    /// live devices.
    pub fn keep(
        &mut self,
        context: &RunContext,
        mut frame: Box<PreparedFrame>,
    ) -> Option<Box<PreparedFrame>> {
        if context.source.is_live() || self.folder.is_some() {
            return Some(frame);
        }
        // They have been counted and published.
        (frame.skipped, frame.preview, frame.warning) = (0, None, None);
        self.kept.replace(frame)
    }

    /// Composes a prepared frame, passes it to the outputs and publishes its status.
    ///
    /// # Errors
    /// The compositor fails, an output cannot be written, or a bake fails.
    pub fn compose(
        &mut self,
        context: &RunContext,
        prepared: &PreparedFrame,
    ) -> Result<(), RigError> {
        while let Err(error) = self.try_compose(context, prepared) {
            self.recover(context, error)?;
        }
        self.end_recovery(context);
        Ok(())
    }

    fn try_compose(
        &mut self,
        context: &RunContext,
        prepared: &PreparedFrame,
    ) -> Result<(), RigError> {
        let begun = Instant::now();
        self.stages.record("decode", prepared.decoding);
        self.stages.record("environment", prepared.lighting);
        self.apply_settings();
        self.light.clone_from(&prepared.light);
        self.scenes.update(
            context,
            &self.settings,
            prepared.light.lighting.as_ref(),
            &mut self.planes,
            &mut self.compositor,
        )?;
        self.render(context, prepared)?;
        self.stages.record("composite", begun.elapsed());
        self.output(context, prepared)?;
        for (pass, millis) in self.compositor.pass_times() {
            let time = Duration::from_secs_f64(millis * 1e-3);
            self.stages.record_gpu(pass, time);
        }
        self.planes.count(&self.compositor)?;
        // From here on nothing fails because of the device, so no pose is sent or written twice.
        self.send_pose(prepared);
        self.write_pose(context, prepared)?;
        self.stages.record("total", begun.elapsed());
        if context.source.is_live() {
            let latency = SystemClock
                .now()
                .nanos_since(prepared.frame.scene.arrived_at);
            let latency = Duration::from_nanos(latency.max(0).unsigned_abs());
            self.stages.record("arrival_to_picture", latency);
        }
        self.counts = Some(prepared.counts);
        self.check_station(&prepared.counts);
        self.frames.skipped += prepared.skipped;
        if !self.is_again {
            self.count(prepared);
        }
        let environment = prepared.frame.environment.as_ref();
        let skew = environment.map(|e| e.skew_nanos);
        self.rates.record_composed(&prepared.counts.feed, skew);
        published::publish(&Published {
            status: &context.status,
            source: &context.source,
            prepared,
            stages: &self.stages,
            frames: &self.frames,
            repeated: self.repeated,
            holds: self.holds,
            lost: self.damage.counts,
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

    /// Writes the pose to the file of poses. A live picture goes on without that file if it cannot be
    /// written; the run reports the error at its end.
    fn write_pose(
        &mut self,
        context: &RunContext,
        prepared: &PreparedFrame,
    ) -> Result<(), RigError> {
        let Some(Err(error)) = self.poses.as_mut().map(|poses| poses.write(prepared)) else {
            return Ok(());
        };
        if !context.source.is_live() {
            return Err(error);
        }
        let text = error.to_string();
        tracing::warn!("{text}; no more poses are written");
        context.status.update(|s| s.warn(&text));
        self.poses = None;
        self.late_error = Some(error);
        Ok(())
    }

    /// Warns once if the tracker sends readings of other stations only.
    fn check_station(&mut self, counts: &Counts) {
        if !self.warned_of_station
            && let Some(problem) = counts.pairing.wrong_station()
        {
            tracing::warn!("tracker: {problem}");
            self.warned_of_station = true;
        }
    }

    /// Counts a picture that cannot be decoded; the status of a live rig says why.
    pub fn skip_damaged(
        &mut self,
        context: &RunContext,
        (error, seconds): (&PictureError, f64),
        counts: &Counts,
    ) {
        self.frames.damaged += 1;
        self.problems
            .add(&format!("scene picture: {error}"), seconds);
        let Source::Live(live) = &context.source else {
            return;
        };
        let mut devices = live.supervised().iter();
        if let Some(camera) = devices.find(|d| d.kind == DeviceKind::SceneCamera) {
            camera.undecodable(&error.to_string());
        }
        let figures = (&self.rates, counts);
        published::publish_idle(&context.status, &context.source, figures);
    }

    /// Handles a pause without pictures: keeps the last picture on the screen, or a black one if
    /// there was none, and updates the status.
    ///
    /// # Errors
    /// The compositor fails.
    pub fn idle(&mut self, context: &RunContext, counts: &Counts) -> Result<(), RigError> {
        while let Err(error) = self.try_idle(context, counts) {
            self.recover(context, error)?;
        }
        Ok(())
    }

    fn try_idle(&mut self, context: &RunContext, counts: &Counts) -> Result<(), RigError> {
        if !self.has_picture {
            self.compose_black(context)?;
        }
        if let Some(screen) = &mut self.screen {
            self.is_closed = !screen.show(&self.compositor);
        }
        if context.status.wants_picture() {
            self.publish_picture(context)?;
        }
        self.counts = Some(*counts);
        self.rates.record_idle(&counts.feed);
        self.check_station(counts);
        let figures = (&self.rates, counts);
        published::publish_idle(&context.status, &context.source, figures);
        Ok(())
    }

    fn compose_black(&mut self, context: &RunContext) -> Result<(), RigError> {
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
        self.has_picture = true;
        Ok(())
    }

    fn render(&mut self, context: &RunContext, prepared: &PreparedFrame) -> Result<(), RigError> {
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
        // A picture that is composed again stands still: its own light is the next one's.
        let coming = prepared.coming_light.as_ref().filter(|_| !self.is_again);
        self.compositor.compose(&FrameInput {
            seconds: prepared.seconds,
            picture: &prepared.picture,
            camera: &prepared.camera,
            vignetting: scene_camera.vignetting,
            rolling_shutter: prepared.rolling_shutter,
            world_from_camera: prepared.world_from_camera,
            reprojection: prepared.display.map(|display| display.reprojection),
            lighting: prepared.light.lighting.as_deref(),
            indirect_light: indirect(&prepared.light, settings),
            coming_light: coming.and_then(|light| {
                Some(ComingLight {
                    lighting: light.lighting.as_deref()?,
                    indirect: indirect(light, settings),
                })
            }),
            is_start: prepared.is_start && !self.is_again,
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
            look: look(&context.config.look, &context.setup.calibration, prepared),
        })?;
        self.has_picture = true;
        self.scenes.set_view(
            prepared.world_from_camera,
            &prepared.camera,
            prepared.seconds,
        );
        Ok(())
    }

    /// Passes the picture to the screen, the folder and the dashboard's viewers.
    fn output(&mut self, context: &RunContext, prepared: &PreparedFrame) -> Result<(), RigError> {
        let begun = Instant::now();
        if let Some(screen) = &mut self.screen {
            self.is_closed = !screen.show(&self.compositor);
        }
        let arrived_at = prepared.frame.scene.arrived_at;
        self.display_latency
            .add(SystemClock.now().nanos_since(arrived_at));
        let composites = composites(&context.source);
        let has_viewer = context.status.wants_picture() || composites.is_some();
        let compares = context.status.wants_pair();
        let captured_at = prepared.frame.captured_at;
        let publish = |picture: Picture| {
            let picture = Arc::new(picture);
            if let Some(composites) = composites {
                composites.offer(&picture, captured_at);
            }
            context.status.publish_picture(picture);
        };
        if let Some(folder) = &self.folder {
            let mut picture = folder.spare();
            self.compositor.read(&mut picture)?;
            if compares {
                self.publish_pair(context, &picture, &prepared.picture);
            }
            if has_viewer {
                publish(picture.clone());
            }
            folder.write(prepared.index, picture);
        } else if has_viewer || compares {
            let mut picture = Picture::default();
            self.compositor.read(&mut picture)?;
            if compares {
                self.publish_pair(context, &picture, &prepared.picture);
            }
            if has_viewer {
                publish(picture);
            }
        } else {
            self.compositor.gpu().wait()?;
        }
        self.stages.record("output", begun.elapsed());
        Ok(())
    }

    /// Sends the pose. A failed message is dropped, because the next one replaces it.
    fn send_pose(&self, prepared: &PreparedFrame) {
        if let (Some(sender), Some(pose)) = (&self.pose_out, prepared.world_from_camera) {
            let _ = sender.send(optical_to_studio(pose), Lens::default());
        }
    }

    /// Publishes a composed picture with the camera's picture of the same frame below it, undistorted
    /// if the composed one is.
    fn publish_pair(&self, context: &RunContext, composed: &Picture, camera: &Picture) {
        if (composed.width, composed.height) != (camera.width, camera.height) {
            return;
        }
        let mut rgba = Vec::with_capacity(composed.rgba.len() + camera.rgba.len());
        rgba.extend_from_slice(&composed.rgba);
        match context.config.registration.distortion {
            Distortion::Camera => rgba.extend_from_slice(&camera.rgba),
            Distortion::Undistorted => {
                let lens = &context.setup.calibration.scene_camera.camera;
                let rectifier = self.rectifier.get_or_init(|| Rectifier::new(lens));
                rectifier.append(camera, &mut rgba);
            }
        }
        context.status.publish_pair(Arc::new(Picture {
            width: composed.width,
            height: 2 * composed.height,
            rgba,
        }));
    }

    fn publish_picture(&self, context: &RunContext) -> Result<(), RigError> {
        let mut picture = Picture::default();
        self.compositor.read(&mut picture)?;
        context.status.publish_picture(Arc::new(picture));
        Ok(())
    }

    fn apply_settings(&mut self) {
        if self.requested.has_changed().unwrap_or(false) {
            self.settings = self.requested.borrow_and_update().clone();
            self.compositor.set_light_budget(self.settings.light_count);
        }
    }

    fn count(&mut self, prepared: &PreparedFrame) {
        let frame = &prepared.frame;
        self.frames.composed += 1;
        if let Some(warning) = &prepared.warning {
            self.problems.add(warning, prepared.seconds);
        }
        match &frame.pose {
            None if matches!(
                prepared.registration.source,
                RegistrationSource::Markers | RegistrationSource::Fixed
            ) => {}
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

    /// Adds the counts of a finished loop of the recording.
    pub fn finish_loop(&mut self, context: &RunContext, counts: &Counts) {
        self.add(counts);
        self.counts = None;
        self.damage.complete();
        context.status.update(|s| s.session.loops += 1);
    }

    /// Adds counts to the report: pairing counts cover one loop, the others all loops.
    fn add(&mut self, counts: &Counts) {
        self.latency = counts.latency;
        self.inputs.add_pairing(&counts.pairing);
        self.frames.in_session = counts.feed.scene_frames;
        self.inputs.environment_frames = counts.feed.environment_frames;
        self.inputs.poses = counts.feed.poses;
        self.inputs.damaged_stretches = counts.feed.damaged;
        self.inputs.skipped_tracker_bytes = counts.skipped_tracker_bytes;
        self.inputs.lost_poses = counts.lost_readings;
    }

    /// Refuses a recording of which no picture could be composed.
    fn check_composed(&self, context: &RunContext) -> Result<(), RigError> {
        let Source::Recorded(session) = &context.source else {
            return Ok(());
        };
        let frames = &self.frames;
        if frames.composed + frames.skipped > 0 || context.is_shutting_down() {
            return Ok(());
        }
        let path = session.path().to_owned();
        match frames.damaged + self.damage.counts.scene_frames {
            0 if frames.in_session == 0 => Err(RigError::Empty { path }),
            0 => Ok(()),
            count => Err(RigError::AllDamaged {
                path,
                count,
                reason: self.problems.first().to_owned(),
            }),
        }
    }

    /// Refuses a recording whose first picture has another size than the calibrated one.
    ///
    /// # Errors
    /// It has; virtual objects would be nowhere right.
    pub fn check_size(
        &self,
        context: &RunContext,
        prepared: &PreparedFrame,
    ) -> Result<(), RigError> {
        let Source::Recorded(session) = &context.source else {
            return Ok(());
        };
        let (picture, calibrated) = (&prepared.picture, context.picture_size());
        let fits = (picture.width, picture.height) == calibrated;
        if self.frames.composed > 0 || fits || !context.setup.calibrated {
            return Ok(());
        }
        Err(RigError::PictureSize {
            path: session.path().to_owned(),
            pictures: format!("{}x{}", picture.width, picture.height),
            calibrated: format!("{}x{}", calibrated.0, calibrated.1),
        })
    }

    /// Ends the run: completes the outputs and returns the report.
    ///
    /// # Errors
    /// The recording has no picture of the scene camera, or an output cannot be written.
    pub fn into_report(mut self, context: &RunContext) -> Result<Report, RigError> {
        if let Some(counts) = self.counts.take() {
            self.add(&counts);
        }
        self.check_composed(context)?;
        if self.frames.composed > 0 && self.has_picture {
            // The dashboard shows the last picture after the end of the run.
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
        if let Some(error) = self.late_error {
            return Err(error);
        }
        self.frames.lost = self.damage.counts.scene_frames;
        self.inputs.lost_environment_frames = self.damage.counts.environment_frames;
        self.inputs.lost_tracker_messages = self.damage.counts.tracker_messages;
        let (width, height) = self.compositor.size().unwrap_or_default();
        let (lights, compact_lights) = self.light.count();
        Ok(Report {
            version: 1,
            session: context.source.name(),
            truncated: matches!(&context.source, Source::Recorded(s) if s.truncated()),
            adapter: self.compositor.gpu().name.clone(),
            quality: context.config.picture.quality,
            pose: context.setup.pose,
            resolution: [width, height],
            frames: self.frames,
            inputs: self.inputs,
            damage: self.damage.parts,
            picture_problems: self.problems.into_list(),
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
