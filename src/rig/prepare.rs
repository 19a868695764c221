//! Makes frames ready for the compositor, one ahead of it, on a thread of its own: bytes
//! become pictures, environment pictures become light. The way through is the same whoever
//! waits for it, so the same recording gives the same pictures.

use crate::display::{Display, DisplayLatency};
use crate::error::RigError;
use crate::feed::{Feed, JournaledFrame};
use crate::frame::{Counts, PreparedFrame};
use crate::journal::Journal;
use crate::latency_monitor::{LatencyMonitor, LatencyState};
use crate::light::estimator::LightEstimator;
use crate::light::scheduler::LightScheduler;
use crate::light::state::LightRequest;
use crate::light::updates::SceneUpdates;
use crate::light::view::SphereAt;
use crate::light::worker::LightUpdater;
use crate::pace::Pace;
use crate::registration::{ByTracker, TagRegistration};
use crate::settings::pairing_config;
use crate::setup::RigSetup;
use crate::setup::TRACKER_NOISE;
use crate::source::Source;
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::DVec3;
use penumbra_camera::RollingShutter;
use penumbra_capture::Next;
use penumbra_config::TrackerSource;
use penumbra_config::{Config, Predict, ReplayPairing};
use penumbra_interface::threads;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_picture::{Picture, YuvEncoding, decode_into};
use penumbra_registration::TrackerPose;
use penumbra_status::{RegistrationStatus, Settings};
use penumbra_sync::{PairingConfig, RigFrame};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;
use tokio::sync::watch;

/// Pictures further apart than this do not tell how the camera moves, seconds.
const LONGEST_STEP: f64 = 0.2;
/// Half the time over which a tracker tells it, nanoseconds: longer than a picture is read.
const MOTION_NANOS: i64 = 10_000_000;
/// Frames that may wait for the compositor.
const AHEAD: usize = 1;

/// What comes next.
pub enum PreparationEvent {
    /// A frame.
    Frame(Box<PreparedFrame>),
    /// It was too late for one.
    Skipped,
    /// A picture that cannot be decoded.
    Damaged,
    /// No device has sent a picture for a while.
    Idle(Box<Counts>),
    /// The recording is over; another loop may follow.
    End(Box<Counts>),
}

/// What the preparation is told while it runs.
pub(super) struct PreparationInputs {
    /// Settings that are wished.
    pub wished: watch::Receiver<Settings>,
    /// Scenes that have changed.
    pub news: SceneUpdates,
    /// How long pictures take to the window.
    pub handing: Arc<DisplayLatency>,
}

/// The thread, and the way to it. Dropping it ends the thread.
pub struct Preparation {
    steps: Option<Receiver<PreparationEvent>>,
    /// Says that the next step is waited for, to a rig that makes none sooner.
    wants: Option<Sender<()>>,
    spare: Sender<Picture>,
    thread: Option<JoinHandle<()>>,
}

impl Preparation {
    /// Starts on the recording's first frame. `stop` ends waits for a frame's time.
    ///
    /// # Errors
    /// A light station that cannot be built; no thread to be had.
    pub fn start(
        setup: &RigSetup,
        config: &Config,
        source: &Source,
        wished: watch::Receiver<Settings>,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, RigError> {
        let told = PreparationInputs {
            wished,
            news: SceneUpdates::default(),
            handing: Arc::default(),
        };
        Self::start_with(setup, config, source, told, stop)
    }

    /// The same, told of more while it runs.
    pub(super) fn start_with(
        setup: &RigSetup,
        config: &Config,
        source: &Source,
        told: PreparationInputs,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, RigError> {
        let PreparationInputs {
            wished,
            news,
            handing,
        } = told;
        let as_live = as_live(config, source);
        let pairing = pairing(config, setup, as_live);
        let ahead = if source.is_live() { 0 } else { AHEAD };
        let (steps_in, steps) = bounded(ahead);
        let (spare, spares) = bounded(AHEAD + 2);
        let (wants, wanted) = bounded(1);
        let registration = &config.registration;
        let middle = crate::registration::middle(&setup.scene, setup.tags.as_ref());
        let mut worker = Worker {
            display: (registration.predict == Predict::Display).then(|| {
                let handing = source.is_live().then_some(handing);
                Display::new(setup, config, middle, handing)
            }),
            lights: lights(setup, config, source, wished, news)?,
            feed: Feed::new(source, &setup.calibration, pairing, as_live),
            latency: LatencyMonitor::start(setup, config, source, pairing.station)?,
            journal: Journal::new(source),
            tags: TagRegistration::new(setup, registration.row_seconds),
            row_seconds: registration.row_seconds,
            last_pose: None,
            middle,
            setup: setup.clone(),
            pairing,
            yuv: config.input.encoding(),
            // Files hold every frame of the recording.
            pace: (!source.is_live())
                .then(|| Pace::new(config.replay.speed, config.output.frames.is_some())),
            repeat: config.replay.repeat && !source.is_live(),
            steps: steps_in,
            wanted: source.is_live().then_some(wanted),
            spares,
            stop,
            began: None,
        };
        let thread = threads::spawn("prepare", move || worker.run())
            .map_err(|source| RigError::Thread { source })?;
        Ok(Self {
            steps: Some(steps),
            wants: Some(wants),
            spare,
            thread: Some(thread),
        })
    }

    /// Waits for the next step; `None` after the last.
    pub fn next(&self) -> Option<PreparationEvent> {
        if let Some(wants) = &self.wants {
            // Said already, or nobody listens.
            let _ = wants.try_send(());
        }
        self.steps.as_ref()?.recv().ok()
    }

    /// Gives a picture's memory back.
    pub fn give_back(&self, picture: Picture) {
        // Nobody waits for spare memory; too much of it is dropped.
        let _ = self.spare.try_send(picture);
    }
}

impl Drop for Preparation {
    fn drop(&mut self) {
        self.steps = None;
        self.wants = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Worker {
    setup: RigSetup,
    /// Looks for fiducials, where the rig has a use for them.
    tags: Option<TagRegistration>,
    /// Looks ahead to when a picture is seen, where that is wished.
    display: Option<Display>,
    /// What the virtual objects stand about, world, metres.
    middle: DVec3,
    /// From one row of the scene camera to the next.
    row_seconds: f64,
    /// The picture before, where its pose tells how the camera moves.
    last_pose: Option<(MonotonicTime, RigidTransform)>,
    lights: LightScheduler,
    feed: Feed,
    /// Measures the tracker's latency, if configured.
    latency: Option<LatencyMonitor>,
    journal: Journal,
    pairing: PairingConfig,
    yuv: YuvEncoding,
    /// Devices have a pace of their own.
    pace: Option<Pace>,
    repeat: bool,
    steps: Sender<PreparationEvent>,
    /// A live picture is chosen when the compositor is free for it, so that it is the newest
    /// and has not grown old behind another.
    wanted: Option<Receiver<()>>,
    spares: Receiver<Picture>,
    stop: Arc<AtomicBool>,
    began: Option<MonotonicTime>,
}

impl Worker {
    /// Until the end, or until nobody takes frames any more.
    fn run(&mut self) {
        loop {
            self.began = None;
            if let Some(pace) = &mut self.pace {
                pace.restart();
            }
            loop {
                let free = self.wanted.as_ref().map(Receiver::recv);
                if free.is_some_and(|free| free.is_err()) {
                    return;
                }
                let step = match self.feed.next_picture(self.latency.as_mut()) {
                    Next::Item(frame) => self.step(*frame),
                    Next::Idle => PreparationEvent::Idle(Box::new(self.counts(false))),
                    Next::Ended => break,
                };
                if self.stop.load(Ordering::Relaxed) || self.steps.send(step).is_err() {
                    return;
                }
            }
            let counts = self.counts(true);
            let over = self
                .steps
                .send(PreparationEvent::End(Box::new(counts)))
                .is_err();
            if over || !self.repeat || counts.feed.scene_frames == 0 {
                return;
            }
            self.feed.rewind(self.pairing);
            if let Some(latency) = &mut self.latency {
                latency.restart();
            }
        }
    }

    /// Returns the counts so far; `is_over` at the end of a recording.
    fn counts(&mut self, is_over: bool) -> Counts {
        let active_nanos = self.feed.tracker_latency();
        Counts {
            feed: self.feed.counts(),
            pairing: self.feed.pairing_counts(),
            skipped_tracker_bytes: self.feed.tracker_counters().skipped_bytes,
            latency: match &mut self.latency {
                Some(monitor) => monitor.state(active_nanos, is_over),
                None => LatencyState {
                    in_force_nanos: active_nanos,
                    followed: None,
                },
            },
        }
    }

    fn step(&mut self, journaled: JournaledFrame) -> PreparationEvent {
        let JournaledFrame {
            frame,
            skipped,
            entry,
        } = journaled;
        let first = *self.began.get_or_insert(frame.captured_at);
        if let Some(pace) = &mut self.pace
            && !pace.wait(frame.scene.arrived_at, &self.stop)
        {
            return PreparationEvent::Skipped;
        }
        let begun = Instant::now();
        let mut picture = self.spares.try_recv().unwrap_or_default();
        if decode_into(&frame.scene, &self.yuv, &mut picture).is_err() {
            return PreparationEvent::Damaged;
        }
        let decoding = begun.elapsed();
        let misfit = self.misfit(&picture);
        let world_from_camera = self
            .setup
            .world_from_camera(&frame)
            .filter(|_| misfit.is_none());
        let seconds = frame.captured_at.seconds_since(first);
        let (world_from_camera, ball, mut registration) =
            self.register(&picture, &frame, world_from_camera, misfit.is_none());
        let (setup, tracker) = (&self.setup, self.feed.tracker());
        let shown = self.display.as_mut().and_then(|display| {
            display.predict(setup, tracker, &frame, world_from_camera, &registration)
        });
        registration.display = shown.map(|shown| shown.status);
        let rolling = self.rolling(&frame, world_from_camera);
        let tracker_sigma = self.tracker_sigma(&frame, world_from_camera);
        let seen = LightRequest {
            ball,
            ..LightRequest::new(&frame, seconds, world_from_camera)
        };
        if let Some(note) = self.lights.see(&seen, &picture, entry) {
            self.journal.write(seen.arrived_at, note);
        }
        let counts = self.counts(false);
        let light = self.lights.in_force();
        PreparationEvent::Frame(Box::new(PreparedFrame {
            index: frame.index,
            seconds,
            picture,
            world_from_camera,
            registration,
            rolling,
            shown,
            tracker_sigma,
            light: light.state.clone(),
            decoding,
            lighting: light.took,
            preview: light.preview.take(),
            warning: misfit.or(light.unseen.take()),
            skipped,
            counts,
            frame,
        }))
    }

    /// What fiducials tell of a picture, where they are looked for.
    fn register(
        &mut self,
        picture: &Picture,
        frame: &RigFrame,
        tracked: Option<RigidTransform>,
        fits: bool,
    ) -> (Option<RigidTransform>, SphereAt, RegistrationStatus) {
        let motion = self.tracked_motion(frame);
        let Some(tags) = self.tags.as_mut().filter(|_| fits) else {
            if fits {
                self.observe_picture(frame.captured_at, picture, None);
            }
            let status = RegistrationStatus::by_tracker(tracked.is_some());
            return (tracked, SphereAt::Calibrated, status);
        };
        let tracked = tracked.map(|world_from_camera| TrackerPose {
            world_from_camera,
            noise: self.setup.tracker_noise(frame).unwrap_or(TRACKER_NOISE),
        });
        let by_tracker = ByTracker {
            pose: tracked,
            motion,
        };
        let told = tags.register(picture, by_tracker, frame.captured_at);
        self.observe_picture(frame.captured_at, picture, told.by_markers);
        let ball = match told.ball {
            Some(ball) => SphereAt::Seen(ball),
            None if told.ball_lost => SphereAt::Lost,
            None => SphereAt::Calibrated,
        };
        (told.world_from_camera, ball, told.status)
    }

    /// Shows a picture to the latency monitor.
    fn observe_picture(
        &mut self,
        captured_at: MonotonicTime,
        picture: &Picture,
        by_markers: Option<RigidTransform>,
    ) {
        if let Some(monitor) = &mut self.latency {
            monitor.picture(captured_at, picture, by_markers);
        }
    }

    /// How the camera moved: by the tracker, else since the picture before.
    fn rolling(
        &mut self,
        frame: &RigFrame,
        pose: Option<RigidTransform>,
    ) -> Option<RollingShutter> {
        if self.row_seconds == 0.0 {
            return None;
        }
        let last = std::mem::replace(&mut self.last_pose, pose.map(|p| (frame.captured_at, p)));
        if let Some(motion) = self.tracked_motion(frame) {
            return Some(motion);
        }
        let (then, before) = last?;
        let seconds = frame.captured_at.seconds_since(then);
        let near = (1e-3..LONGEST_STEP).contains(&seconds);
        near.then(|| RollingShutter::between(&before, &pose?, seconds, self.row_seconds))?
    }

    /// How the camera moved, by the tracker.
    fn tracked_motion(&self, frame: &RigFrame) -> Option<RollingShutter> {
        let (before, after, seconds) = frame.motion?;
        let tracker = self.setup.calibration.tracker.as_ref()?;
        let [before, after] = [before, after].map(|p| tracker.world_from_scene_camera(p));
        RollingShutter::between(&before, &after, seconds, self.row_seconds)
    }

    /// See [`PreparedFrame::tracker_sigma`].
    fn tracker_sigma(&self, frame: &RigFrame, pose: Option<RigidTransform>) -> Option<[f64; 3]> {
        let [metres, radians] = self.setup.tracker_noise(frame)?;
        let camera = &self.setup.calibration.scene_camera.camera;
        let z = pose?.inverse().transform_point(self.middle).z.abs();
        let pixels = camera.focal.x * (metres / z.clamp(0.1, 10.0)).hypot(radians);
        let all = 3.0_f64.sqrt();
        Some([1e3 * metres * all, radians.to_degrees() * all, pixels])
    }

    /// A picture of another size than the calibration's is shown as it is: nothing can be put
    /// in its right place.
    fn misfit(&self, picture: &Picture) -> Option<String> {
        let camera = &self.setup.calibration.scene_camera.camera;
        let fits = (picture.width, picture.height) == (camera.width, camera.height);
        (!fits && self.setup.calibrated).then(|| {
            format!(
                "the scene camera's pictures have {}x{} pixels, but it was calibrated at {}x{}; set \
                 its width and height, or calibrate anew",
                picture.width, picture.height, camera.width, camera.height
            )
        })
    }
}

/// How pictures come by their light.
fn lights(
    setup: &RigSetup,
    config: &Config,
    source: &Source,
    wished: watch::Receiver<Settings>,
    news: SceneUpdates,
) -> Result<LightScheduler, RigError> {
    let station = LightEstimator::new(setup, config, &|name| source.attachment(name))?;
    let technique = crate::live_settings(config).technique;
    let lighter = LightUpdater::new(station, wished, technique, config.planes.frequency, news);
    match source {
        Source::Live(_) => LightScheduler::beside(lighter),
        Source::Recorded(_) if as_live(config, source) => Ok(LightScheduler::as_noted(lighter)),
        Source::Recorded(_) => Ok(LightScheduler::own(lighter)),
    }
}

/// Whether pictures wait as in a live rig.
fn as_live(config: &Config, source: &Source) -> bool {
    match (source, config.replay.pairing) {
        (Source::Live(_), _) | (_, ReplayPairing::Live) => true,
        (Source::Recorded(_), ReplayPairing::Complete) => false,
        (Source::Recorded(session), ReplayPairing::Auto) => session.has_journal(),
    }
}

fn pairing(config: &Config, setup: &RigSetup, as_live: bool) -> PairingConfig {
    let mut pairing = pairing_config(&setup.calibration);
    pairing.history.max_prediction_nanos = config.sync.max_prediction_nanos;
    pairing.history.smoothing = config.sync.smoothing();
    if config.registration.row_seconds != 0.0 {
        pairing.motion_nanos = MOTION_NANOS;
    }
    if let (Some(station), Some(TrackerSource::System(tracker))) =
        (&mut pairing.station, &config.tracker)
    {
        *station = tracker.station;
    }
    if as_live {
        pairing.max_wait_nanos = config.sync.max_wait_nanos;
        return pairing;
    }
    pairing.with_full_windows()
}
