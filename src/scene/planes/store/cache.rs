//! Where bakes are kept between runs.

use super::{LARGEST_FILE, StoreError, from_bytes, to_bytes};
use crate::planes::Bake;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, SystemTime};

/// Bytes that the cache may take; the bakes that were used longest ago go first.
pub const CACHE_LIMIT: u64 = 1_000_000_000;
const EXTENSION: &str = "bake";
/// What a writer that was killed left behind.
const UNFINISHED: &str = "unfinished";
/// After which it is certain that nobody still writes it.
const ABANDONED: Duration = Duration::from_secs(3600);

/// The bake with this `key` at `path`. None where there is no file; a stale or damaged one is
/// told of in the log, and counts as none.
///
/// # Errors
///
/// The operating system's, but for a missing file.
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
                "{file}: the bake is stale: model, planes or settings have changed since; it is made anew"
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
    // One byte more than allowed, so that a larger file is refused and not cut.
    let mut limited = file.take(LARGEST_FILE + 1);
    limited
        .read_to_end(&mut bytes)
        .map_err(|e| io(path, "reading", e))?;
    if bytes.len() as u64 > LARGEST_FILE {
        tracing::warn!("{}: larger than any bake; it is made anew", path.display());
        return Ok(None);
    }
    Ok(Some(bytes))
}

/// Now, as the file system counts.
#[allow(
    clippy::disallowed_methods,
    reason = "a file's age is told by wall time; nothing else hangs on it"
)]
fn now() -> SystemTime {
    SystemTime::now()
}

/// Marks a bake as used just now. Not being able to does no harm: it only goes sooner.
fn touch(path: &Path) {
    if let Ok(file) = OpenOptions::new().append(true).open(path) {
        file.set_modified(now()).ok();
    }
}

/// Writes `bake` to `path`, whole or not at all, making its folder where there is none.
///
/// # Errors
///
/// The operating system's, and [`StoreError::Unfit`].
pub fn save(path: &Path, bake: &Bake) -> Result<(), StoreError> {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let bytes = to_bytes(bake)?;
    if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
        fs::create_dir_all(folder).map_err(|e| io(folder, "making the folder", e))?;
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let beside = path.with_extension(format!("{}-{number}.{UNFINISHED}", std::process::id()));
    let written = write(&beside, &bytes).and_then(|()| fs::rename(&beside, path));
    written.map_err(|e| {
        fs::remove_file(&beside).ok();
        io(path, "writing", e)
    })
}

fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    // Else a power cut may leave the name without the content.
    file.sync_all()
}

fn io(path: &Path, doing: &'static str, source: std::io::Error) -> StoreError {
    StoreError::Io {
        file: path.display().to_string(),
        doing,
        source,
    }
}

/// The file of the bake with this key.
#[must_use]
pub fn cache_path(folder: &Path, key: &[u8; 32]) -> PathBuf {
    let name: String = key.iter().map(|b| format!("{b:02x}")).collect();
    folder.join(name).with_extension(EXTENSION)
}

/// Where bakes go if nothing else is said: systemd's `$CACHE_DIRECTORY`, else
/// `$XDG_CACHE_HOME/penumbra`, else `~/.cache/penumbra`; below it `bakes`. None for a user
/// without a home.
#[must_use]
pub fn default_cache_folder() -> Option<PathBuf> {
    folder_by(|name| std::env::var_os(name))
}

pub(super) fn folder_by(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    // The specifications want relative paths to be passed over.
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

/// Removes the bakes that were used longest ago until those left take at most `limit` bytes,
/// and what killed writers left behind. Says how many files went.
///
/// # Errors
///
/// The operating system's, for the folder itself.
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
        // Another process may have been faster.
        removed += usize::from(fs::remove_file(&path).is_ok());
        total -= size;
    }
    Ok(removed)
}
