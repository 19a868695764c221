//! Writes calibrations among the files of a rig. Existing files are kept as backups.

use crate::error::RigError;
use crate::wall_date::utc_now;
use penumbra_calibration::step::Finished;
use penumbra_config::Config;
use penumbra_output::OutputError;
use penumbra_rig_model::Grade;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Returns the folder of the rig's files.
///
/// # Errors
/// `[calibration] from` is not set or is not a folder.
pub fn calibration_folder(config: &Config) -> Result<&Path, RigError> {
    match &config.calibration {
        Some(path) if path.is_dir() => Ok(path),
        Some(path) => Err(RigError::NoCalibrationFolder {
            reason: format!("{} is not a folder", path.display()),
        }),
        None => Err(RigError::NoCalibrationFolder {
            reason: "[calibration] from is not set".to_owned(),
        }),
    }
}

/// Checks that `name`, a path within `folder` separated by `/`, can be written, and creates its
/// folders.
///
/// # Errors
/// A folder cannot be created, or no file can be written to it.
pub fn prepare(folder: &Path, name: &str) -> Result<(), RigError> {
    let path = folder.join(name);
    let created = path.parent().map_or(Ok(()), fs::create_dir_all);
    created.map_err(|source| write_error(&path, source))?;
    write_part(&path, b"")?;
    let _ = fs::remove_file(part_path(&path));
    Ok(())
}

/// Folder of the results of verifications, which are kept whatever their grade.
pub const CHECKS_FOLDER: &str = "calibration/checks/";

/// Paths of the files that a step has written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WrittenFiles {
    /// The calibration; `None` if it was refused.
    pub file: Option<PathBuf>,
    /// The backup of the previous calibration.
    pub backup: Option<PathBuf>,
    /// The report.
    pub report: Option<PathBuf>,
}

/// Writes a calibration as `name` in `folder`, and its report beside it as .html. Existing files
/// are kept, with the date in their names. A refused calibration writes only the report, as
/// .refused.html.
///
/// # Errors
/// The disk is full, or the folder is not writable; then the existing files are unchanged.
pub fn write_calibration(
    folder: &Path,
    name: &str,
    found: &Finished,
) -> Result<WrittenFiles, RigError> {
    let path = folder.join(name);
    let file = found
        .file
        .as_ref()
        .filter(|_| found.grade != Grade::Refused || name.starts_with(CHECKS_FOLDER));
    let Some(file) = file else {
        let report = path.with_extension("refused.html");
        write_part(&report, found.report.as_bytes())?;
        publish(&report)?;
        return Ok(WrittenFiles {
            report: Some(report),
            ..WrittenFiles::default()
        });
    };
    let report = path.with_extension("html");
    // Both are on the disk before either replaces an existing file.
    write_part(&report, found.report.as_bytes())?;
    write_part(&path, file.as_bytes()).inspect_err(|_| {
        let _ = fs::remove_file(part_path(&report));
    })?;
    let date = date();
    let backups = back_up(&report, &date).and_then(|_| back_up(&path, &date));
    let backup = backups.inspect_err(|_| {
        let _ = (
            fs::remove_file(part_path(&report)),
            fs::remove_file(part_path(&path)),
        );
    })?;
    publish(&report)?;
    publish(&path)?;
    Ok(WrittenFiles {
        file: Some(path),
        backup,
        report: Some(report),
    })
}

/// Returns the temporary path of a file until it is complete.
fn part_path(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.part"))
}

fn write_part(path: &Path, bytes: &[u8]) -> Result<(), RigError> {
    let part = part_path(path);
    let written = File::create(&part).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()
    });
    written.map_err(|source| {
        let _ = fs::remove_file(&part);
        write_error(path, source)
    })
}

fn publish(path: &Path) -> Result<(), RigError> {
    fs::rename(part_path(path), path).map_err(|source| write_error(path, source))
}

/// Copies the file at `path`, if any, to a name with the date in it, which is returned.
fn back_up(path: &Path, date: &str) -> Result<Option<PathBuf>, RigError> {
    if path.symlink_metadata().is_err() {
        return Ok(None);
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    let named = |suffix: &str| path.with_file_name(format!("{stem}.{date}{suffix}.{extension}"));
    let mut backup = named("");
    let mut n = 1;
    while backup.symlink_metadata().is_ok() {
        n += 1;
        backup = named(&format!("-{n}"));
    }
    // A copy, not a renaming: the old or the new calibration exists at every moment.
    fs::copy(path, &backup).map_err(|source| {
        let _ = fs::remove_file(&backup);
        write_error(&backup, source)
    })?;
    Ok(Some(backup))
}

fn write_error(path: &Path, source: std::io::Error) -> RigError {
    RigError::Output(OutputError::Write {
        path: path.to_owned(),
        source,
    })
}

/// Returns the date in UTC, e.g. `20261121T120203Z`.
fn date() -> String {
    let [year, month, day, hour, minute, second] = utc_now();
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(grade: Grade, file: &str) -> Finished {
        Finished {
            grade,
            lines: Vec::new(),
            findings: Vec::new(),
            hints: Vec::new(),
            report: format!("report of {file}"),
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
    fn existing_files_are_kept_with_their_date() {
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
    fn refused_calibration_writes_a_report_and_keeps_the_previous_one() {
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
    fn full_disk_leaves_existing_files_unchanged() {
        // Writing to /dev/full fails as on a full disk.
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
    fn rejects_configuration_without_a_calibration_folder() {
        let mut config = Config::default();
        let error = calibration_folder(&config).unwrap_err().to_string();
        assert!(error.contains("[calibration] from is not set"), "{error}");
        config.calibration = Some(PathBuf::from("desk.mcap"));
        let error = calibration_folder(&config).unwrap_err().to_string();
        assert!(error.contains("desk.mcap is not a folder"), "{error}");
    }
}
