//! Watches the scene file and the models that it names, and makes a changed scene ready beside
//! the frame path. A scene that cannot be read leaves the one that is shown.

use crate::error::RigError;
use crate::light::scene_tables::SceneLight;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use penumbra_compositor::{SceneUploader, UploadedScene};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_rig_model::RigCalibration;
use penumbra_scene::scene_file::files_of;
use penumbra_scene::{Scene, SceneAddition, casters};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

/// Time between two looks at the files. Notifications of the system would be sooner, and do not
/// come from network folders or after an editor has put a new file in an old one's place.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// A changed scene, ready to be shown.
pub(super) struct Loaded {
    pub scene: Arc<Scene>,
    pub uploaded: UploadedScene,
    pub light: SceneLight,
}

impl Loaded {
    /// In place of an `older` one that was never shown.
    pub fn over(self, older: Self) -> Self {
        Self {
            light: self.light.over(older.light),
            ..self
        }
    }
}

/// What became of a change.
pub(super) enum News {
    /// It can be shown.
    Loaded(Box<Loaded>),
    /// It cannot: what, where, what to do.
    Kept(String),
}

/// What the thread works with.
pub(super) struct Origin {
    /// The scene file.
    pub path: PathBuf,
    /// What the session brings of the scene, without anything virtual.
    pub phantoms: Scene,
    /// The scene that is shown.
    pub shown: Arc<Scene>,
    pub rig: RigCalibration,
    pub config: Config,
    pub uploader: SceneUploader,
}

/// The thread, and the way from it. Dropping it ends the thread.
pub(super) struct Reload {
    news: Option<Receiver<News>>,
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Reload {
    /// Begins to watch.
    pub fn start(origin: Origin) -> Result<Self, RigError> {
        let (tell, news) = bounded(1);
        let (stop, stopped) = bounded(1);
        let mut watch = Watch::new(origin);
        let thread = threads::spawn_background("scene", move || {
            while stopped.recv_timeout(LOOK_EVERY) == Err(RecvTimeoutError::Timeout) {
                if let Some(news) = watch.look()
                    && tell.send(news).is_err()
                {
                    return;
                }
            }
        });
        Ok(Self {
            news: Some(news),
            stop: Some(stop),
            thread: Some(thread.map_err(|source| RigError::Thread { source })?),
        })
    }

    /// What has become of a change since the last call.
    pub fn news(&self) -> Option<News> {
        self.news.as_ref()?.try_recv().ok()
    }
}

impl Drop for Reload {
    fn drop(&mut self) {
        self.news = None;
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A file as it was seen: when it was written, and its size; nothing where there is none.
type Stamp = Option<(SystemTime, u64)>;

struct Watch {
    origin: Origin,
    files: Vec<PathBuf>,
    /// As they were read, and as they were seen last.
    read: Vec<Stamp>,
    seen: Vec<Stamp>,
}

impl Watch {
    fn new(origin: Origin) -> Self {
        let files = files_of(&origin.path);
        let stamps = stamps(&files);
        Self {
            origin,
            files,
            read: stamps.clone(),
            seen: stamps,
        }
    }

    /// Reads the scene anew once its files have changed and stand still.
    fn look(&mut self) -> Option<News> {
        let now = stamps(&self.files);
        let still = now == self.seen;
        self.seen = now;
        if !still || self.seen == self.read {
            return None;
        }
        self.files = files_of(&self.origin.path);
        self.read = stamps(&self.files);
        self.seen.clone_from(&self.read);
        let news = self.load();
        Some(news.unwrap_or_else(|error| News::Kept(error.to_string())))
    }

    fn load(&mut self) -> Result<News, RigError> {
        let origin = &mut self.origin;
        let scene = SceneAddition::load(&origin.path)?.onto(origin.phantoms.clone());
        let casters = casters(&scene);
        let both = (&*origin.shown, &scene);
        let light = SceneLight::new(&origin.rig, &origin.config, both, &casters)?;
        let uploaded = origin.uploader.upload(&scene, &casters);
        origin.shown = Arc::new(scene);
        Ok(News::Loaded(Box::new(Loaded {
            scene: origin.shown.clone(),
            uploaded,
            light,
        })))
    }
}

fn stamps(files: &[PathBuf]) -> Vec<Stamp> {
    let stamp = |file: &PathBuf| stamp_of(file).ok();
    files.iter().map(stamp).collect()
}

fn stamp_of(file: &Path) -> std::io::Result<(SystemTime, u64)> {
    let data = std::fs::metadata(file)?;
    Ok((data.modified()?, data.len()))
}
