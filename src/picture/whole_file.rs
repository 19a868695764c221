//! Writes files that are either complete or absent, also on a full disk.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Has `write` fill a file beside `path`, and renames it to `path` when it is complete. After an
/// error `path` is as it was. What is no regular file, such as a pipe, is written directly.
///
/// # Errors
/// `write` fails, or the file cannot be renamed.
pub fn write_whole<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&Path) -> Result<(), E>,
) -> Result<(), E> {
    let Some(target) = regular(path) else {
        return write(path);
    };
    let part = part_of(&target);
    let written = write(&part).and_then(|()| Ok(fs::rename(&part, &target)?));
    if written.is_err() {
        let _ = fs::remove_file(&part);
    }
    written
}

/// Returns the regular file at `path`, behind links, whether it exists or not.
fn regular(path: &Path) -> Option<PathBuf> {
    match fs::metadata(path) {
        Ok(found) if found.is_file() => path.canonicalize().ok(),
        Ok(_) => None,
        Err(_) => Some(path.to_owned()),
    }
}

fn part_of(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.part", std::process::id()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_write_leaves_the_folder_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let names = || {
            let entries = fs::read_dir(folder.path()).unwrap();
            let names = entries.map(|e| e.unwrap().file_name().into_string().unwrap());
            names.collect::<Vec<_>>()
        };
        let path = folder.path().join("report.json");
        let fail = |part: &Path| -> io::Result<()> {
            fs::write(part, "half")?;
            Err(io::ErrorKind::StorageFull.into())
        };
        write_whole(&path, fail).unwrap_err();
        assert!(names().is_empty(), "{:?}", names());
        write_whole(&path, |part| fs::write(part, "complete")).unwrap();
        write_whole(&path, fail).unwrap_err();
        assert_eq!(names(), ["report.json"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "complete");
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_devices_are_written_directly() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, |part| fs::write(part, "new")).unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        write_whole(Path::new("/dev/null"), |part| fs::write(part, "lost")).unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }
}
