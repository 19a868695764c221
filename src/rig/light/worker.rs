//! Estimates light from a picture of the scene camera and the environment pictures paired with
//! it: [`LightUpdater`] on the calling thread, [`LightWorker`] on its own thread.

use crate::error::RigError;
use crate::light::state::{ActiveLight, LightRequest, LightResult};
use crate::light::updates::SceneUpdates;
use crate::light::{estimator::LightEstimator, view::SceneView};
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::Quat;
use penumbra_config::Technique;
use penumbra_interface::threads;
use penumbra_lighting::{Lighting, cube};
use penumbra_picture::Picture;
use penumbra_session::LightRecord;
use penumbra_status::{Settings, environment_preview};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::sync::watch;

/// Height of the environment preview, pixels.
const PREVIEW_ROWS: u32 = 128;
/// Time between two previews.
const PREVIEW_EVERY: Duration = Duration::from_secs(1);

/// Estimates light with the settings and the scene that were requested last.
pub(crate) struct LightUpdater {
    light: LightEstimator,
    wished: watch::Receiver<Settings>,
    /// Frequency of the geodesic dome, for the technique of shadowing planes.
    frequency: u32,
    technique: Technique,
    news: SceneUpdates,
    turn: Quat,
    generation: Option<u64>,
    previewed: Option<Instant>,
}

impl LightUpdater {
    /// Creates an updater. `technique` is the initial technique, `frequency` that of the geodesic
    /// dome.
    pub fn new(
        light: LightEstimator,
        wished: watch::Receiver<Settings>,
        technique: Technique,
        frequency: u32,
        news: SceneUpdates,
    ) -> Self {
        let mut lighter = Self {
            light,
            wished,
            frequency,
            technique,
            news,
            turn: Quat::IDENTITY,
            generation: None,
            previewed: None,
        };
        lighter.choose();
        lighter
    }

    /// Estimates the light of a picture. If an environment picture cannot be read, the light stays
    /// as it was.
    pub fn work_out(&mut self, seen: &LightRequest, picture: &Picture) -> LightResult {
        let begun = Instant::now();
        self.take_scene();
        self.take_settings();
        let view = SceneView {
            picture,
            world_from_camera: seen.world_from_camera,
            ball: seen.ball,
            captured_at: seen.captured_at,
            exposure: seen.exposure,
        };
        self.light.set_time(seen.seconds);
        let result = self.light.update(seen.environment.as_deref(), &view);
        let generation = self.light.lighting().map(|l| l.generation);
        let changed = generation != self.generation;
        self.generation = generation;
        LightResult {
            of: seen.arrived_at,
            state: changed.then(|| self.light.state()),
            took: begun.elapsed(),
            unseen: result.err().map(|error| error.to_string()),
            preview: self.preview(),
        }
    }

    fn take_settings(&mut self) {
        if !self.wished.has_changed().unwrap_or(false) {
            return;
        }
        let settings = self.wished.borrow_and_update().clone();
        self.light
            .set_lights(settings.light_placement, settings.light_count as usize);
        self.light.set_reflections(settings.reflections);
        self.technique = settings.technique;
        self.choose();
    }

    /// Selects the lights of the technique: shadowing planes are lit by the faces of a geodesic
    /// dome that rotates with their model.
    fn choose(&mut self) {
        let wanted = self.technique == Technique::ShadowingPlanes;
        self.light.set_faces(wanted.then_some(self.frequency));
        self.light.turn_faces(self.turn);
    }

    /// Applies a changed scene or a rotation of its model.
    fn take_scene(&mut self) {
        let Some(change) = self.news.take() else {
            return;
        };
        if let Some(scene) = change.scene {
            self.light.take_scene(*scene);
            self.generation = None;
            // A new estimator lacks the requested settings.
            self.wished.mark_changed();
        }
        if let Some(turn) = change.turn {
            self.turn = turn;
            self.choose();
        }
    }

    fn preview(&mut self) -> Option<Arc<Picture>> {
        let lighting: &Lighting = self.light.lighting()?;
        let recent = |at: Instant| at.elapsed() < PREVIEW_EVERY;
        if self.previewed.is_some_and(recent) {
            return None;
        }
        self.previewed = Some(Instant::now());
        let radiance = |d| cube::sample(&lighting.radiance, 0, d);
        let picture = environment_preview(PREVIEW_ROWS, radiance, &lighting.lights);
        Some(Arc::new(picture))
    }
}

/// A request with a copy of its picture. The worker returns it, so the buffer is recycled.
pub(crate) struct LightJob {
    pub(super) seen: LightRequest,
    pub(super) picture: Picture,
}

/// The thread that estimates light, with its channels. Dropping it ends the thread.
pub(crate) struct LightWorker {
    pub(super) errands: Option<Sender<LightJob>>,
    pub(super) finished: Receiver<(LightResult, LightJob)>,
    /// Whether the thread has no job.
    pub(super) idle: bool,
    pub(super) spare: Picture,
    pub(super) thread: Option<JoinHandle<()>>,
}

impl LightWorker {
    pub fn start(mut lighter: LightUpdater) -> Result<Self, RigError> {
        let (errands, waiting) = bounded::<LightJob>(1);
        let (done, finished) = bounded(1);
        let job = move || {
            for errand in waiting {
                let light = lighter.work_out(&errand.seen, &errand.picture);
                if done.send((light, errand)).is_err() {
                    return;
                }
            }
        };
        let thread = threads::spawn_background("light", job);
        Ok(Self {
            errands: Some(errands),
            finished,
            idle: true,
            spare: Picture::default(),
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// Activates a finished estimate, and sends this picture to the thread if the thread is idle.
    pub fn see(
        &mut self,
        force: &mut ActiveLight,
        seen: &LightRequest,
        picture: &Picture,
    ) -> LightRecord {
        if let Ok(finished) = self.finished.try_recv() {
            self.take(force, finished);
        }
        let sees = self.idle && self.hand_over(seen, picture);
        // The frame loop waits for the first light.
        let lit_by = if sees && force.is_dark() {
            Some(seen.arrived_at)
        } else {
            force.of
        };
        LightRecord { seen: sees, lit_by }
    }

    fn hand_over(&mut self, seen: &LightRequest, picture: &Picture) -> bool {
        let mut copy = std::mem::take(&mut self.spare);
        copy.copy_from(picture);
        let errand = LightJob {
            seen: seen.clone(),
            picture: copy,
        };
        let errands = self.errands.as_ref();
        let sent = errands.is_some_and(|errands| errands.send(errand).is_ok());
        self.idle = !sent;
        sent
    }

    fn take(&mut self, force: &mut ActiveLight, (light, errand): (LightResult, LightJob)) {
        force.enter(light);
        self.spare = errand.picture;
        self.idle = true;
    }

    pub fn wait(&mut self, force: &mut ActiveLight) {
        if !self.idle
            && let Ok(finished) = self.finished.recv()
        {
            self.take(force, finished);
        }
    }
}

impl Drop for LightWorker {
    fn drop(&mut self) {
        self.errands = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
