//! Checks the files and folders that a configuration names, without opening a device.

use crate::error::RigError;
use crate::setup::RigSetup;
use crate::source::{Live, Source};
use penumbra_config::{CameraSource, Config, TrackerSource};
use penumbra_lighting::read_environment_map;
use penumbra_session::Session;
use std::path::Path;

/// Checks that the calibration, the recordings, the environment map and the folders named by `config` exist and can be
/// used.
///
/// # Errors
/// One of them cannot be; the error names the key.
pub fn check_files(config: &Config) -> Result<(), RigError> {
    if config.calibration.is_some() {
        let rig = Live::new(config, true).and_then(|live| {
            RigSetup::read(&Source::Live(live), config)?;
            Ok(())
        });
        rig.map_err(|error| named("calibration.from", error))?;
    }
    check_recordings(config)?;
    if let Some(map) = &config.environment.map {
        // The error names the key itself.
        read_environment_map(&map.path)?;
    }
    let folders = [
        ("recording.folder", Some(config.recording.folder.as_path())),
        ("planes.cache", config.planes.cache.as_deref()),
        ("output.frames", config.output.frames.as_deref()),
        ("scene.folder", config.scene_files.folder.as_deref()),
    ];
    for (key, folder) in folders {
        if let Some(folder) = folder {
            check_folder(folder).map_err(|error| named(key, error))?;
        }
    }
    Ok(())
}

fn check_recordings(config: &Config) -> Result<(), RigError> {
    if let CameraSource::Replay(path) = &config.scene_camera.source {
        open(path).map_err(|error| named("scene_camera.device", error))?;
    }
    if let Some(CameraSource::Replay(path)) = &config.environment_camera {
        let has_pictures = open(path).and_then(|session| match session.has_environment() {
            true => Ok(()),
            false => Err(lacks(path, "pictures of an environment camera")),
        });
        has_pictures.map_err(|error| named("environment_camera.device", error))?;
    }
    if let Some(TrackerSource::Replay(path)) = &config.tracker {
        let has_data = open(path).and_then(|session| match session.tracker_protocol() {
            Some(_) => Ok(()),
            None => Err(lacks(path, "tracker data")),
        });
        has_data.map_err(|error| named("tracker.device", error))?;
    }
    Ok(())
}

fn open(path: &Path) -> Result<Session, RigError> {
    Ok(Session::open(path)?)
}

fn lacks(path: &Path, stream: &'static str) -> RigError {
    RigError::Lacks {
        path: path.to_owned(),
        stream,
    }
}

/// Checks that `folder` is a folder or can be created.
fn check_folder(folder: &Path) -> Result<(), RigError> {
    let existing = folder.ancestors().find(|ancestor| ancestor.exists());
    match existing {
        Some(path) if !path.is_dir() => Err(RigError::NoFolder {
            path: path.to_owned(),
        }),
        _ => Ok(()),
    }
}

fn named(key: &'static str, error: RigError) -> RigError {
    RigError::Named {
        key,
        error: Box::new(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_config::{EnvironmentConfig, EnvironmentMapConfig, RecordingConfig};

    #[test]
    fn missing_folders_can_be_created_but_not_inside_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let config = |path: &Path| Config {
            recording: RecordingConfig {
                folder: path.to_owned(),
                ..RecordingConfig::default()
            },
            ..Config::default()
        };
        check_files(&config(&folder.path().join("new/er"))).unwrap();
        let error = check_files(&config(&file.join("below"))).unwrap_err();
        let text = error.to_string();
        assert!(text.starts_with("`recording.folder`: "), "{text}");
    }
    #[test]
    fn environment_map_must_exist_and_be_one() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("map.hdr");
        let refusal = || {
            let map = EnvironmentMapConfig {
                path: file.clone(),
                yaw: 0.0,
                factor: 1.0,
            };
            let environment = EnvironmentConfig {
                map: Some(map),
                ..EnvironmentConfig::default()
            };
            let config = Config {
                environment,
                ..Config::default()
            };
            check_files(&config).unwrap_err().to_string()
        };
        let missing = refusal();
        assert!(missing.starts_with("environment.map: "), "{missing}");
        std::fs::write(&file, "no map").unwrap();
        let damaged = refusal();
        assert!(damaged.contains("no environment map"), "{damaged}");
    }
}
