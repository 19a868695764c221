//! Estimates light from a picture of the scene camera and the environment pictures paired with
//! it: [`LightUpdater`] on the calling thread, [`LightWorker`] on its own thread.

use crate::error::RigError;
use crate::light::state::{ActiveLight, LightRequest, LightResult, LightState};
use crate::light::updates::SceneUpdates;
use crate::light::{estimator::LightEstimator, view::SceneView};
use crossbeam_channel::{Receiver, Sender, bounded};
use glam::Quat;
use penumbra_config::Technique;
use penumbra_interface::{MonotonicTime, threads};
use penumbra_lighting::{Lighting, cube};
use penumbra_picture::Picture;
use penumbra_session::LightRecord;
use penumbra_status::{Settings, environment_preview};
use std::collections::VecDeque;
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
    estimator: LightEstimator,
    requested: watch::Receiver<Settings>,
    /// Frequency of the geodesic dome, for the technique of shadowing planes.
    frequency: u32,
    technique: Technique,
    scene_updates: SceneUpdates,
    dome_rotation: Quat,
    generation: Option<u64>,
    previewed: Option<Instant>,
}

impl LightUpdater {
    /// Creates an updater. `technique` is the initial technique, `frequency` that of the geodesic
    /// dome.
    pub fn new(
        estimator: LightEstimator,
        requested: watch::Receiver<Settings>,
        technique: Technique,
        frequency: u32,
        scene_updates: SceneUpdates,
    ) -> Self {
        let mut updater = Self {
            estimator,
            requested,
            frequency,
            technique,
            scene_updates,
            dome_rotation: Quat::IDENTITY,
            generation: None,
            previewed: None,
        };
        updater.select_lights();
        updater
    }

    /// Estimates the light of a picture. If an environment picture cannot be read, the light stays
    /// as it was.
    pub fn estimate(&mut self, request: &LightRequest, picture: &Picture) -> LightResult {
        let begun = Instant::now();
        self.apply_scene_change();
        self.apply_settings();
        let view = SceneView {
            picture,
            world_from_camera: request.world_from_camera,
            camera: &request.camera,
            sphere: request.sphere,
            captured_at: request.captured_at,
            exposure: request.exposure,
        };
        self.estimator.set_time(request.seconds);
        let result = self.estimator.update(request.environment.as_deref(), &view);
        let generation = self.estimator.lighting().map(|l| l.generation);
        let changed = generation != self.generation;
        self.generation = generation;
        LightResult {
            picture_arrived_at: request.arrived_at,
            state: changed.then(|| self.estimator.state()),
            took: begun.elapsed(),
            picture_error: result.err().map(|error| error.to_string()),
            preview: self.preview(),
        }
    }

    /// Starts a recording again.
    pub const fn restart(&mut self) {
        self.estimator.restart();
    }

    fn apply_settings(&mut self) {
        if !self.requested.has_changed().unwrap_or(false) {
            return;
        }
        let settings = self.requested.borrow_and_update().clone();
        self.estimator
            .set_lights(settings.light_placement, settings.light_count as usize);
        self.estimator.set_reflections(settings.reflections);
        self.technique = settings.technique;
        self.select_lights();
    }

    /// Selects the lights of the technique: shadowing planes are lit by the faces of a geodesic
    /// dome that rotates with their model.
    fn select_lights(&mut self) {
        let planes = self.technique == Technique::ShadowingPlanes;
        self.estimator.set_faces(planes.then_some(self.frequency));
        self.estimator.rotate_faces(self.dome_rotation);
    }

    /// Applies a changed scene or a rotation of its model.
    fn apply_scene_change(&mut self) {
        let Some(change) = self.scene_updates.take() else {
            return;
        };
        if let Some(scene) = change.scene {
            self.estimator.set_scene(*scene);
            self.generation = None;
            // A new estimator lacks the requested settings.
            self.requested.mark_changed();
        }
        if let Some(rotation) = change.dome_rotation {
            self.dome_rotation = rotation;
            self.select_lights();
        }
    }

    fn preview(&mut self) -> Option<Arc<Picture>> {
        let lighting: &Lighting = self.estimator.lighting()?;
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
    pub(super) request: LightRequest,
    pub(super) picture: Picture,
    /// Whether a recording has started again since the last job.
    pub(super) restarts: bool,
}

/// The thread that estimates light, with its channels. Dropping it ends the thread.
pub(crate) struct LightWorker {
    pub(super) jobs: Option<Sender<LightJob>>,
    pub(super) finished: Receiver<(LightResult, LightJob)>,
    /// Whether the thread has no job.
    pub(super) is_idle: bool,
    /// Whether a recording has started again since the last job.
    pub(super) restarts: bool,
    /// Jobs that wait for the thread, where pictures are scheduled ahead of what is shown.
    pub(super) waiting: VecDeque<LightJob>,
    /// Number of the environment set of the last job.
    last_set: u64,
    /// Number of environment sets between those of jobs.
    pub(super) left_out: u64,
    /// How long estimates take, seconds: the longest recent one.
    expected: f64,
    /// Recycled buffers for the pictures of jobs.
    pub(super) recycled: Vec<Picture>,
    pub(super) thread: Option<JoinHandle<()>>,
}

/// By how much the longest recent estimate counts less after each further one.
const FADING: f64 = 0.8;
/// By how much longer the light is to be known after an estimate than before it, in times that an
/// estimate takes.
const GAIN: f64 = 0.5;
/// Time before a picture is shown at which its light is estimated, at most, seconds; less than pictures
/// are scheduled ahead.
const MAX_LEAD_SECONDS: f64 = 0.55;
/// Maximum number of jobs that wait: the environment pictures of the time by which pictures are
/// scheduled ahead.
const MAX_WAITING: usize = 8;

impl LightWorker {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(mut updater: LightUpdater) -> Result<Self, RigError> {
        let (jobs, waiting) = bounded::<LightJob>(1);
        let (done, finished) = bounded(1);
        let work = move || {
            for job in waiting {
                if job.restarts {
                    updater.restart();
                }
                let light = updater.estimate(&job.request, &job.picture);
                if done.send((light, job)).is_err() {
                    return;
                }
            }
        };
        let thread = threads::spawn_background("light", work);
        let thread = thread.map_err(|source| RigError::Thread { source })?;
        let mut worker = Self::over(jobs, finished);
        worker.thread = Some(thread);
        Ok(worker)
    }

    /// A worker over the channels to a thread.
    pub(super) const fn over(
        jobs: Sender<LightJob>,
        finished: Receiver<(LightResult, LightJob)>,
    ) -> Self {
        Self {
            jobs: Some(jobs),
            finished,
            is_idle: true,
            restarts: false,
            waiting: VecDeque::new(),
            last_set: 0,
            left_out: 0,
            expected: 0.0,
            recycled: Vec::new(),
            thread: None,
        }
    }

    /// Activates a finished estimate, and sends this picture to the thread if the thread is idle.
    pub fn schedule(
        &mut self,
        active: &mut ActiveLight,
        request: &LightRequest,
        picture: &Picture,
    ) -> LightRecord {
        if let Ok(finished) = self.finished.try_recv() {
            self.activate(active, finished, request.captured_at);
        }
        let is_used = self.is_idle && {
            let job = self.job(request, picture);
            self.send(job)
        };
        // The frame loop waits for the first light.
        let lit_by = if is_used && active.is_missing() {
            Some(request.arrived_at)
        } else {
            active.picture_arrived_at
        };
        LightRecord {
            seen: is_used,
            lit_by,
        }
    }

    /// As [`Self::schedule`] for a picture ahead of what is shown: its job waits for the thread, if its
    /// environment picture is another one than that of the job before. `shown` is what is shown now,
    /// once anything is: a thread that is so slow that what it finishes would hardly be needed any more
    /// leaves jobs out.
    pub fn schedule_ahead(
        &mut self,
        active: &mut ActiveLight,
        request: &LightRequest,
        picture: &Picture,
        shown: Option<MonotonicTime>,
    ) {
        let set = |request: &LightRequest| request.environment.as_ref().map(Arc::as_ptr);
        let last = self.waiting.back().map(|job| set(&job.request));
        if last.flatten().is_none_or(|last| set(request) != Some(last)) {
            if self.waiting.len() == MAX_WAITING {
                self.thin();
            }
            let job = self.job(request, picture);
            self.waiting.push_back(job);
        }
        self.poll(active, shown);
    }

    /// Leaves out the job that waits whose neighbours are closest to each other in time.
    fn thin(&mut self) {
        let at = |k: usize| self.waiting[k].request.captured_at;
        let inner = 1..self.waiting.len().saturating_sub(1);
        if let Some(k) = inner.min_by_key(|k| at(k + 1).nanos_since(at(k - 1))) {
            let job = self.waiting.remove(k);
            self.leave_out(job);
        }
    }

    fn leave_out(&mut self, job: Option<LightJob>) {
        self.restarts |= job.as_ref().is_some_and(|job| job.restarts);
        self.recycled.extend(job.map(|job| job.picture));
    }

    /// Takes finished lights of jobs that waited, and begins with the next job. `shown`: see
    /// [`Self::schedule_ahead`].
    pub fn poll(&mut self, active: &mut ActiveLight, shown: Option<MonotonicTime>) {
        while let Ok(finished) = self.finished.try_recv() {
            let at = finished.1.request.captured_at;
            self.activate(active, finished, at);
        }
        if let Some(shown) = shown.filter(|_| self.is_idle) {
            self.leave_out_late(active, shown);
        }
        self.send_next();
    }

    /// Leaves out jobs whose light would be finished too late, as the thread takes as long as it did last:
    /// so late that it would hardly be needed any more, or that the one after it would be.
    fn leave_out_late(&mut self, active: &ActiveLight, shown: MonotonicTime) {
        let newest = active.lights.newest().and_then(LightState::captured_at);
        let known = newest.map_or(0.0, |newest| newest.seconds_since(shown).max(0.0));
        let lead = (known + (1.0 + GAIN) * self.expected).min(MAX_LEAD_SECONDS);
        let is_late = |job: &LightJob| job.request.captured_at.seconds_since(shown) < lead;
        while self.waiting.len() > 1 && self.waiting.front().is_some_and(is_late) {
            let late = self.waiting.pop_front();
            self.leave_out(late);
        }
    }

    /// Sends the first job that waits to the thread, if the thread has none.
    fn send_next(&mut self) {
        if self.is_idle
            && let Some(job) = self.waiting.pop_front()
        {
            self.send(job);
        }
    }

    fn job(&mut self, request: &LightRequest, picture: &Picture) -> LightJob {
        let mut copy = self.recycled.pop().unwrap_or_default();
        copy.copy_from(picture);
        LightJob {
            request: request.clone(),
            picture: copy,
            restarts: std::mem::take(&mut self.restarts),
        }
    }

    /// Sends a job to the thread; false if the thread has ended.
    fn send(&mut self, job: LightJob) -> bool {
        let set = job.request.environment.as_ref().map(|set| set.generation);
        let jobs = self.jobs.as_ref();
        let sent = jobs.is_some_and(|jobs| jobs.send(job).is_ok());
        if let Some(set) = set.filter(|_| sent) {
            // Numbers begin again with a recording.
            if (1..set).contains(&self.last_set) {
                self.left_out += set - self.last_set - 1;
            }
            self.last_set = set;
        }
        self.is_idle = !sent;
        sent
    }

    fn activate(
        &mut self,
        active: &mut ActiveLight,
        (light, job): (LightResult, LightJob),
        at: MonotonicTime,
    ) {
        self.expected = light.took.as_secs_f64().max(FADING * self.expected);
        active.activate(light, at);
        self.recycled.push(job.picture);
        self.is_idle = true;
    }

    /// Starts a recording again: the light of a job in progress is dropped.
    pub fn restart(&mut self) {
        if !self.is_idle
            && let Ok((_, job)) = self.finished.recv()
        {
            self.recycled.push(job.picture);
            self.is_idle = true;
        }
        let waiting = self.waiting.drain(..).map(|job| job.picture);
        self.recycled.extend(waiting);
        self.restarts = true;
    }

    /// Waits for the job in progress, activates its light, and begins with the next job; false if
    /// there was none.
    pub fn wait(&mut self, active: &mut ActiveLight) -> bool {
        if !self.is_idle
            && let Ok(finished) = self.finished.recv()
        {
            let at = finished.1.request.captured_at;
            self.activate(active, finished, at);
            self.send_next();
            return true;
        }
        false
    }
}

impl Drop for LightWorker {
    fn drop(&mut self) {
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
