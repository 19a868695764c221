//! Watches the scene file and the models that it names, and prepares a changed scene on its own
//! thread. If the changed scene cannot be read, the current scene stays.

use crate::error::RigError;
use crate::light::scene_tables::SceneLight;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use penumbra_compositor::{Compositor, SceneUploader, UploadedScene};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_rig_model::RigCalibration;
use penumbra_scene::scene_file::files_of;
use penumbra_scene::{Scene, SceneAddition, casters};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

/// Polling interval of the files. File system notifications would be faster, but are missing for
/// network folders and after an editor has replaced a file by a new one.
const POLL_EVERY: Duration = Duration::from_millis(250);

/// A changed scene, ready to be shown.
pub(super) struct Loaded {
    pub scene: Arc<Scene>,
    pub uploaded: UploadedScene,
    pub light: SceneLight,
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
    /// The scene file.
    pub path: PathBuf,
    /// The session's scene without virtual objects.
    pub phantoms: Scene,
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
            while stopped.recv_timeout(POLL_EVERY) == Err(RecvTimeoutError::Timeout) {
                if let Some(outcome) = watcher.poll()
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
    files: Vec<PathBuf>,
    /// Stamps of the files when they were last read.
    read: Vec<Stamp>,
    /// Stamps of the files at the last poll.
    polled: Vec<Stamp>,
}

impl FileWatcher {
    fn new(origin: Origin) -> Self {
        let files = files_of(&origin.path);
        let stamps = stamps(&files);
        Self {
            origin,
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
        self.files = files_of(&self.origin.path);
        self.read = stamps(&self.files);
        self.polled.clone_from(&self.read);
        let outcome = self.load();
        Some(outcome.unwrap_or_else(|error| ReloadOutcome::Failed(error.to_string())))
    }

    fn load(&mut self) -> Result<ReloadOutcome, RigError> {
        let origin = &mut self.origin;
        let scene = SceneAddition::load(&origin.path)?.onto(origin.phantoms.clone());
        let casters = casters(&scene);
        let both = (&*origin.shown, &scene);
        let light = SceneLight::new(&origin.rig, &origin.config, both, &casters)?;
        // A copy, because a compositor that replaces it must not wait for the upload.
        let uploader = lock(&origin.uploader).clone();
        let uploaded = uploader.upload(&scene, &casters);
        origin.shown = Arc::new(scene);
        Ok(ReloadOutcome::Loaded(Box::new(Loaded {
            scene: origin.shown.clone(),
            uploaded,
            light,
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
