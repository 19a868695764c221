//! Where calibrations go among the files of a rig: nothing that is there is lost.

use super::showcase::Written;
use crate::error::RigError;
use crate::wall_date::utc_now;
use penumbra_calibration::step::Finished;
use penumbra_config::Config;
use penumbra_output::OutputError;
use penumbra_rig_model::Grade;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder of the rig's files.
///
/// # Errors
/// The configuration names none, or something else.
pub fn calibration_folder(config: &Config) -> Result<&Path, RigError> {
    match &config.calibration {
        Some(path) if path.is_dir() => Ok(path),
        Some(path) => Err(RigError::NoCalibrationFolder {
            reason: format!("{} is no folder", path.display()),
        }),
        None => Err(RigError::NoCalibrationFolder {
            reason: "[calibration] from is not set".to_owned(),
        }),
    }
}

/// Makes sure that `name`, a path by `/` within `folder`, can be written in the end.
///
/// # Errors
/// It cannot.
pub fn prepare(folder: &Path, name: &str) -> Result<(), RigError> {
    let path = folder.join(name);
    let made = path.parent().map_or(Ok(()), fs::create_dir_all);
    made.map_err(|source| failed(&path, source))?;
    write_beside(&path, b"")?;
    let _ = fs::remove_file(beside(&path));
    Ok(())
}

/// Where checks of the rig are kept, whatever they found.
pub const CHECKS: &str = "calibration/checks/";

/// Writes what was found as `name` in `folder`, and the page about it beside it, as .html. What
/// is there is kept, with the date in its name. What was refused leaves only a page.
///
/// # Errors
/// The disk is full, or the folder is not to be written to; then the files are as they were.
pub fn write_calibration(folder: &Path, name: &str, found: &Finished) -> Result<Written, RigError> {
    let path = folder.join(name);
    let file = found
        .file
        .as_ref()
        .filter(|_| found.grade != Grade::Refused || name.starts_with(CHECKS));
    let Some(file) = file else {
        let report = path.with_extension("refused.html");
        write_beside(&report, found.page.as_bytes())?;
        put(&report)?;
        return Ok(Written {
            report: Some(report),
            ..Written::default()
        });
    };
    let report = path.with_extension("html");
    // Both are on the disk before either takes its place.
    write_beside(&report, found.page.as_bytes())?;
    write_beside(&path, file.as_bytes()).inspect_err(|_| {
        let _ = fs::remove_file(beside(&report));
    })?;
    let date = date();
    let kept = keep(&report, &date).and_then(|_| keep(&path, &date));
    let backup = kept.inspect_err(|_| {
        let _ = (
            fs::remove_file(beside(&report)),
            fs::remove_file(beside(&path)),
        );
    })?;
    put(&report)?;
    put(&path)?;
    Ok(Written {
        file: Some(path),
        backup,
        report: Some(report),
    })
}

/// Where a file is written before it is whole.
fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.part"))
}

fn write_beside(path: &Path, bytes: &[u8]) -> Result<(), RigError> {
    let part = beside(path);
    let written = File::create(&part).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(|source| {
        let _ = fs::remove_file(&part);
        failed(path, source)
    })
}

fn put(path: &Path) -> Result<(), RigError> {
    fs::rename(beside(path), path).map_err(|source| failed(path, source))
}

/// Gives what is at `path` a name with the date in it.
fn keep(path: &Path, date: &str) -> Result<Option<PathBuf>, RigError> {
    if path.symlink_metadata().is_err() {
        return Ok(None);
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let named = |more: &str| path.with_file_name(format!("{stem}.{date}{more}.{extension}"));
    let mut backup = named("");
    let mut n = 1;
    while backup.symlink_metadata().is_ok() {
        n += 1;
        backup = named(&format!("-{n}"));
    }
    // A copy: there is a calibration at any moment, the old one or the new one.
    fs::copy(path, &backup).map_err(|source| {
        let _ = fs::remove_file(&backup);
        failed(&backup, source)
    })?;
    Ok(Some(backup))
}

fn failed(path: &Path, source: std::io::Error) -> RigError {
    RigError::Output(OutputError::Write {
        path: path.to_owned(),
        source,
    })
}

/// `20261121T120203Z`.
fn date() -> String {
    let [year, month, day, hour, minute, second] = utc_now();
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    fn found(grade: Grade, file: &str) -> Finished {
        Finished {
            grade,
            lines: Vec::new(),
            findings: Vec::new(),
            hints: Vec::new(),
            page: format!("page of {file}"),
            file: Some(file.to_owned()),
        }
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder.join("calibration")).unwrap();
        let mut names: Vec<String> = entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    const NAME: &str = "calibration/tracker.json";

    #[test]
    fn what_is_there_is_kept_by_its_date() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        prepare(folder, NAME).unwrap();
        assert!(names(folder).is_empty());
        let first = write_calibration(folder, NAME, &found(Grade::Good, "1")).unwrap();
        assert_eq!(first.backup, None);
        for i in 2..4 {
            let next = found(Grade::Usable, &i.to_string());
            let written = write_calibration(folder, NAME, &next).unwrap();
            let older = fs::read_to_string(written.backup.unwrap()).unwrap();
            assert_eq!(older, (i - 1).to_string());
        }
        let names = names(folder);
        assert_eq!(names.len(), 6, "{names:?}");
        assert!(names.contains(&"tracker.json".to_owned()));
        assert_eq!(fs::read_to_string(folder.join(NAME)).unwrap(), "3");
    }

    #[test]
    fn what_was_refused_leaves_a_page_and_the_calibration_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        prepare(folder, NAME).unwrap();
        write_calibration(folder, NAME, &found(Grade::Good, "1")).unwrap();
        let written = write_calibration(folder, NAME, &found(Grade::Refused, "2")).unwrap();
        assert_eq!((written.file, written.backup), (None, None));
        let expected = ["tracker.html", "tracker.json", "tracker.refused.html"];
        assert_eq!(names(folder), expected);
        assert_eq!(fs::read_to_string(folder.join(NAME)).unwrap(), "1");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_changes_nothing() {
        // The kernel's disk that is always full.
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        prepare(folder, NAME).unwrap();
        write_calibration(folder, NAME, &found(Grade::Good, "1")).unwrap();
        let part = folder.join("calibration/.tracker.json.part");
        std::os::unix::fs::symlink("/dev/full", &part).unwrap();
        let error = write_calibration(folder, NAME, &found(Grade::Good, "2")).unwrap_err();
        let error = error.to_string();
        assert!(
            error.contains("tracker.json") && error.contains("free space"),
            "{error}"
        );
        assert_eq!(fs::read_to_string(folder.join(NAME)).unwrap(), "1");
        assert_eq!(names(folder), ["tracker.html", "tracker.json"]);
    }

    #[test]
    fn a_rig_without_a_folder_is_told_of() {
        let mut config = Config::default();
        let error = calibration_folder(&config).unwrap_err().to_string();
        assert!(error.contains("[calibration] from is not set"), "{error}");
        config.calibration = Some(PathBuf::from("desk.mcap"));
        let error = calibration_folder(&config).unwrap_err().to_string();
        assert!(error.contains("desk.mcap is no folder"), "{error}");
    }
}
