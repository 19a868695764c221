//! Cache of bakes on disk.

use super::{MAX_FILE_BYTES, StoreError, from_bytes, to_bytes};
use crate::planes::Bake;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, SystemTime};

/// Maximum size of the cache, bytes; the least recently used bakes are removed first.
pub const CACHE_LIMIT: u64 = 1_000_000_000;
const EXTENSION: &str = "bake";
/// Extension of files that are being written.
const UNFINISHED: &str = "unfinished";
/// Age after which an unfinished file counts as abandoned.
const ABANDONED: Duration = Duration::from_secs(3600);

/// Loads the bake with this `key` from `path`. `None` without a file, and for a stale or damaged one,
/// which is logged.
///
/// # Errors
///
/// The file exists and cannot be read.
pub fn load(path: &Path, key: &[u8; 32]) -> Result<Option<Bake>, StoreError> {
    let Some(bytes) = read(path)? else {
        return Ok(None);
    };
    let file = path.display();
    match from_bytes(&bytes) {
        Ok(bake) if bake.key == *key => {
            touch(path);
            Ok(Some(bake))
        }
        Ok(_) => {
            tracing::info!(
                "{file}: the bake is stale: model, planes or settings have changed; it is baked again"
            );
            Ok(None)
        }
        Err(e) => {
            tracing::warn!("{file}: {e}");
            Ok(None)
        }
    }
}

fn read(path: &Path) -> Result<Option<Vec<u8>>, StoreError> {
    let mut bytes = Vec::new();
    let file = match File::open(path) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
        other => other.map_err(|e| io(path, "reading", e))?,
    };
    // One byte more than allowed, so that a larger file is refused instead of truncated.
    let mut limited = file.take(MAX_FILE_BYTES + 1);
    limited
        .read_to_end(&mut bytes)
        .map_err(|e| io(path, "reading", e))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        tracing::warn!(
            "{}: larger than the maximum; it is baked again",
            path.display()
        );
        return Ok(None);
    }
    Ok(Some(bytes))
}

/// Current time of the file system.
#[expect(
    clippy::disallowed_methods,
    reason = "a file's age is measured in wall time; nothing else depends on it"
)]
fn now() -> SystemTime {
    SystemTime::now()
}

/// Marks a bake as recently used. A failure is harmless: the bake is only removed earlier.
fn touch(path: &Path) {
    if let Ok(file) = OpenOptions::new().append(true).open(path) {
        file.set_modified(now()).ok();
    }
}

/// Writes `bake` to `path` atomically and creates its folder if missing.
///
/// # Errors
///
/// The file cannot be written; [`StoreError::Unfit`].
pub fn save(path: &Path, bake: &Bake) -> Result<(), StoreError> {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let bytes = to_bytes(bake)?;
    if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(|e| io(folder, "making the folder", e))?;
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let unfinished = path.with_extension(format!("{}-{number}.{UNFINISHED}", std::process::id()));
    let written = write(&unfinished, &bytes).and_then(|()| fs::rename(&unfinished, path));
    written.map_err(|e| {
        fs::remove_file(&unfinished).ok();
        io(path, "writing", e)
    })
}

fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    // Without this a power cut may leave the name without the content.
    file.sync_all()
}

fn io(path: &Path, doing: &'static str, source: std::io::Error) -> StoreError {
    StoreError::Io {
        file: path.display().to_string(),
        doing,
        source,
    }
}

/// Path of the bake with this key.
#[must_use]
pub fn cache_path(folder: &Path, key: &[u8; 32]) -> PathBuf {
    let name: String = key.iter().map(|b| format!("{b:02x}")).collect();
    folder.join(name).with_extension(EXTENSION)
}

/// Default folder of bakes: `bakes` in systemd's `$CACHE_DIRECTORY`, else in
/// `$XDG_CACHE_HOME/penumbra`, else in `~/.cache/penumbra`. `None` for a user without a home.
#[must_use]
pub fn default_cache_folder() -> Option<PathBuf> {
    folder_by(|name| std::env::var_os(name))
}

pub(super) fn folder_by(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    // The specifications demand that relative paths are ignored.
    let folder = |name: &str| {
        variable(name)
            .map(PathBuf::from)
            .filter(|p| p.is_absolute())
    };
    // Of several folders systemd separates by colons.
    let of_service = variable("CACHE_DIRECTORY").and_then(|all| std::env::split_paths(&all).next());
    of_service
        .filter(|p| p.is_absolute())
        .or_else(|| folder("XDG_CACHE_HOME").map(|p| p.join("penumbra")))
        .or_else(|| folder("HOME").map(|p| p.join(".cache/penumbra")))
        .map(|p| p.join("bakes"))
}

/// Removes the least recently used bakes until the others take at most `limit` bytes, and abandoned
/// unfinished files. Returns the number of removed files.
///
/// # Errors
///
/// The folder cannot be listed.
pub fn trim(folder: &Path, limit: u64) -> Result<usize, StoreError> {
    let entries = match fs::read_dir(folder) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(0),
        other => other.map_err(|e| io(folder, "listing", e))?,
    };
    let mut removed = 0;
    let mut bakes = Vec::new();
    for entry in entries.flatten() {
        let (path, Ok(about)) = (entry.path(), entry.metadata()) else {
            continue;
        };
        let used = about.modified().unwrap_or(SystemTime::UNIX_EPOCH);
        let age = now().duration_since(used).unwrap_or_default();
        let extension = path.extension().unwrap_or_default().to_owned();
        if extension == UNFINISHED && age > ABANDONED {
            removed += usize::from(fs::remove_file(&path).is_ok());
        } else if extension == EXTENSION {
            bakes.push((used, path, about.len()));
        }
    }
    bakes.sort();
    let mut total: u64 = bakes.iter().map(|b| b.2).sum();
    for (_, path, size) in bakes {
        if total <= limit {
            break;
        }
        // Another process may have removed it.
        removed += usize::from(fs::remove_file(&path).is_ok());
        total -= size;
    }
    Ok(removed)
}
