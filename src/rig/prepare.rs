//! Prepares frames for the compositor, one frame ahead of it, on its own thread: decodes the
//! picture, finds the camera's pose and requests the frame's light. Frames of a recording that is
//! replayed at full speed or to files then wait until the next environment picture, too, has been
//! read, between which and the one before the light is interpolated. The result does not depend on
//! the consumer's timing, so the same recording gives the same pictures. At its own rate a recording
//! is read ahead of what is shown, so that most frames have that light, too; none waits for it longer.

use crate::display::{DisplayLatency, DisplayPredictor};
use crate::error::RigError;
use crate::feed::{Feed, JournaledFrame};
use crate::frame::{Counts, PreparedFrame};
use crate::held_frames::HeldFrames;
use crate::journal::{Journal, JournalEntry};
use crate::latency_monitor::{LatencyMonitor, LatencyState};
use crate::lens_refiner::{LensRefiner, lens_status};
use crate::levels::levels;
use crate::light::estimator::LightEstimator;
use crate::light::scheduler::LightScheduler;
use crate::light::state::{LightRequest, LightState};
use crate::light::updates::SceneUpdates;
use crate::light::view::SphereAt;
use crate::light::worker::LightUpdater;
use crate::pace::{POLL_INTERVAL, Pace};
use crate::playback::{AtEnd, END_INTERVAL, Transport};
use crate::registration::{TagRegistration, TrackerEstimate};
use crate::release::Release;
use crate::settings::pairing_config;
use crate::setup::RigSetup;
use crate::setup::TRACKER_NOISE;
use crate::source::Source;
use crate::steadied::PoseSteadying;
use crossbeam_channel::{Receiver, SendTimeoutError, Sender, bounded};
use glam::DVec3;
use penumbra_camera::{ExposureMotion, PinholeCamera, RollingShutter};
use penumbra_capture::Next;
use penumbra_config::TrackerSource;
use penumbra_config::{Config, LookConfig, PoseSource, Predict, ReplayPairing, ReplaySpeed};
use penumbra_interface::threads;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_picture::{Picture, PictureError, YuvEncoding, decode_within};
use penumbra_registration::{SteadiedPose, TrackerPose};
use penumbra_session::SessionError;
use penumbra_status::{LensStatus, Playback, RegistrationStatus, Settings};
use penumbra_sync::{PairingConfig, RigFrame};
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;
use tokio::sync::watch;

/// Maximum time between two pictures whose poses determine the camera's motion, seconds.
const MAX_PICTURE_INTERVAL: f64 = 0.2;
/// Half the time span over which the tracker measures the camera's motion, nanoseconds. The span is
/// longer than a typical readout of a picture.
const MOTION_NANOS: i64 = 10_000_000;
/// Exposure times that are believed, seconds.
const EXPOSURE_SECONDS: RangeInclusive<f64> = 1e-6..=1.0;
/// Maximum number of frames that wait for the compositor.
const MAX_FRAMES_AHEAD: usize = 1;
/// Maximum number of recycled pictures: those of the frames between two environment pictures.
const MAX_RECYCLED: usize = 16;

/// Poses of the camera before and after an instant, and the seconds between them.
type Motion = (RigidTransform, RigidTransform, f64);

/// One step of the preparation.
pub enum PreparationEvent {
    /// A prepared frame.
    Frame(Box<PreparedFrame>),
    /// This number of frames were skipped because they were late, after the last frame.
    Skipped(u64),
    /// A picture could not be decoded.
    Damaged {
        /// Why.
        error: PictureError,
        /// Seconds since the first picture.
        seconds: f64,
        /// Counts so far.
        counts: Box<Counts>,
    },
    /// A damaged part of the recording was skipped.
    DamagedPart(Box<SessionError>),
    /// No camera has delivered a picture for a while.
    Idle(Box<Counts>),
    /// The recording has ended; another loop may follow.
    End(Box<Counts>),
    /// The recording has ended and is no longer repeated.
    Pause,
}

/// Inputs that change while the preparation runs.
pub(super) struct PreparationInputs {
    /// Settings requested by the dashboard.
    pub requested: watch::Receiver<Settings>,
    /// Playback requested by the dashboard.
    pub playback: watch::Receiver<Playback>,
    /// Changes of the scene.
    pub scene_updates: SceneUpdates,
    /// Time from a picture's arrival to the window.
    pub display_latency: Arc<DisplayLatency>,
}

/// Handle of the preparation thread. Dropping it ends the thread.
pub struct Preparation {
    steps: Option<Receiver<PreparationEvent>>,
    /// Requests the next step; a live rig prepares only on request.
    requests: Option<Sender<()>>,
    recycled: Sender<Picture>,
    thread: Option<JoinHandle<()>>,
}

impl Preparation {
    /// Starts with the first frame. `stop` interrupts the wait for a recorded frame's time.
    ///
    /// # Errors
    /// The light estimator cannot be created, or the system cannot start a thread.
    pub fn start(
        setup: &RigSetup,
        config: &Config,
        source: &Source,
        requested: watch::Receiver<Settings>,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, RigError> {
        let playback = Playback {
            repeat: config.replay.repeat,
            ..Playback::default()
        };
        let inputs = PreparationInputs {
            requested,
            playback: watch::Sender::new(playback).subscribe(),
            scene_updates: SceneUpdates::default(),
            display_latency: Arc::default(),
        };
        Self::start_with(setup, config, source, inputs, stop)
    }

    /// As [`Self::start`], with scene updates and the measured display latency.
    pub(super) fn start_with(
        setup: &RigSetup,
        config: &Config,
        source: &Source,
        inputs: PreparationInputs,
        stop: Arc<AtomicBool>,
    ) -> Result<Self, RigError> {
        let PreparationInputs {
            requested,
            playback,
            scene_updates,
            display_latency,
        } = inputs;
        let as_live = pairs_as_live(config, source);
        let pairing = pairing(config, setup, as_live);
        let ahead = if source.is_live() {
            0
        } else {
            MAX_FRAMES_AHEAD
        };
        let (step_sender, steps) = bounded(ahead);
        let (recycled, recycled_pictures) = bounded(MAX_RECYCLED);
        let (requests, request_receiver) = bounded(1);
        let registration = &config.registration;
        let centre = crate::registration::scene_centre(&setup.scene, setup.tags.as_ref());
        let mut worker = Worker {
            display: (registration.predict == Predict::Display).then(|| {
                let latency = source.is_live().then_some(display_latency);
                DisplayPredictor::new(setup, config, centre, latency)
            }),
            steadying: PoseSteadying::new(setup, centre, scene_updates.clone()),
            lights: light_scheduler(setup, config, source, requested, scene_updates)?,
            feed: Feed::new(source, &setup.calibration, pairing, as_live),
            latency: LatencyMonitor::start(setup, config, source, pairing.station)?,
            journal: Journal::new(source),
            tags: TagRegistration::new(
                setup,
                registration.row_seconds,
                LensRefiner::start(setup, config, source)?,
            ),
            lens: lens_status(setup, source),
            row_seconds: registration.row_seconds,
            look: config.look,
            last_pose: None,
            centre,
            setup: setup.clone(),
            pairing,
            yuv: config.input.encoding(),
            // An output folder receives every frame of the recording.
            pace: (!source.is_live())
                .then(|| Pace::new(config.replay.speed, config.output.writes_all())),
            transport: Transport::new(playback, source, !config.replay.repeat),
            steps: step_sender,
            requests: source.is_live().then_some(request_receiver),
            recycled: recycled_pictures,
            stop,
            first_captured_at: None,
            held: HeldFrames::default(),
            release: Release::new(config, source),
        };
        let thread = threads::spawn("prepare", move || worker.run())
            .map_err(|source| RigError::Thread { source })?;
        Ok(Self {
            steps: Some(steps),
            requests: Some(requests),
            recycled,
            thread: Some(thread),
        })
    }

    /// Waits for the next step; `None` after the last.
    pub fn next(&self) -> Option<PreparationEvent> {
        if let Some(requests) = &self.requests {
            // Fails if a request is pending or the thread has ended.
            let _ = requests.try_send(());
        }
        self.steps.as_ref()?.recv().ok()
    }

    /// Returns a picture's buffer for reuse.
    pub fn give_back(&self, picture: Picture) {
        // If enough buffers wait for reuse, this one is dropped.
        let _ = self.recycled.try_send(picture);
    }
}

impl Drop for Preparation {
    fn drop(&mut self) {
        self.steps = None;
        self.requests = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Worker {
    setup: RigSetup,
    /// Registration by fiducials, if the rig uses them.
    tags: Option<TagRegistration>,
    /// Steadies the tracker's pose, if it is the rig's.
    steadying: Option<PoseSteadying>,
    /// Status of a lens that is not being refined.
    lens: LensStatus,
    /// Predicts the pose at the instant of display, if configured.
    display: Option<DisplayPredictor>,
    /// Centre of the virtual objects, world, metres.
    centre: DVec3,
    /// Readout time from one row of the scene camera to the next, seconds.
    row_seconds: f64,
    /// The camera's look on virtual objects.
    look: LookConfig,
    /// Time and pose of the previous picture, for the camera's motion.
    last_pose: Option<(MonotonicTime, RigidTransform)>,
    lights: LightScheduler,
    feed: Feed,
    /// Measures the tracker's latency, if configured.
    latency: Option<LatencyMonitor>,
    journal: Journal,
    pairing: PairingConfig,
    yuv: YuvEncoding,
    /// Paces a recording; `None` for live devices.
    pace: Option<Pace>,
    transport: Transport,
    steps: Sender<PreparationEvent>,
    /// Requests of the compositor: a live picture is chosen only when the compositor is free, so
    /// that it is the newest one.
    requests: Option<Receiver<()>>,
    recycled: Receiver<Picture>,
    stop: Arc<AtomicBool>,
    first_captured_at: Option<MonotonicTime>,
    /// Frames that wait for the light of their instant.
    held: HeldFrames,
    release: Release,
}

impl Worker {
    /// Prepares frames until the source ends or [`Preparation`] is dropped.
    fn run(&mut self) {
        self.restart();
        loop {
            if !self.run_once() {
                return;
            }
            if !(self.transport.wants_jump() || self.release(true)) {
                return;
            }
            if self.transport.wants_jump() {
                self.rewind();
                self.transport.jump();
                continue;
            }
            let skipped = self.release.take_skipped();
            if skipped > 0 && !self.send(PreparationEvent::Skipped(skipped)) {
                return;
            }
            let counts = self.counts(true);
            let is_dropped = self
                .steps
                .send(PreparationEvent::End(Box::new(counts)))
                .is_err();
            if is_dropped || counts.feed.scene_frames == 0 || !self.goes_on() {
                return;
            }
            self.rewind();
            if !self.transport.wants_jump() {
                self.first_captured_at = None;
            }
        }
    }

    /// Waits at the end of a recording that is no longer repeated; false if the run ends.
    fn goes_on(&mut self) -> bool {
        let mut has_paused = false;
        self.follow_pauses();
        loop {
            match self.transport.at_end() {
                AtEnd::Repeat => return true,
                AtEnd::End => return false,
                AtEnd::Wait if !has_paused => has_paused = self.send(PreparationEvent::Pause),
                AtEnd::Wait if self.transport.has_resumed() => return true,
                AtEnd::Wait => (),
            }
            if self.stop.load(Ordering::Relaxed) {
                return false;
            }
            std::thread::sleep(END_INTERVAL);
        }
    }

    /// Reads the recording from its beginning.
    fn rewind(&mut self) {
        self.feed.rewind(self.pairing);
        if let Some(latency) = &mut self.latency {
            latency.restart();
        }
        self.restart();
    }

    /// Forgets the frames before.
    fn restart(&mut self) {
        self.held = HeldFrames::default();
        self.last_pose = None;
        if let Some(steadying) = &mut self.steadying {
            steadying.restart();
        }
        self.release.restart();
        self.lights.restart();
        if let Some(pace) = &mut self.pace {
            pace.restart();
        }
    }

    /// Restarts the pace after a pause.
    fn follow_pauses(&mut self) {
        if self.transport.has_resumed()
            && let Some(pace) = &mut self.pace
        {
            pace.restart();
        }
    }

    /// Prepares frames until the source ends or a jump is requested; false if nobody takes them any
    /// more.
    fn run_once(&mut self) -> bool {
        loop {
            if self.transport.wants_jump() {
                return true;
            }
            self.follow_pauses();
            let request = self.requests.as_ref().map(Receiver::recv);
            if request.is_some_and(|request| request.is_err()) {
                return false;
            }
            let next = self.feed.next_picture(self.latency.as_mut());
            for error in self.feed.take_damage() {
                if !self.send(PreparationEvent::DamagedPart(Box::new(error))) {
                    return false;
                }
            }
            let event = match next {
                Next::Item(frame) if self.transport.passes(frame.frame.scene.arrived_at) => {
                    continue;
                }
                Next::Item(frame) => self.step(*frame),
                Next::Idle => PreparationEvent::Idle(Box::new(self.counts(false))),
                Next::Ended => return true,
            };
            let goes_on = match event {
                PreparationEvent::Frame(frame) => {
                    self.held.push(frame);
                    self.release(false)
                }
                PreparationEvent::Skipped(count) => {
                    self.release.skip(count);
                    true
                }
                event => self.send(event),
            };
            if !goes_on {
                return false;
            }
        }
    }

    /// Sends the frames whose light is known, or `all`, at their time; false if nobody takes them
    /// any more.
    fn release(&mut self, all: bool) -> bool {
        while self
            .release
            .may_go(all, &self.held, &mut self.lights, self.pace.as_mut())
            && let Some(mut frame) = self.held.pop()
        {
            if self.transport.wants_jump() {
                return true;
            }
            self.follow_pauses();
            let captured_at = frame.frame.captured_at;
            self.lights.show(captured_at);
            let arrived_at = frame.frame.scene.arrived_at;
            let lights = &mut self.lights;
            let is_due = |pace: &mut Pace| pace.wait(arrived_at, &self.stop, || lights.poll());
            if !self.pace.as_mut().is_none_or(is_due) {
                self.release.skip(1);
                continue;
            }
            frame.light = self.lights.light_at(captured_at);
            frame.coming_light = self.release.coming_light(&mut self.lights, captured_at);
            self.release.mark(&mut frame);
            if !self.send(PreparationEvent::Frame(frame)) {
                return false;
            }
        }
        true
    }

    /// Sends an event; false if nobody takes it any more. Light is estimated also while the compositor
    /// is busy.
    fn send(&mut self, mut event: PreparationEvent) -> bool {
        while !self.stop.load(Ordering::Relaxed) {
            match self.steps.send_timeout(event, POLL_INTERVAL) {
                Ok(()) => return true,
                Err(SendTimeoutError::Timeout(refused)) => event = refused,
                Err(SendTimeoutError::Disconnected(_)) => return false,
            }
            self.lights.poll();
        }
        false
    }

    /// Returns the counts so far; `is_over` at the end of a recording.
    fn counts(&mut self, is_over: bool) -> Counts {
        let active_nanos = self.feed.tracker_latency();
        Counts {
            feed: self.feed.counts(),
            pairing: self.feed.pairing_counts(),
            skipped_tracker_bytes: self.feed.tracker_counters().skipped_bytes,
            lost_readings: self.feed.lost_readings(),
            latency: match &mut self.latency {
                Some(monitor) => monitor.state(active_nanos, is_over),
                None => LatencyState {
                    active_nanos,
                    measurement: None,
                },
            },
        }
    }

    fn step(&mut self, journaled: JournaledFrame) -> PreparationEvent {
        let (frame, skipped, entry) = (journaled.frame, journaled.skipped, journaled.entry);
        let first = *self.first_captured_at.get_or_insert(frame.captured_at);
        if self.is_late(&frame) {
            return PreparationEvent::Skipped(1);
        }
        let begun = Instant::now();
        let seconds = frame.captured_at.seconds_since(first);
        let (picture, mismatch) = match self.fitting_picture(&frame, seconds) {
            Ok(fitting) => fitting,
            Err(damaged) => return damaged,
        };
        let decoding = begun.elapsed();
        let fits = mismatch.is_none();
        let tracked = self.setup.world_from_camera(&frame).filter(|_| fits);
        let (world_from_camera, sphere, mut registration) =
            self.register(&picture, (&frame, entry), tracked, fits);
        let (setup, tracker) = (&self.setup, self.feed.tracker());
        let display = self.display.as_mut().and_then(|predictor| {
            predictor.predict(setup, tracker, &frame, world_from_camera, &registration)
        });
        registration.display = display.map(|prediction| prediction.status);
        let (rolling_shutter, exposure_motion) = self.motions(&frame, world_from_camera);
        let tracker_sigma = self.tracker_sigma(&frame, world_from_camera);
        let request = LightRequest {
            sphere,
            ..LightRequest::new(&frame, seconds, world_from_camera, self.camera())
        };
        if let Some(record) = self.lights.schedule(&request, &picture, entry) {
            self.journal.write(request.arrived_at, record);
        }
        let counts = self.counts(false);
        let (camera, lens) = (self.camera().clone(), self.lens_status());
        let environments_left_out = self.lights.left_out();
        let light = self.lights.active_light();
        PreparationEvent::Frame(Box::new(PreparedFrame {
            index: frame.index,
            seconds,
            camera,
            lens,
            levels: levels(&picture),
            picture,
            world_from_camera,
            registration,
            rolling_shutter,
            exposure_motion,
            display,
            tracker_sigma,
            light: LightState::default(),
            coming_light: None,
            is_start: false,
            decoding,
            environments_left_out,
            lighting: light.took,
            preview: light.preview.take(),
            warning: mismatch.or(light.picture_error.take()),
            skipped,
            jumps: self.transport.jumps(),
            counts,
            frame,
        }))
    }

    /// Decodes the scene camera's picture; returns it with a warning if it has not the calibrated size.
    /// A live one is then stretched: preparing for another size would stop the picture, twice if only
    /// some pictures have it.
    ///
    /// # Errors
    /// The picture is damaged.
    fn fitting_picture(
        &mut self,
        frame: &RigFrame,
        seconds: f64,
    ) -> Result<(Picture, Option<String>), PreparationEvent> {
        let picture = self
            .decode(frame)
            .map_err(|error| PreparationEvent::Damaged {
                error,
                seconds,
                counts: Box::new(self.counts(false)),
            })?;
        let mismatch = self.size_mismatch(&picture);
        if mismatch.is_none() || self.pace.is_some() {
            return Ok((picture, mismatch));
        }
        let camera = &self.setup.calibration.scene_camera.camera;
        let stretched = picture.stretched((camera.width, camera.height));
        Ok((stretched, mismatch))
    }

    /// Decodes the scene camera's picture.
    fn decode(&self, frame: &RigFrame) -> Result<Picture, PictureError> {
        let mut picture = self.recycled.try_recv().unwrap_or_default();
        let max_pixels = self.setup.max_scene_pixels();
        decode_within(max_pixels, &frame.scene, &self.yuv, &mut picture)?;
        Ok(picture)
    }

    /// Returns the camera of the last picture: the calibrated one, or the one that its lens has been
    /// refined to.
    fn camera(&self) -> &PinholeCamera {
        let calibrated = &self.setup.calibration.scene_camera.camera;
        self.tags
            .as_ref()
            .map_or(calibrated, TagRegistration::camera)
    }

    fn lens_status(&self) -> LensStatus {
        let refined = self.tags.as_ref().and_then(TagRegistration::lens_status);
        refined.unwrap_or_else(|| self.lens.clone())
    }

    /// Returns whether a frame would be skipped because it is late.
    fn is_late(&self, frame: &RigFrame) -> bool {
        let is_late = |pace: &Pace| pace.is_late(frame.scene.arrived_at);
        self.pace.as_ref().is_some_and(is_late)
    }

    /// Registers a picture by fiducials if the rig uses them, otherwise by the tracker's pose
    /// `tracked`. `fits`: the picture has the calibrated size.
    fn register(
        &mut self,
        picture: &Picture,
        (frame, entry): (&RigFrame, JournalEntry),
        tracked: Option<RigidTransform>,
        fits: bool,
    ) -> (Option<RigidTransform>, SphereAt, RegistrationStatus) {
        let motion = self.tracked_motion(frame);
        let tracked = tracked.map(|world_from_camera| TrackerPose {
            world_from_camera,
            noise: self.setup.tracker_noise(frame).unwrap_or(TRACKER_NOISE),
        });
        let steadied = tracked.and_then(|pose| self.steady(picture, (frame, entry), pose, motion));
        let tracked = tracked.map(|pose| TrackerPose {
            world_from_camera: steadied.map_or(pose.world_from_camera, |s| s.world_from_camera),
            ..pose
        });
        let Some(tags) = self.tags.as_mut().filter(|_| fits) else {
            if fits {
                self.observe_picture(frame.captured_at, picture, None);
            }
            let pose = tracked.map(|t| t.world_from_camera);
            let status = with_steadying(self.untagged(pose), steadied);
            return (pose, SphereAt::Calibrated, status);
        };
        let tracker = TrackerEstimate {
            pose: tracked,
            motion,
        };
        let result = tags.register(picture, tracker, frame.captured_at);
        self.observe_picture(frame.captured_at, picture, result.by_markers);
        let sphere = match result.sphere {
            Some(sphere) => SphereAt::Seen(sphere),
            None if result.is_sphere_lost => SphereAt::Lost,
            None => SphereAt::Calibrated,
        };
        let status = match self.setup.pose {
            PoseSource::Fixed => self.untagged(tracked.map(|t| t.world_from_camera)),
            _ => result.status,
        };
        let status = with_steadying(status, steadied);
        (result.world_from_camera, sphere, status)
    }

    /// Steadies the tracker's pose by the picture if it is the rig's.
    fn steady(
        &mut self,
        picture: &Picture,
        (frame, entry): (&RigFrame, JournalEntry),
        tracked: TrackerPose,
        motion: Option<RollingShutter>,
    ) -> Option<SteadiedPose> {
        let calibrated = &self.setup.calibration.scene_camera.camera;
        let camera = self
            .tags
            .as_ref()
            .map_or(calibrated, TagRegistration::camera);
        let steadying = self.steadying.as_mut()?;
        let at = (frame.captured_at, entry == JournalEntry::Skipped);
        Some(steadying.steady((picture, camera), at, tracked, motion))
    }

    /// Returns the status of a pose in which no markers had a part.
    fn untagged(&self, pose: Option<RigidTransform>) -> RegistrationStatus {
        match self.setup.pose {
            PoseSource::Fixed if pose.is_some() => RegistrationStatus::fixed(),
            _ => RegistrationStatus::by_tracker(pose.is_some()),
        }
    }

    /// Passes a picture to the latency monitor.
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

    /// Returns the camera's motion during the readout, if it has a rolling shutter, and during the
    /// exposure of a row.
    fn motions(
        &mut self,
        frame: &RigFrame,
        pose: Option<RigidTransform>,
    ) -> (Option<RollingShutter>, Option<ExposureMotion>) {
        let motion = self.camera_motion(frame, pose);
        let rolling_shutter = motion.and_then(|(before, after, seconds)| {
            RollingShutter::between(&before, &after, seconds, self.row_seconds)
        });
        (rolling_shutter, self.exposure_motion(frame, motion))
    }

    /// Returns the camera's motion around the picture's instant: poses before and after, and the
    /// seconds between them. By the tracker, else from the previous picture's pose; `None` if
    /// nothing depends on it.
    fn camera_motion(&mut self, frame: &RigFrame, pose: Option<RigidTransform>) -> Option<Motion> {
        if self.pairing.motion_nanos == 0 {
            return None;
        }
        let last = std::mem::replace(&mut self.last_pose, pose.map(|p| (frame.captured_at, p)));
        if let Some(motion) = self.tracker_motion(frame) {
            return Some(motion);
        }
        let (last_captured_at, before) = last?;
        let seconds = frame.captured_at.seconds_since(last_captured_at);
        let is_recent = (1e-3..MAX_PICTURE_INTERVAL).contains(&seconds);
        is_recent.then(|| Some((before, pose?, seconds)))?
    }

    /// Returns the camera's motion around the picture's instant, by the tracker.
    fn tracker_motion(&self, frame: &RigFrame) -> Option<Motion> {
        let (before, after, seconds) = frame.motion?;
        let tracker = self.setup.calibration.tracker.as_ref()?;
        let [before, after] = [before, after].map(|p| tracker.world_from_scene_camera(p));
        Some((before, after, seconds))
    }

    /// Returns the camera's motion during the readout, by the tracker.
    fn tracked_motion(&self, frame: &RigFrame) -> Option<RollingShutter> {
        let (before, after, seconds) = self.tracker_motion(frame)?;
        RollingShutter::between(&before, &after, seconds, self.row_seconds)
    }

    /// Returns the camera's motion during the exposure of a row; `None` if the exposure time is not
    /// known, or if motion does not blur.
    fn exposure_motion(&self, frame: &RigFrame, motion: Option<Motion>) -> Option<ExposureMotion> {
        let reported = frame.scene.exposure.map(|e| e.exposure_micros * 1e-6);
        let exposure = self.look.exposure_seconds.or(reported);
        let exposure =
            exposure.filter(|s| self.look.motion_blur && EXPOSURE_SECONDS.contains(s))?;
        Some(match motion {
            Some((before, after, seconds)) => {
                ExposureMotion::between(&before, &after, seconds, exposure)
            }
            None => ExposureMotion::at_rest(exposure),
        })
    }

    /// Returns the value of [`PreparedFrame::tracker_sigma`].
    fn tracker_sigma(&self, frame: &RigFrame, pose: Option<RigidTransform>) -> Option<[f64; 3]> {
        let [metres, radians] = self.setup.tracker_noise(frame)?;
        let camera = &self.setup.calibration.scene_camera.camera;
        let z = pose?.inverse().transform_point(self.centre).z.abs();
        let pixels = camera.focal.x * (metres / z.clamp(0.1, 10.0)).hypot(radians);
        let all_axes = 3.0_f64.sqrt();
        Some([
            1e3 * metres * all_axes,
            radians.to_degrees() * all_axes,
            pixels,
        ])
    }

    /// Returns a warning if the picture's size differs from the calibrated size. Such a picture is
    /// shown without virtual objects, because they cannot be aligned with it; a live one is stretched.
    fn size_mismatch(&self, picture: &Picture) -> Option<String> {
        let camera = &self.setup.calibration.scene_camera.camera;
        let fits = (picture.width, picture.height) == (camera.width, camera.height);
        (!fits && self.setup.calibrated).then(|| {
            format!(
                "the scene camera's pictures have {}x{} pixels, but it was calibrated at {}x{}; set \
                 its width and height, or recalibrate",
                picture.width, picture.height, camera.width, camera.height
            )
        })
    }
}

/// Adds what the picture has added to the tracker's pose.
fn with_steadying(
    status: RegistrationStatus,
    steadied: Option<SteadiedPose>,
) -> RegistrationStatus {
    let by_picture = steadied.filter(|s| s.landmarks > 0);
    RegistrationStatus {
        landmarks: by_picture.map_or(0, |s| s.landmarks as u32),
        landmarks_px: by_picture.map(|s| s.residual_pixels),
        ..status
    }
}

/// Creates the light scheduler for a live rig, its replay, or a recording without a journal.
fn light_scheduler(
    setup: &RigSetup,
    config: &Config,
    source: &Source,
    requested: watch::Receiver<Settings>,
    scene_updates: SceneUpdates,
) -> Result<LightScheduler, RigError> {
    let estimator = LightEstimator::new(setup, config, &|name| source.attachment(name))?;
    let technique = crate::live_settings(config).technique;
    let frequency = config.planes.frequency;
    let updater = LightUpdater::new(estimator, requested, technique, frequency, scene_updates);
    match source {
        Source::Live(_) => LightScheduler::live(updater),
        Source::Recorded(_) if is_paced(config) => LightScheduler::watched(updater),
        Source::Recorded(_) if pairs_as_live(config, source) => {
            Ok(LightScheduler::from_journal(updater))
        }
        Source::Recorded(_) => Ok(LightScheduler::per_frame(updater)),
    }
}

/// Returns whether a recording is played at its own rate, and not all of it is written to files.
pub(super) fn is_paced(config: &Config) -> bool {
    config.replay.speed != ReplaySpeed::Max && !config.output.writes_all()
}

/// Returns whether pictures are paired as in a live rig, with its limited wait for the tracker.
fn pairs_as_live(config: &Config, source: &Source) -> bool {
    match (source, config.replay.pairing) {
        (Source::Live(_), _) | (_, ReplayPairing::Live) => true,
        (Source::Recorded(_), ReplayPairing::Complete) => false,
        (Source::Recorded(session), ReplayPairing::Auto) => session.has_journal(),
    }
}

/// Returns the pairing configuration; `as_live` limits the wait for the tracker.
fn pairing(config: &Config, setup: &RigSetup, as_live: bool) -> PairingConfig {
    let mut pairing = pairing_config(&setup.calibration);
    pairing.history.max_prediction_nanos = config.sync.max_prediction_nanos;
    pairing.history.smoothing = config.sync.smoothing();
    if config.registration.row_seconds != 0.0 || config.look.motion_blur {
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
