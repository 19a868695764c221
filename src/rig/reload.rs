//! Watches the scene file and the models that it names, and prepares a changed scene, or another one
//! that a user has chosen, on its own thread. If it cannot be read, the current scene stays.

use crate::error::RigError;
use crate::light::scene_tables::SceneLight;
use crate::scene_origin::{NewestScene, SceneOrigin};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use penumbra_compositor::{Compositor, SceneUploader, UploadedScene};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_rig_model::RigCalibration;
use penumbra_scene::{Scene, casters};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

/// Polling interval of requests to displace objects.
const EDIT_EVERY: Duration = Duration::from_millis(25);
/// Number of these intervals after which the files are polled, 250 ms. File system notifications would be faster, but are missing for
/// network folders and after an editor has replaced a file by a new one.
const FILES_EVERY: u32 = 10;

/// A changed scene, ready to be shown.
pub(super) struct Loaded {
    pub scene: Arc<Scene>,
    pub uploaded: UploadedScene,
    pub light: SceneLight,
    /// Number of the change of objects that it shows.
    pub edits: u64,
    /// Whether only objects were displaced, and no file has changed.
    pub is_edit: bool,
    /// What it is read from.
    pub origin: SceneOrigin,
}

/// A user's request to show another scene.
pub(super) struct ShowRequest {
    pub origin: SceneOrigin,
    /// Receives why it cannot be shown.
    pub answer: Sender<Result<(), String>>,
}

impl Loaded {
    /// Uploads the scene again if its device was lost since.
    pub fn upload_to(&mut self, compositor: &Compositor) {
        if !self.uploaded.is_on(compositor.gpu()) {
            let uploader = compositor.uploader();
            self.uploaded = uploader.upload(&self.scene, &casters(&self.scene));
        }
    }

    /// Combines this scene with an `older` one that it replaces before that was shown.
    pub fn over(self, older: Self) -> Self {
        Self {
            light: self.light.over(older.light),
            is_edit: self.is_edit && older.is_edit,
            ..self
        }
    }
}

/// The outcome of a change.
pub(super) enum ReloadOutcome {
    /// The scene can be shown.
    Loaded(Box<Loaded>),
    /// The scene cannot be read and the previous one is kept; the message for the user.
    Failed(String),
}

/// Inputs of the reload thread.
pub(super) struct Origin {
    pub newest: Arc<NewestScene>,
    /// Users' requests.
    pub requests: Receiver<ShowRequest>,
    /// The scene that was loaded last.
    pub shown: Arc<Scene>,
    pub rig: RigCalibration,
    pub config: Config,
    pub uploader: SharedUploader,
}

/// The uploader of the current compositor; replaced after its device was lost.
pub(super) type SharedUploader = Arc<Mutex<SceneUploader>>;

/// The reload thread and the channel of its outcomes. Dropping it ends the thread.
pub(super) struct Reload {
    uploader: SharedUploader,
    outcomes: Option<Receiver<ReloadOutcome>>,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Reload {
    /// Starts to watch the files.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(origin: Origin) -> Result<Self, RigError> {
        let (sender, outcomes) = bounded(1);
        let (stop, stopped) = bounded(1);
        let uploader = origin.uploader.clone();
        let mut watcher = FileWatcher::new(origin);
        let thread = threads::spawn_background("scene", move || {
            let mut intervals: u32 = 0;
            while stopped.recv_timeout(EDIT_EVERY) == Err(RecvTimeoutError::Timeout) {
                intervals = intervals.wrapping_add(1);
                let polls = intervals.is_multiple_of(FILES_EVERY);
                let changed = polls.then(|| watcher.poll()).flatten();
                let changed = changed.or_else(|| watcher.poll_requests());
                if let Some(outcome) = changed.or_else(|| watcher.poll_edits())
                    && sender.send(outcome).is_err()
                {
                    return;
                }
            }
        });
        Ok(Self {
            uploader,
            outcomes: Some(outcomes),
            stop: Some(stop),
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// Uploads the scenes of later changes with `uploader`.
    pub fn set_uploader(&self, uploader: SceneUploader) {
        *lock(&self.uploader) = uploader;
    }

    /// Returns the outcome of a change since the last call.
    pub fn poll(&self) -> Option<ReloadOutcome> {
        self.outcomes.as_ref()?.try_recv().ok()
    }
}

impl Drop for Reload {
    fn drop(&mut self) {
        self.outcomes = None;
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Modification time and size of a file; `None` if it does not exist.
type Stamp = Option<(SystemTime, u64)>;

/// Polls the files of the scene.
struct FileWatcher {
    origin: Origin,
    /// Number of the newest change of objects that was loaded.
    edits: u64,
    files: Vec<PathBuf>,
    /// Stamps of the files when they were last read.
    read: Vec<Stamp>,
    /// Stamps of the files at the last poll.
    polled: Vec<Stamp>,
}

impl FileWatcher {
    fn new(origin: Origin) -> Self {
        let files = origin.newest.origin().files();
        let stamps = stamps(&files);
        Self {
            origin,
            edits: 0,
            files,
            read: stamps.clone(),
            polled: stamps,
        }
    }

    /// Reads the scene again once its files have changed and are equal in two successive polls.
    fn poll(&mut self) -> Option<ReloadOutcome> {
        let now = stamps(&self.files);
        let is_stable = now == self.polled;
        self.polled = now;
        if !is_stable || self.polled == self.read {
            return None;
        }
        self.remember_files();
        let outcome = self.load(self.origin.newest.origin());
        Some(outcome.unwrap_or_else(|error| ReloadOutcome::Failed(error.to_string())))
    }

    /// Remembers the files of the scene as they are now.
    fn remember_files(&mut self) {
        self.files = self.origin.newest.origin().files();
        self.read = stamps(&self.files);
        self.polled.clone_from(&self.read);
    }

    /// Prepares the scene that a user has chosen; from then on its files are polled.
    fn poll_requests(&mut self) -> Option<ReloadOutcome> {
        let ShowRequest { origin, answer } = self.origin.requests.try_recv().ok()?;
        let (result, outcome) = match self.load(origin) {
            Ok(outcome) => {
                self.remember_files();
                (Ok(()), Some(outcome))
            }
            Err(error) => (Err(error.to_string()), None),
        };
        // Whoever has asked may have stopped waiting; then the status shows the reason.
        let unheard = answer.send(result).err().and_then(|e| e.into_inner().err());
        outcome.or_else(|| unheard.map(ReloadOutcome::Failed))
    }

    /// Prepares the scene with the newest places of its objects, if they have changed.
    fn poll_edits(&mut self) -> Option<ReloadOutcome> {
        let (number, scene) = self.origin.newest.editor.newer_than(self.edits)?;
        self.edits = number;
        let outcome = self.prepare(scene, self.origin.newest.origin(), true);
        Some(outcome.unwrap_or_else(|error| ReloadOutcome::Failed(error.to_string())))
    }

    fn load(&mut self, origin: SceneOrigin) -> Result<ReloadOutcome, RigError> {
        let (number, scene) = self.origin.newest.load(origin.clone())?;
        self.edits = number;
        self.prepare(scene, origin, false)
    }

    fn prepare(
        &mut self,
        scene: Arc<Scene>,
        scene_origin: SceneOrigin,
        is_edit: bool,
    ) -> Result<ReloadOutcome, RigError> {
        let origin = &mut self.origin;
        let casters = casters(&scene);
        let both = (&*origin.shown, &*scene);
        let light = SceneLight::new(&origin.rig, &origin.config, both, &casters)?;
        // A copy, because a compositor that replaces it must not wait for the upload.
        let uploader = lock(&origin.uploader).clone();
        let uploaded = uploader.upload(&scene, &casters);
        origin.shown = scene;
        Ok(ReloadOutcome::Loaded(Box::new(Loaded {
            scene: origin.shown.clone(),
            uploaded,
            light,
            edits: self.edits,
            is_edit,
            origin: scene_origin,
        })))
    }
}

fn lock(uploader: &SharedUploader) -> MutexGuard<'_, SceneUploader> {
    uploader.lock().unwrap_or_else(PoisonError::into_inner)
}

fn stamps(files: &[PathBuf]) -> Vec<Stamp> {
    let stamp = |file: &PathBuf| stamp_of(file).ok();
    files.iter().map(stamp).collect()
}

fn stamp_of(file: &Path) -> std::io::Result<(SystemTime, u64)> {
    let data = std::fs::metadata(file)?;
    Ok((data.modified()?, data.len()))
}
