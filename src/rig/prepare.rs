//! Makes frames ready for the compositor, one ahead of it, on a thread of its own: bytes
//! become pictures, environment pictures become light. The way through is the same whoever
//! waits for it, so the same recording gives the same pictures.

use super::feed::{Fed, FedFrame, Feed, FeedCounts};
use super::light::{LightStation, SceneView, placement};
use super::pace::Pace;
use super::source::Source;
use super::{RigError, RigSetup, threads};
use crate::calibration::photometry::MatchStatus;
use crate::capture::TrackerSource;
use crate::config::{Config, LightPlacement, ReplayPairing};
use crate::environment::adaptive::CompactSource;
use crate::environment::{LightKind, Lighting, cube};
use crate::picture::{Picture, YuvEncoding, decode_into};
use crate::scene::NearLight;
use crate::status::{LightsMode, Settings, Technique, environment_preview};
use crate::sync::{PairingConfig, PairingCounts, RigFrame};
use crossbeam_channel::{Receiver, Sender, bounded};
use penumbra_interface::{MonotonicTime, RigidTransform};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Frames that may wait for the compositor.
const AHEAD: usize = 1;
/// Rows of the environment's preview.
const PREVIEW_ROWS: u32 = 128;
/// Time between two previews.
const PREVIEW_EVERY: Duration = Duration::from_secs(1);

/// One frame with everything that it is made of.
pub struct Prepared {
    /// Number of its picture in the recording.
    pub index: u64,
    /// What was paired. Its picture's bytes are decoded already.
    pub frame: RigFrame,
    /// The scene camera's picture.
    pub picture: Picture,
    /// The scene camera's pose.
    pub world_from_camera: Option<RigidTransform>,
    /// Seconds since the recording's first picture.
    pub seconds: f64,
    /// The light, and what is known of it.
    pub light: LightState,
    /// How long decoding took.
    pub decoding: Duration,
    /// How long the light took.
    pub lighting: Duration,
    /// A new preview of the environment.
    pub preview: Option<Arc<Picture>>,
    /// What is wrong with the environment's picture.
    pub warning: Option<String>,
    /// What came in so far during this pass.
    pub counts: Counts,
    /// Pictures that a live rig passed over for this one.
    pub passed_over: u64,
}

/// The light in force and how it was found. Shared: it changes less often than frames.
#[derive(Clone, Default)]
pub struct LightState {
    /// The light far away.
    pub lighting: Option<Arc<Lighting>>,
    /// The light close by.
    pub near: Option<Arc<NearLight>>,
    /// The match between the cameras.
    pub white_balance: Option<Arc<MatchStatus>>,
    /// Compact sources found.
    pub sources: Arc<Vec<CompactSource>>,
    /// Share of the sphere that every exposure clips.
    pub clipped: f32,
}

impl LightState {
    /// Dome lights, and those of compact sources among them.
    #[must_use]
    pub fn count(&self) -> (u32, u32) {
        let lights = self.lighting.as_ref().map_or(&[][..], |l| &l.lights);
        let compact = lights.iter().filter(|l| l.kind == LightKind::Compact);
        (lights.len() as u32, compact.count() as u32)
    }
}

/// What comes next.
pub enum Step {
    /// A frame.
    Frame(Box<Prepared>),
    /// It was too late for one.
    Skipped,
    /// A picture that cannot be decoded.
    Damaged,
    /// No device has sent a picture for a while.
    Idle(Box<Counts>),
    /// The recording is over; another loop may follow.
    End(Box<Counts>),
}

/// What came in.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// By the feed.
    pub feed: FeedCounts,
    /// By the pairing.
    pub pairing: PairingCounts,
    /// Tracker bytes that belonged to no record.
    pub skipped_tracker_bytes: u64,
}

/// The thread, and the way to it. Dropping it ends the thread.
pub struct Preparation {
    steps: Option<Receiver<Step>>,
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
        let as_live = as_live(config, source);
        let pairing = pairing(config, setup, as_live);
        // A live picture must not grow old behind another one.
        let ahead = if source.is_live() { 0 } else { AHEAD };
        let (steps_in, steps) = bounded(ahead);
        let (spare, spares) = bounded(AHEAD + 2);
        let mut worker = Worker {
            light: LightStation::new(setup, config, &|name| source.attachment(name))?,
            feed: Feed::new(source, &setup.calibration, pairing, as_live),
            setup: setup.clone(),
            pairing,
            yuv: config.input.encoding(),
            frequency: config.planes.frequency,
            // Files hold every frame of the recording.
            pace: (!source.is_live())
                .then(|| Pace::new(config.replay.speed, config.output.frames.is_some())),
            repeat: config.replay.repeat && !source.is_live(),
            wished,
            steps: steps_in,
            spares,
            stop,
            state: LightState::default(),
            later: as_live.then(Later::default),
            previewed: None,
            began: None,
        };
        let technique = super::live_settings(config).technique;
        worker.light.set_faces(worker.faces_of(technique));
        let thread = threads::spawn("prepare", move || worker.run())
            .map_err(|source| RigError::Thread { source })?;
        Ok(Self {
            steps: Some(steps),
            spare,
            thread: Some(thread),
        })
    }

    /// Waits for the next step; `None` after the last.
    pub fn next(&self) -> Option<Step> {
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
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Worker {
    setup: RigSetup,
    light: LightStation,
    feed: Feed,
    pairing: PairingConfig,
    yuv: YuvEncoding,
    /// Of the geodesic dome, where planes are the technique.
    frequency: u32,
    /// Devices have a pace of their own.
    pace: Option<Pace>,
    repeat: bool,
    wished: watch::Receiver<Settings>,
    steps: Sender<Step>,
    spares: Receiver<Picture>,
    stop: Arc<AtomicBool>,
    state: LightState,
    /// A live picture does not wait for its own light: it takes that of the picture before
    /// it, and its own is worked out while it is drawn. A replay of it does the same.
    later: Option<Later>,
    previewed: Option<Instant>,
    began: Option<MonotonicTime>,
}

/// A picture whose light is still to be worked out.
#[derive(Default)]
struct Later {
    frame: Option<RigFrame>,
    picture: Picture,
    world_from_camera: Option<RigidTransform>,
    /// How long that took last.
    took: Duration,
    /// What was wrong with it.
    unseen: Option<String>,
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
                let step = match self.feed.next_picture() {
                    Fed::Frame(fed) => self.step(*fed),
                    Fed::Idle => Step::Idle(Box::new(self.counts())),
                    Fed::End => break,
                };
                if self.stop.load(Ordering::Relaxed) || self.steps.send(step).is_err() {
                    return;
                }
                self.see_later();
            }
            let counts = self.counts();
            let over = self.steps.send(Step::End(Box::new(counts))).is_err();
            if over || !self.repeat || counts.feed.scene_frames == 0 {
                return;
            }
            self.feed.rewind(self.pairing);
        }
    }

    fn counts(&self) -> Counts {
        Counts {
            feed: self.feed.counts(),
            pairing: self.feed.pairing_counts(),
            skipped_tracker_bytes: self.feed.tracker_counters().skipped_bytes,
        }
    }

    fn step(&mut self, fed: FedFrame) -> Step {
        let FedFrame {
            frame,
            passed_over,
            lit,
        } = fed;
        let first = *self.began.get_or_insert(frame.captured_at);
        if let Some(pace) = &mut self.pace
            && !pace.wait(frame.scene.arrived_at, &self.stop)
        {
            return Step::Skipped;
        }
        let begun = Instant::now();
        let mut picture = self.spares.try_recv().unwrap_or_default();
        if decode_into(&frame.scene, &self.yuv, &mut picture).is_err() {
            return Step::Damaged;
        }
        let decoding = begun.elapsed();
        let misfit = self.misfit(&picture);
        let world_from_camera = self
            .setup
            .world_from_camera(&frame)
            .filter(|_| misfit.is_none());
        self.take_settings();
        let (lighting, unseen) = if lit {
            self.light_for(&frame, &picture, world_from_camera)
        } else {
            (Duration::ZERO, None)
        };
        Step::Frame(Box::new(Prepared {
            index: frame.index,
            seconds: frame.captured_at.seconds_since(first),
            picture,
            world_from_camera,
            light: self.state.clone(),
            decoding,
            lighting,
            preview: self.preview(),
            warning: misfit.or(unseen),
            passed_over,
            counts: self.counts(),
            frame,
        }))
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

    /// Sees to the light of a picture, now or after it was handed over; how long that took,
    /// or took for the picture before, and what was wrong.
    fn light_for(
        &mut self,
        frame: &RigFrame,
        picture: &Picture,
        world_from_camera: Option<RigidTransform>,
    ) -> (Duration, Option<String>) {
        // Without any light there is nothing to show meanwhile.
        if self.state.lighting.is_some()
            && let Some(later) = &mut self.later
        {
            later.frame = Some(frame.clone());
            later.picture.copy_from(picture);
            later.world_from_camera = world_from_camera;
            return (later.took, later.unseen.take());
        }
        let begun = Instant::now();
        let unseen = self.see(frame, picture, world_from_camera);
        (begun.elapsed(), unseen)
    }

    /// Works out the light that [`Self::light_for`] put off.
    fn see_later(&mut self) {
        let Some(mut later) = self.later.take() else {
            return;
        };
        if let Some(frame) = later.frame.take() {
            let begun = Instant::now();
            later.unseen = self.see(&frame, &later.picture, later.world_from_camera);
            later.took = begun.elapsed();
        }
        self.later = Some(later);
    }

    /// Updates the light. An environment picture that cannot be read leaves it as it was.
    fn see(
        &mut self,
        frame: &RigFrame,
        picture: &Picture,
        world_from_camera: Option<RigidTransform>,
    ) -> Option<String> {
        let view = SceneView {
            picture,
            world_from_camera,
            captured_at: frame.captured_at,
            exposure: frame.scene.exposure,
        };
        let set = frame.environment.as_ref().map(|e| e.set.as_ref());
        let result = self.light.update(set, &view);
        let lighting = self.light.lighting();
        let generation = |l: Option<&Arc<Lighting>>| l.map(|l| l.generation);
        if generation(lighting) != generation(self.state.lighting.as_ref()) {
            self.state = self.light.state();
        }
        result.err().map(|error| error.to_string())
    }

    fn take_settings(&mut self) {
        if !self.wished.has_changed().unwrap_or(false) {
            return;
        }
        let settings = self.wished.borrow_and_update().clone();
        let lights = match settings.lights_mode {
            LightsMode::Adaptive => LightPlacement::Adaptive,
            LightsMode::Grid => LightPlacement::Grid,
        };
        self.light
            .set_lights(placement(lights), settings.light_count as usize);
        self.light.set_faces(self.faces_of(settings.technique));
    }

    /// Frequency of the dome whose faces shadowing planes want lit.
    fn faces_of(&self, technique: Technique) -> Option<u32> {
        (technique == Technique::ShadowingPlanes).then_some(self.frequency)
    }

    /// A new preview, now and then.
    fn preview(&mut self) -> Option<Arc<Picture>> {
        let lighting = self.state.lighting.as_ref()?;
        if self
            .previewed
            .is_some_and(|at| at.elapsed() < PREVIEW_EVERY)
        {
            return None;
        }
        self.previewed = Some(Instant::now());
        let radiance = |d| cube::sample(&lighting.radiance, 0, d);
        let picture = environment_preview(PREVIEW_ROWS, radiance, &lighting.lights);
        Some(Arc::new(picture))
    }
}

/// Whether pictures wait as in a live rig.
fn as_live(config: &Config, source: &Source) -> bool {
    match (source, config.replay.pairing) {
        (Source::Live(_), _) | (_, ReplayPairing::Live) => true,
        (Source::Recorded(_), ReplayPairing::Whole) => false,
        (Source::Recorded(session), ReplayPairing::Auto) => session.has_journal(),
    }
}

fn pairing(config: &Config, setup: &RigSetup, as_live: bool) -> PairingConfig {
    let mut pairing = PairingConfig::for_rig(&setup.calibration);
    pairing.history.max_prediction_nanos = config.sync.longest_prediction_nanos;
    pairing.history.smoothing = config.sync.smoothing();
    if let (Some(station), Some(TrackerSource::System(tracker))) =
        (&mut pairing.station, &config.tracker)
    {
        *station = tracker.station;
    }
    if as_live {
        pairing.max_wait_nanos = config.sync.longest_wait_nanos;
        return pairing;
    }
    pairing.with_full_windows()
}
