//! Lets a recorded session flow through the compositor to the outputs.

use super::prepare::{Counts, LightState, Preparation, Prepared, Step};
use super::rates::Rates;
use super::report::{FrameCounts, InputCounts, Report, SkewMeter};
use super::status::Published;
use super::{RigError, RigSetup};
use crate::compositor::{Compositor, CompositorSettings, FrameInput, Gpu, Refresh, ShadowMode};
use crate::config::{Antialias, Config, LightPlacement, ReplaySpeed, ShadowResolution};
use crate::output::files::FrameFolder;
use crate::picture::Picture;
use crate::scene::lamps::lamps_at;
use crate::session::Session;
use crate::status::snapshot::SessionState;
use crate::status::{self, LightsMode, Settings, SharedStatus, StageTimes, Technique};
use crate::sync::{Provenance, RigFrame};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What `penumbra replay` was asked for, beyond the configuration.
#[derive(Clone, Debug, Default)]
pub struct ReplayOptions {
    /// Stop after so many frames.
    pub frame_limit: Option<u64>,
    /// Write over frames that are there.
    pub force: bool,
}

/// Shows finished pictures; a window, or nothing.
pub trait Screen: Send {
    /// A picture is finished on the device. False: the user has closed the window.
    fn show(&mut self, compositor: &Compositor) -> bool;
}

/// Everything a replay needs.
pub struct Replay {
    config: Config,
    options: ReplayOptions,
    session: Session,
    setup: RigSetup,
    status: Arc<SharedStatus>,
    shutdown: Arc<AtomicBool>,
}

/// The settings that the dashboard may change, as the configuration has them.
#[must_use]
pub fn live_settings(config: &Config) -> Settings {
    Settings {
        technique: if config.shadows.enabled {
            Technique::ImageBasedShadowing
        } else {
            Technique::ImageBasedLighting
        },
        light_count: config.environment.light_count,
        lights_mode: match config.environment.lights {
            LightPlacement::Adaptive => LightsMode::Adaptive,
            LightPlacement::Grid => LightsMode::Grid,
        },
        shadow_mode: match config.shadows.mode {
            crate::config::ShadowMode::Ratio => status::ShadowMode::Ratio,
            crate::config::ShadowMode::Subtract => status::ShadowMode::Subtract,
        },
        shadow_strength: config.shadows.strength,
        virtual_object_visible: true,
    }
}

/// Reads the session and checks everything that can be checked before the first frame.
///
/// # Errors
/// See [`RigError`].
pub fn replay(
    session: Session,
    config: Config,
    options: ReplayOptions,
    status: Arc<SharedStatus>,
    shutdown: Arc<AtomicBool>,
) -> Result<Replay, RigError> {
    let setup = RigSetup::read(&session, &config)?;
    Ok(Replay {
        config,
        options,
        session,
        setup,
        status,
        shutdown,
    })
}

impl Replay {
    /// Width and height of the pictures to come, pixels.
    #[must_use]
    pub fn picture_size(&self) -> (u32, u32) {
        let camera = &self.setup.calibration.scene_camera.camera;
        (camera.width, camera.height)
    }

    /// Runs to the end of the session, the frame limit, or the shutdown.
    ///
    /// # Errors
    /// See [`RigError`]. A damaged picture is counted and left out.
    pub fn run(self, gpu: Gpu, screen: Option<Box<dyn Screen>>) -> Result<Report, RigError> {
        let folder = match &self.config.output.frames {
            Some(path) => Some(FrameFolder::create(path, self.options.force, |job| {
                super::threads::spawn("files", job)
            })?),
            None => None,
        };
        let preparation = Preparation::start(
            &self.setup,
            &self.config,
            &self.session,
            self.status.settings_receiver(),
            self.shutdown.clone(),
        )?;
        super::status::begin(&self.status, self.session.path(), &gpu);
        let mut run = Run::new(&self, gpu, screen, folder);
        while !run.over(&self) {
            let Some(step) = preparation.next() else {
                break;
            };
            match step {
                Step::Frame(prepared) => {
                    run.compose(&self, &prepared)?;
                    preparation.give_back(prepared.picture);
                }
                Step::Skipped => run.frames.skipped += 1,
                Step::Damaged => run.frames.damaged += 1,
                Step::End(counts) => run.finish_loop(&self, &counts),
            }
        }
        drop(preparation);
        run.into_report(&self)
    }
}

/// The state of a running replay.
struct Run {
    compositor: Compositor,
    screen: Option<Box<dyn Screen>>,
    folder: Option<FrameFolder>,
    settings: Settings,
    wished: tokio::sync::watch::Receiver<Settings>,
    stages: StageTimes,
    frames: FrameCounts,
    inputs: InputCounts,
    counts: Option<Counts>,
    skew: SkewMeter,
    rates: Rates,
    light: LightState,
    started: Instant,
    closed: bool,
}

impl Run {
    fn new(
        replay: &Replay,
        gpu: Gpu,
        screen: Option<Box<dyn Screen>>,
        folder: Option<FrameFolder>,
    ) -> Self {
        let (config, setup) = (&replay.config, &replay.setup);
        let settings = compositor_settings(config, gpu.software);
        let response = setup.calibration.scene_camera.response.clone();
        let mut compositor = Compositor::new(gpu, settings, response);
        compositor.set_scene(&setup.scene, &crate::scene::casters(&setup.scene));
        Self {
            compositor,
            screen,
            folder,
            settings: live_settings(config),
            wished: replay.status.settings_receiver(),
            stages: StageTimes::default(),
            frames: FrameCounts::default(),
            inputs: InputCounts::default(),
            counts: None,
            skew: SkewMeter::default(),
            rates: Rates::default(),
            light: LightState::default(),
            started: Instant::now(),
            closed: false,
        }
    }

    fn over(&self, replay: &Replay) -> bool {
        let limit = replay.options.frame_limit;
        let full = limit.is_some_and(|limit| self.frames.composed >= limit);
        let writer_gone = self.folder.as_ref().is_some_and(|f| !f.is_alive());
        full || self.closed || writer_gone || replay.shutdown.load(Ordering::Relaxed)
    }

    /// One frame, from its picture and its light to the outputs.
    fn compose(&mut self, replay: &Replay, prepared: &Prepared) -> Result<(), RigError> {
        let begun = Instant::now();
        self.stages.record("decode", prepared.decoding);
        self.stages.record("environment", prepared.lighting);
        self.take_settings();
        self.light.clone_from(&prepared.light);
        self.draw(replay, prepared)?;
        self.stages.record("composite", begun.elapsed());
        self.deliver(replay, prepared.index)?;
        for (pass, millis) in self.compositor.pass_times() {
            let time = Duration::from_secs_f64(millis * 1e-3);
            self.stages.record_gpu(pass, time);
        }
        self.stages.record("total", begun.elapsed());
        self.counts = Some(prepared.counts);
        self.count(&prepared.frame);
        let environment = prepared.frame.environment.as_ref();
        let skew = environment.map(|e| e.skew_nanos);
        self.rates.composed(&prepared.counts.feed, skew);
        super::status::publish(&Published {
            status: &replay.status,
            prepared,
            stages: &self.stages,
            frames: &self.frames,
            rates: &self.rates,
            played: replay.session.share_played(prepared.frame.scene.arrived_at),
            settings: &self.settings,
            stale_after_nanos: replay.config.environment.stale_after_nanos,
        });
        Ok(())
    }

    fn draw(&mut self, replay: &Replay, prepared: &Prepared) -> Result<(), RigError> {
        let settings = &self.settings;
        let shadows = settings.technique == Technique::ImageBasedShadowing;
        let refresh = replay.config.shadows.refresh_per_frame;
        let lamps = lamps_at(&replay.setup.scene.lamps, prepared.seconds);
        self.compositor.compose(&FrameInput {
            picture: &prepared.picture,
            camera: &replay.setup.calibration.scene_camera.camera,
            world_from_camera: prepared.world_from_camera,
            lighting: prepared.light.lighting.as_deref(),
            near: prepared.light.near.as_deref(),
            lamps: &lamps,
            shadow_mode: match settings.shadow_mode {
                status::ShadowMode::Ratio => ShadowMode::Ratio,
                status::ShadowMode::Subtract => ShadowMode::Subtract,
            },
            shadow_strength: if shadows {
                settings.shadow_strength
            } else {
                0.0
            },
            refresh: Refresh::UpTo(refresh.of(settings.light_count) as usize),
            show_virtual: settings.virtual_object_visible,
        })?;
        Ok(())
    }

    /// The picture to the window, the folder and whoever watches.
    fn deliver(&mut self, replay: &Replay, index: u64) -> Result<(), RigError> {
        let begun = Instant::now();
        if let Some(screen) = &mut self.screen {
            self.closed = !screen.show(&self.compositor);
        }
        let watched = replay.status.wants_picture();
        if let Some(folder) = &self.folder {
            let mut picture = folder.spare();
            self.compositor.read(&mut picture)?;
            if watched {
                replay.status.publish_picture(Arc::new(picture.clone()));
            }
            folder.write(index, picture);
        } else if watched {
            self.publish_picture(replay)?;
        } else {
            self.compositor.gpu().wait()?;
        }
        self.stages.record("output", begun.elapsed());
        Ok(())
    }

    fn publish_picture(&self, replay: &Replay) -> Result<(), RigError> {
        let mut picture = Picture::default();
        self.compositor.read(&mut picture)?;
        replay.status.publish_picture(Arc::new(picture));
        Ok(())
    }

    fn take_settings(&mut self) {
        if self.wished.has_changed().unwrap_or(false) {
            self.settings = self.wished.borrow_and_update().clone();
            self.compositor.set_light_budget(self.settings.light_count);
        }
    }

    fn count(&mut self, frame: &RigFrame) {
        self.frames.composed += 1;
        match &frame.pose {
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

    fn finish_loop(&mut self, replay: &Replay, counts: &Counts) {
        self.add(counts);
        self.counts = None;
        replay.status.update(|s| s.session.loops += 1);
    }

    /// Pairing counts are of one loop, the others of all.
    fn add(&mut self, counts: &Counts) {
        self.inputs.take(&counts.pairing);
        self.frames.in_session = counts.feed.scene_frames;
        self.inputs.environment_frames = counts.feed.environment_frames;
        self.inputs.poses = counts.feed.poses;
        self.inputs.damaged_stretches = counts.feed.damaged;
        self.inputs.skipped_tracker_bytes = counts.skipped_tracker_bytes;
    }

    fn into_report(mut self, replay: &Replay) -> Result<Report, RigError> {
        if let Some(counts) = self.counts.take() {
            self.add(&counts);
        }
        let none = self.frames.in_session == 0 && self.frames.composed == 0;
        if none && !replay.shutdown.load(Ordering::Relaxed) {
            return Err(RigError::Empty {
                path: replay.session.path().to_owned(),
            });
        }
        if self.frames.composed > 0 {
            // Whoever opens the page after the end sees the last picture.
            self.publish_picture(replay)?;
        }
        replay
            .status
            .update(|s| s.session.enter(SessionState::Ended));
        if let Some(folder) = self.folder {
            folder.finish()?;
        }
        let name = replay.session.path().file_name().unwrap_or_default();
        let (width, height) = self.compositor.size().unwrap_or_default();
        let (lights, compact_lights) = self.light.count();
        Ok(Report {
            version: 1,
            session: name.to_string_lossy().into_owned(),
            truncated: replay.session.truncated(),
            adapter: self.compositor.gpu().name.clone(),
            resolution: [width, height],
            frames: self.frames,
            inputs: self.inputs,
            skew_ms: self.skew.skew(),
            white_balance: self.light.white_balance.map(|status| (*status).clone()),
            lights,
            compact_lights,
            stages: self.stages,
            wall_seconds: self.started.elapsed().as_secs_f64(),
        })
    }
}

/// Look-ups per light and point for soft shadows where there is time for them: with twice as
/// many the shadows' error falls by another 2 % only.
const SOFT_SAMPLES: u32 = 4;

fn compositor_settings(config: &Config, software: bool) -> CompositorSettings {
    let automatic = CompositorSettings::for_adapter(software);
    // Nobody waits for a frame of a replay at full speed.
    let unhurried = config.replay.speed == ReplaySpeed::Max;
    CompositorSettings {
        light_budget: config.environment.light_count,
        shadow_map_size: config.shadows.map_size,
        shadow_step: match config.shadows.resolution {
            ShadowResolution::Auto if unhurried => 1,
            ShadowResolution::Auto => automatic.shadow_step,
            ShadowResolution::Full => 1,
            ShadowResolution::Half => 2,
            ShadowResolution::Quarter => 4,
        },
        samples: match config.picture.antialias {
            Antialias::Msaa4 => 4,
            Antialias::Off => 1,
        },
        soft_samples: if config.shadows.soft {
            automatic
                .soft_samples
                .max(if unhurried { SOFT_SAMPLES } else { 1 })
        } else {
            1
        },
    }
}
