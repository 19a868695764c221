//! The folder of scene files and models: lists it, shows its files, takes uploads, and saves the shown
//! scene. Nothing outside of the folder is written or read for an upload, and no file is overwritten.

use crate::reload::ShowRequest;
use crate::scene_origin::{NewestScene, SavedScene, SceneOrigin};
use crate::wall_date::utc_now;
use crossbeam_channel::{Sender, TrySendError, bounded};
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_scene::SceneAddition;
use penumbra_scene::scene_file::{check_texture, file_outside};
use penumbra_status::SharedStatus;
use penumbra_status::log::Level;
use penumbra_status::scene_files::{
    SaveRequest, SceneAnswer, SceneControl, SceneFileEntry, SceneFileKind, SceneFolder,
    SceneRefusal, SceneRequest, is_listed_name,
};
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Maximum number of files that are listed, and that the folder may have for an upload.
const MAX_FILES: usize = 1000;
/// Maximum number of entries of the folder that are looked at.
const MAX_ENTRIES: usize = 10_000;
/// Time that a request waits for its scene; shorter than the server's limit.
const LOAD_WAIT: Duration = Duration::from_secs(8);
/// Prefix of an upload that is being checked. Names that begin with a dot are not listed.
const UNCHECKED: &str = ".unchecked-";

/// The folder of scenes of a running rig.
pub(super) struct ScenesOnDisk {
    folder: PathBuf,
    max_upload_bytes: u64,
    /// Why no scene can be shown.
    closed: Option<String>,
    newest: Arc<NewestScene>,
    requests: Sender<ShowRequest>,
    /// Held while a file is checked and stored.
    storing: Mutex<()>,
    status: Arc<SharedStatus>,
}

impl ScenesOnDisk {
    /// Hands requests to `requests`; `closed` tells why no scene can be shown.
    pub fn new(
        config: &Config,
        status: &Arc<SharedStatus>,
        closed: Option<String>,
        newest: Arc<NewestScene>,
        requests: Sender<ShowRequest>,
    ) -> Arc<Self> {
        Arc::new(Self {
            folder: config.scene_folder(),
            max_upload_bytes: config.scene_files.max_upload_bytes,
            closed,
            newest,
            requests,
            storing: Mutex::default(),
            status: Arc::clone(status),
        })
    }

    /// Returns the origin of a scene that a user has chosen.
    fn origin(&self, show: &str) -> Result<SceneOrigin, SceneRefusal> {
        match show {
            "none" => return Ok(SceneOrigin::Nothing),
            "session" if self.newest.rig_scenes.has_own() => return Ok(SceneOrigin::Session),
            "session" => return Err(refusal("the session has no virtual object")),
            _ => (),
        }
        let path = self.folder.join(show);
        if !is_listed_name(show) || !path.is_file() {
            let name = show.to_owned();
            return Err(SceneRefusal::Missing { name });
        }
        refuse_outside(&path)?;
        Ok(match SceneFileKind::of(show) {
            Some(SceneFileKind::Scene) => SceneOrigin::File(path),
            _ => SceneOrigin::Model(path),
        })
    }

    /// Hands a request to the thread of the scene.
    fn request(&self, request: ShowRequest) -> Result<(), SceneRefusal> {
        self.requests
            .try_send(request)
            .map_err(|error| match error {
                TrySendError::Full(_) => refusal("another scene is being loaded; try again"),
                TrySendError::Disconnected(_) => refusal("the rig has ended"),
            })
    }

    /// Writes a saved scene; the model first, because the scene file names it.
    fn write(&self, name: &str, stem: &str, scene: &SavedScene) -> Result<(), SceneRefusal> {
        let model = format!("{stem}.glb");
        if let Some(bytes) = &scene.model {
            self.store(&model, bytes, Names::Inside)?;
        }
        let written = self.store(name, scene.text.as_bytes(), Names::Anywhere);
        written.map(|_| ()).inspect_err(|_| {
            if scene.model.is_some() {
                let _ = fs::remove_file(self.folder.join(&model));
            }
        })
    }

    /// Stores `content` under `name` once the loaders accept the file.
    fn store(
        &self,
        name: &str,
        content: &[u8],
        names_files: Names,
    ) -> Result<SceneFileEntry, SceneRefusal> {
        let _turn = self.storing.lock().unwrap_or_else(PoisonError::into_inner);
        let failed = |error: io::Error| unavailable(&self.folder, &error);
        let kind = SceneFileKind::of(name).ok_or_else(|| SceneRefusal::Missing {
            name: name.to_owned(),
        })?;
        fs::create_dir_all(&self.folder).map_err(failed)?;
        let path = self.folder.join(name);
        if path.symlink_metadata().is_ok() {
            let name = name.to_owned();
            return Err(SceneRefusal::Exists { name });
        }
        if names(&self.folder).len() >= MAX_FILES {
            let reason = format!("the folder has {MAX_FILES} files; remove some");
            return Err(refusal(&reason));
        }
        let unchecked = Unchecked::write(&self.folder, name, content).map_err(failed)?;
        check(&unchecked.0, kind, names_files).map_err(|reason| SceneRefusal::Content {
            reason: reason.replace(&*unchecked.0.to_string_lossy(), name),
        })?;
        unchecked.move_to(&path).map_err(failed)?;
        let text = format!("{name} was stored in {}", self.folder.display());
        self.status.note(Level::Info, &text);
        Ok(SceneFileEntry {
            name: name.to_owned(),
            kind,
            bytes: content.len() as u64,
        })
    }
}

impl SceneControl for ScenesOnDisk {
    fn list(&self) -> SceneFolder {
        let mut files = names(&self.folder);
        files.sort_by(|a, b| a.name.cmp(&b.name));
        let left_out = files.len().saturating_sub(MAX_FILES);
        files.truncate(MAX_FILES);
        SceneFolder {
            folder: self.folder.display().to_string(),
            closed: self.closed.clone(),
            max_upload_bytes: self.max_upload_bytes,
            session: self.newest.rig_scenes.has_own(),
            files,
            left_out,
        }
    }

    fn max_upload_bytes(&self) -> u64 {
        self.max_upload_bytes
    }

    fn show(&self, request: &SceneRequest) -> Result<SceneAnswer, SceneRefusal> {
        if let Some(reason) = &self.closed {
            return Err(refusal(reason));
        }
        let (answer, answered) = bounded(1);
        let origin = self.origin(&request.show)?;
        self.request(ShowRequest { origin, answer })?;
        let loading = match answered.recv_timeout(LOAD_WAIT) {
            Ok(Ok(())) => false,
            Ok(Err(reason)) => {
                let text = format!("{reason}; the previous scene is kept");
                self.status.note(Level::Warning, &text);
                return Err(SceneRefusal::Content { reason });
            }
            Err(_) => true,
        };
        let file = request.show.clone();
        Ok(SceneAnswer { file, loading })
    }

    fn keep(&self, name: &str, content: &[u8]) -> Result<SceneFileEntry, SceneRefusal> {
        if content.len() as u64 > self.max_upload_bytes {
            let megabytes = self.max_upload_bytes / 1_000_000;
            return Err(SceneRefusal::TooLarge { megabytes });
        }
        self.store(name, content, Names::Inside)
    }

    fn save(&self, request: &SaveRequest) -> Result<SceneAnswer, SceneRefusal> {
        let name = request.file.clone().unwrap_or_else(name_by_date);
        let stem = name.strip_suffix(".toml").unwrap_or(&name).to_owned();
        let scene = self.newest.saved(&stem);
        let scene = scene.map_err(|reason| SceneRefusal::Content { reason })?;
        self.write(&name, &stem, &scene)?;
        Ok(SceneAnswer {
            file: self.folder.join(name).display().to_string(),
            loading: false,
        })
    }
}

/// Where the files may lie that a stored file names.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Names {
    /// In the folder.
    Inside,
    /// Anywhere, because the shown scene names them.
    Anywhere,
}

fn refusal(reason: &str) -> SceneRefusal {
    SceneRefusal::Unavailable {
        reason: reason.to_owned(),
    }
}

/// Returns a file name with the UTC date, e.g. `scene-20261121-120203.toml`.
fn name_by_date() -> String {
    let [year, month, day, hour, minute, second] = utc_now();
    format!("scene-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.toml")
}

fn unavailable(folder: &Path, error: &io::Error) -> SceneRefusal {
    SceneRefusal::Unavailable {
        reason: format!("{}: {error}", folder.display()),
    }
}

/// Returns the files of a folder that a scene can be made of; none if there is no such folder.
fn names(folder: &Path) -> Vec<SceneFileEntry> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let listed = entries.take(MAX_ENTRIES).filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let kind = SceneFileKind::of(&name).filter(|_| !name.starts_with('.'))?;
        let data = entry.path().metadata().ok().filter(fs::Metadata::is_file)?;
        Some(SceneFileEntry {
            name,
            kind,
            bytes: data.len(),
        })
    });
    listed.collect()
}

fn refuse_outside(path: &Path) -> Result<(), SceneRefusal> {
    match file_outside(path) {
        None => Ok(()),
        Some(outside) => Err(SceneRefusal::Content {
            reason: outside_reason(&outside),
        }),
    }
}

fn outside_reason(outside: &Path) -> String {
    format!(
        "{} lies outside of the folder of scenes; put it into that folder",
        outside.display()
    )
}

/// Lets the loaders read an uploaded file, on a thread of low priority; returns their message.
fn check(path: &Path, kind: SceneFileKind, names: Names) -> Result<(), String> {
    let path = path.to_owned();
    let checking = threads::spawn_background("upload", move || loadable(&path, kind, names));
    let checking = checking.map_err(|error| error.to_string())?;
    let stopped = || "the file cannot be read".to_owned();
    checking.join().map_err(|_| stopped())?
}

fn loadable(path: &Path, kind: SceneFileKind, names: Names) -> Result<(), String> {
    if names == Names::Inside
        && let Some(outside) = file_outside(path)
    {
        return Err(outside_reason(&outside));
    }
    match kind {
        SceneFileKind::Scene => SceneAddition::load(path).map(|_| ()),
        SceneFileKind::Model => SceneAddition::load_model(path).map(|_| ()),
        SceneFileKind::Texture => check_texture(path),
    }
    .map_err(|error| error.to_string())
}

/// A file that is not taken yet; it is removed unless it is moved.
struct Unchecked(PathBuf);

impl Unchecked {
    fn write(folder: &Path, name: &str, content: &[u8]) -> io::Result<Self> {
        let file = Self(folder.join(format!("{UNCHECKED}{}-{name}", std::process::id())));
        let mut options = OpenOptions::new();
        let mut out = match options.write(true).create_new(true).open(&file.0) {
            // Left behind by a program that was killed and had this number.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {
                fs::remove_file(&file.0)?;
                options.open(&file.0)?
            }
            opened => opened?,
        };
        out.write_all(content)?;
        out.sync_all()?;
        Ok(file)
    }

    /// Gives it its name, which no file has.
    fn move_to(&self, path: &Path) -> io::Result<()> {
        // The name is taken by an empty file first: renaming alone would replace a file that has
        // appeared meanwhile.
        File::create_new(path)?;
        fs::rename(&self.0, path).inspect_err(|_| {
            let _ = fs::remove_file(path);
        })
    }
}

impl Drop for Unchecked {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}
