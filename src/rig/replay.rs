//! Lets a recorded session flow through the compositor to the outputs.

use super::feed::Feed;
use super::light::{LightStation, SceneView, placement};
use super::pace::Pace;
use super::report::{FrameCounts, InputCounts, Report, SkewMeter};
use super::{RigError, RigSetup};
use crate::compositor::{Compositor, CompositorSettings, FrameInput, Gpu, Refresh, ShadowMode};
use crate::config::{Antialias, Config, LightPlacement, ReplaySpeed, ShadowResolution};
use crate::output::files::FrameFolder;
use crate::picture::{Picture, YuvEncoding, decode_into};
use crate::session::Session;
use crate::status::{LightsMode, Settings, SharedStatus, StageTimes, Technique};
use crate::sync::{PairingConfig, Provenance, RigFrame};
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
            crate::config::ShadowMode::Ratio => crate::status::ShadowMode::Ratio,
            crate::config::ShadowMode::Subtract => crate::status::ShadowMode::Subtract,
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
        let mut run = Run::new(&self, gpu, screen, folder)?;
        let mut feed = Feed::new(
            self.session.clone(),
            &self.setup.calibration,
            run.pairing.clone(),
        );
        loop {
            run.play(&self, &mut feed)?;
            run.finish_loop(&feed);
            if !self.config.replay.repeat || run.over(&self) {
                break;
            }
            feed.rewind(run.pairing.clone());
        }
        run.into_report(&self, &feed)
    }
}

/// The state of a running replay.
struct Run {
    compositor: Compositor,
    light: LightStation,
    screen: Option<Box<dyn Screen>>,
    folder: Option<FrameFolder>,
    pairing: PairingConfig,
    yuv: YuvEncoding,
    picture: Picture,
    settings: Settings,
    wished: tokio::sync::watch::Receiver<Settings>,
    stages: StageTimes,
    frames: FrameCounts,
    inputs: InputCounts,
    skew: SkewMeter,
    lights: (u32, u32),
    pace: Pace,
    started: Instant,
    closed: bool,
    index: u64,
}

impl Run {
    fn new(
        replay: &Replay,
        gpu: Gpu,
        screen: Option<Box<dyn Screen>>,
        folder: Option<FrameFolder>,
    ) -> Result<Self, RigError> {
        let (config, setup) = (&replay.config, &replay.setup);
        let settings = compositor_settings(config, gpu.software);
        let response = setup.calibration.scene_camera.response.clone();
        let mut compositor = Compositor::new(gpu, settings, response);
        compositor.set_scene(&setup.scene, &crate::scene::casters(&setup.scene));
        Ok(Self {
            compositor,
            light: LightStation::new(setup, config, &replay.session)?,
            screen,
            folder,
            pairing: pairing(config, &setup.calibration),
            yuv: config.input.encoding(),
            picture: Picture::default(),
            settings: live_settings(config),
            wished: replay.status.settings_receiver(),
            stages: StageTimes::default(),
            frames: FrameCounts::default(),
            inputs: InputCounts::default(),
            skew: SkewMeter::default(),
            lights: (0, 0),
            pace: Pace::new(config.replay.speed),
            started: Instant::now(),
            closed: false,
            index: 0,
        })
    }

    fn over(&self, replay: &Replay) -> bool {
        let full = replay
            .options
            .frame_limit
            .is_some_and(|limit| self.frames.composed >= limit);
        let writer_gone = self.folder.as_ref().is_some_and(|f| !f.is_alive());
        full || self.closed || writer_gone || replay.shutdown.load(Ordering::Relaxed)
    }

    /// One pass over the session.
    fn play(&mut self, replay: &Replay, feed: &mut Feed) -> Result<(), RigError> {
        self.index = 0;
        self.pace.restart();
        while !self.over(replay) {
            let Some(frame) = feed.next_frame() else {
                return Ok(());
            };
            if self.pace.wait(frame.scene.arrived_at, &replay.shutdown) {
                self.compose(replay, &frame)?;
            } else {
                self.frames.skipped += 1;
            }
            self.index += 1;
        }
        Ok(())
    }

    /// One frame, from its bytes to the outputs.
    fn compose(&mut self, replay: &Replay, frame: &RigFrame) -> Result<(), RigError> {
        let begun = Instant::now();
        if decode_into(&frame.scene, &self.yuv, &mut self.picture).is_err() {
            self.frames.damaged += 1;
            return Ok(());
        }
        self.stages.record("decode", begun.elapsed());
        self.take_settings();
        self.light_frame(replay, frame);
        self.draw(replay, frame)?;
        self.deliver(replay)?;
        for (pass, millis) in self.compositor.pass_times() {
            self.stages
                .record_gpu(pass, Duration::from_secs_f64(millis * 1e-3));
        }
        self.stages.record("total", begun.elapsed());
        self.count(frame);
        self.publish(replay, frame);
        Ok(())
    }

    fn light_frame(&mut self, replay: &Replay, frame: &RigFrame) {
        let begun = Instant::now();
        let set = frame.environment.as_ref().map(|e| e.set.as_ref());
        let view = SceneView {
            picture: &self.picture,
            world_from_camera: world_from_camera(replay, frame),
            captured_at: frame.captured_at,
        };
        // An environment picture that cannot be read leaves the light as it was.
        if let Err(error) = self.light.update(set, &view) {
            replay.status.update(|s| s.warn(&error.to_string()));
        }
        self.stages.record("environment", begun.elapsed());
    }

    fn draw(&mut self, replay: &Replay, frame: &RigFrame) -> Result<(), RigError> {
        let begun = Instant::now();
        let calibration = &replay.setup.calibration;
        let shadows = self.settings.technique == Technique::ImageBasedShadowing;
        let limit = replay
            .config
            .shadows
            .refresh_per_frame
            .of(self.settings.light_count);
        let lighting = self.light.lighting().cloned();
        self.compositor.compose(&FrameInput {
            picture: &self.picture,
            camera: &calibration.scene_camera.camera,
            world_from_camera: world_from_camera(replay, frame),
            lighting: lighting.as_deref(),
            near: self.light.near(),
            shadow_mode: match self.settings.shadow_mode {
                crate::status::ShadowMode::Ratio => ShadowMode::Ratio,
                crate::status::ShadowMode::Subtract => ShadowMode::Subtract,
            },
            shadow_strength: if shadows {
                self.settings.shadow_strength
            } else {
                0.0
            },
            refresh: Refresh::UpTo(limit as usize),
            show_virtual: self.settings.virtual_object_visible,
        })?;
        self.lights = lighting.map_or((0, 0), |l| {
            let compact = l
                .lights
                .iter()
                .filter(|l| l.kind == crate::environment::LightKind::Compact);
            (l.lights.len() as u32, compact.count() as u32)
        });
        self.stages.record("composite", begun.elapsed());
        Ok(())
    }

    /// The picture to the window, the folder and whoever watches.
    fn deliver(&mut self, replay: &Replay) -> Result<(), RigError> {
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
            folder.write(self.index, picture);
        } else if watched {
            let mut picture = Picture::default();
            self.compositor.read(&mut picture)?;
            replay.status.publish_picture(Arc::new(picture));
        } else {
            self.compositor.gpu().wait()?;
        }
        self.stages.record("output", begun.elapsed());
        Ok(())
    }

    fn take_settings(&mut self) {
        if !self.wished.has_changed().unwrap_or(false) {
            return;
        }
        self.settings = self.wished.borrow_and_update().clone();
        let lights = match self.settings.lights_mode {
            LightsMode::Adaptive => LightPlacement::Adaptive,
            LightsMode::Grid => LightPlacement::Grid,
        };
        self.compositor.set_light_budget(self.settings.light_count);
        if let Some(estimator) = self.light.estimator() {
            estimator.set_lights(placement(lights), self.settings.light_count as usize);
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

    fn publish(&self, replay: &Replay, frame: &RigFrame) {
        super::status::publish(&super::status::Published {
            status: &replay.status,
            frame,
            light: &self.light,
            stages: &self.stages,
            frames: &self.frames,
            lights: self.lights,
            settings: &self.settings,
            size: (self.picture.width, self.picture.height),
        });
    }

    fn finish_loop(&mut self, feed: &Feed) {
        self.inputs.take(&feed.pairing_counts());
        replay_counts(&mut self.frames, &mut self.inputs, feed);
    }

    fn into_report(self, replay: &Replay, feed: &Feed) -> Result<Report, RigError> {
        // One that was stopped at once has seen nothing yet.
        let stopped = self.closed || replay.shutdown.load(Ordering::Relaxed);
        if feed.counts().scene_frames == 0 && !stopped {
            return Err(RigError::Empty {
                path: replay.session.path().to_owned(),
            });
        }
        if let Some(folder) = self.folder {
            folder.finish()?;
        }
        let name = replay.session.path().file_name().unwrap_or_default();
        let (width, height) = self.compositor.size().unwrap_or_default();
        let seen = replay.setup.calibration.environment.is_some();
        Ok(Report {
            version: 1,
            session: name.to_string_lossy().into_owned(),
            truncated: replay.session.truncated(),
            adapter: self.compositor.gpu().name.clone(),
            resolution: [width, height],
            frames: self.frames,
            inputs: self.inputs,
            skew_ms: self.skew.skew(),
            white_balance: seen.then(|| self.light.match_status()),
            lights: self.lights.0,
            compact_lights: self.lights.1,
            stages: self.stages,
            wall_seconds: self.started.elapsed().as_secs_f64(),
        })
    }
}

fn replay_counts(frames: &mut FrameCounts, inputs: &mut InputCounts, feed: &Feed) {
    let counts = feed.counts();
    frames.in_session = counts.scene_frames;
    inputs.environment_frames = counts.environment_frames;
    inputs.poses = counts.poses;
    inputs.damaged_stretches = counts.damaged;
    inputs.skipped_tracker_bytes = feed.tracker_counters().skipped_bytes;
}

fn world_from_camera(
    replay: &Replay,
    frame: &RigFrame,
) -> Option<penumbra_interface::RigidTransform> {
    let pose = frame.pose.as_ref()?.transmitter_from_sensor;
    let tracker = replay.setup.calibration.tracker.as_ref();
    Some(tracker.map_or(pose, |t| t.world_from_scene_camera(pose)))
}

fn pairing(config: &Config, rig: &crate::calibration::RigCalibration) -> PairingConfig {
    let mut pairing = PairingConfig::for_rig(rig);
    pairing.history.max_prediction_nanos = config.sync.longest_prediction_nanos;
    pairing.with_full_windows()
}

/// Frames that nobody waits for are made as well as can be.
fn compositor_settings(config: &Config, software: bool) -> CompositorSettings {
    let software = software && config.replay.speed != ReplaySpeed::Max;
    let automatic = CompositorSettings::for_adapter(software);
    CompositorSettings {
        light_budget: config.environment.light_count,
        shadow_map_size: config.shadows.map_size,
        shadow_step: match config.shadows.resolution {
            ShadowResolution::Auto => {
                std::env::var("PEN_STEP").map_or(automatic.shadow_step, |v| v.parse().unwrap())
            }
            ShadowResolution::Full => 1,
            ShadowResolution::Half => 2,
        },
        samples: match config.picture.antialias {
            Antialias::Msaa4 => 4,
            Antialias::Off => 1,
        },
        soft_samples: std::env::var("PEN_SOFT").map_or(
            if config.shadows.soft {
                automatic.soft_samples
            } else {
                1
            },
            |v| v.parse().unwrap(),
        ),
    }
}
