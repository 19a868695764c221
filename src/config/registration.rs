//! `[registration]`: source of the scene camera's pose, lens distortion and prediction.

use super::range::{Result, set};
use glam::{DMat3, DQuat, DVec3};
use penumbra_fiducials::{Dictionary, Family, MAX_DICTIONARY_BYTES};
use penumbra_interface::RigidTransform;
use penumbra_strict_toml::Fault;
use serde::Deserialize;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Source of the scene camera's pose.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum PoseSource {
    /// `"auto"`: hybrid if the calibration lists markers and a tracker, else the one that it lists.
    #[default]
    Auto,
    /// `"tracker"`: the tracker.
    Tracker,
    /// `"markers"`: markers of the calibration, seen by the scene camera.
    Markers,
    /// `"hybrid"`: the tracker, whose drift and distortion the markers correct.
    Hybrid,
    /// `"fixed"`: a camera that stands still, at the pose of the configuration.
    Fixed,
}

/// Lens distortion of the output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Distortion {
    /// `"camera"`: that of the camera; virtual objects are distorted likewise.
    #[default]
    Camera,
    /// `"undistorted"`: none; the picture is rectified.
    Undistorted,
}

/// Instant for which a picture is rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predict {
    /// `"picture"`: when it was taken.
    #[default]
    Picture,
    /// `"display"`: when it is seen. The finished picture, real and virtual, is reprojected to the
    /// predicted orientation of the camera.
    Display,
}

/// `[registration]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegistrationConfig {
    /// Source of the scene camera's pose.
    pub pose: PoseSource,
    /// `world_from_scene_camera` for [`PoseSource::Fixed`].
    pub fixed: Option<RigidTransform>,
    /// Lens distortion of the output.
    pub distortion: Distortion,
    /// Time between two rows of the scene camera's picture, seconds; 0 for a global shutter.
    pub row_seconds: f64,
    /// Whether a live rig refines the scene camera's lens by views of its markers.
    pub refine_lens: bool,
    /// Instant for which a picture is rendered.
    pub predict: Predict,
    /// Time from presenting a picture in the window until it is seen, nanoseconds.
    pub display_delay_nanos: i64,
}

impl Default for RegistrationConfig {
    fn default() -> Self {
        Self {
            pose: PoseSource::default(),
            fixed: None,
            distortion: Distortion::default(),
            row_seconds: 0.0,
            refine_lens: false,
            predict: Predict::default(),
            display_delay_nanos: 15_000_000,
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RegistrationFile {
    pub pose: Option<PoseSource>,
    pub fixed_position_m: Option<[f64; 3]>,
    pub fixed_look_at_m: Option<[f64; 3]>,
    pub fixed_rotation_wxyz: Option<[f64; 4]>,
    pub distortion: Option<Distortion>,
    pub row_time_micros: Option<f64>,
    pub refine_lens: Option<bool>,
    pub predict: Option<Predict>,
    pub display_delay_ms: Option<f64>,
    pub dictionaries: Vec<String>,
}

/// Maximum number of dictionaries in a configuration.
const MAX_DICTIONARIES: usize = 8;

/// Returns the paths of the dictionaries of markers.
pub(super) fn dictionaries(files: &[String], folder: &Path) -> Result<Vec<PathBuf>> {
    if files.len() > MAX_DICTIONARIES {
        let reason = format!("expected at most {MAX_DICTIONARIES} files");
        return Err(Fault::new("registration.dictionaries", reason));
    }
    Ok(files.iter().map(|file| folder.join(file)).collect())
}

/// Reads and registers the dictionaries of markers.
pub(super) fn register_dictionaries(paths: &[PathBuf]) -> Result<()> {
    for (i, path) in paths.iter().enumerate() {
        register_dictionary(path)
            .map_err(|reason| Fault::new(format!("registration.dictionaries[{i}]"), reason))?;
    }
    Ok(())
}

/// Reads a dictionary of markers, OpenCV's YAML or XML or a list of bits, and registers it under the
/// name of the file, without the ending.
///
/// # Errors
/// The message for the user: the file cannot be read or is no dictionary.
pub fn register_dictionary(path: &Path) -> std::result::Result<Family, String> {
    let shown = path.display();
    let refuse = |reason: &dyn std::fmt::Display| format!("{shown}: {reason}");
    let open = || {
        let file = std::fs::File::open(path)?;
        let mut text = String::new();
        file.take(MAX_DICTIONARY_BYTES).read_to_string(&mut text)?;
        std::io::Result::Ok(text)
    };
    if !path.is_file() {
        return Err(refuse(
            &"there is no such file; expected a dictionary of markers",
        ));
    }
    let text = open().map_err(|e| refuse(&e))?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    Dictionary::register(&name, &text).map_err(|e| refuse(&e))
}

/// Maximum distance of the camera from the world's origin along an axis, metres.
const FARTHEST: f64 = 1000.0;

/// Returns the camera's pose as stated, `world_from_scene_camera`.
fn fixed_pose(file: &RegistrationFile) -> Result<Option<RigidTransform>> {
    let point = |key: &str, stated: Option<[f64; 3]>| {
        let far = |p: &[f64; 3]| !p.iter().all(|x| x.abs() <= FARTHEST);
        match stated {
            Some(p) if far(&p) => Err(Fault::new(
                format!("registration.{key}"),
                format!("expected metres from -{FARTHEST} to {FARTHEST}, found {p:?}"),
            )),
            stated => Ok(stated.map(DVec3::from)),
        }
    };
    let position = point("fixed_position_m", file.fixed_position_m)?;
    let target = point("fixed_look_at_m", file.fixed_look_at_m)?;
    let turned = file.fixed_rotation_wxyz.map(rotation).transpose()?;
    let rotation = match (position, target, turned) {
        (None, None, None) => return Ok(None),
        (Some(position), Some(target), None) => looking_at(target - position)?,
        (Some(_), None, Some(rotation)) => rotation,
        (Some(_), Some(_), Some(_)) => {
            return Err(Fault::new(
                "registration.fixed_rotation_wxyz",
                "stands beside `fixed_look_at_m`; leave one of them out",
            ));
        }
        (Some(_), None, None) => {
            return Err(Fault::new(
                "registration.fixed_position_m",
                "needs a direction; add `fixed_look_at_m` or `fixed_rotation_wxyz`",
            ));
        }
        (None, ..) => {
            return Err(Fault::new(
                "registration",
                "the direction of a fixed camera needs its place; add `fixed_position_m`",
            ));
        }
    };
    Ok(position.map(|position| RigidTransform::new(rotation, position)))
}

fn rotation([w, x, y, z]: [f64; 4]) -> Result<DQuat> {
    let rotation = DQuat::from_xyzw(x, y, z, w);
    if (rotation.length() - 1.0).abs() < 0.01 {
        return Ok(rotation.normalize());
    }
    Err(Fault::new(
        "registration.fixed_rotation_wxyz",
        format!(
            "expected a unit quaternion w, x, y, z, found one of length {}",
            rotation.length()
        ),
    ))
}

/// Returns the orientation of an upright camera (+X right, +Y down, +Z forward) in the world.
fn looking_at(forward: DVec3) -> Result<DQuat> {
    let right = forward.normalize_or_zero().cross(DVec3::Z);
    if right.length() < 1e-4 {
        return Err(Fault::new(
            "registration.fixed_look_at_m",
            "is straight above or below the camera, or at its place, so that it has no upright; \
             use `fixed_rotation_wxyz`",
        ));
    }
    let (forward, right) = (forward.normalize(), right.normalize());
    let columns = DMat3::from_cols(right, forward.cross(right), forward);
    Ok(DQuat::from_mat3(&columns).normalize())
}

/// Maximum time between rows, seconds: one second for a thousand rows.
const MAX_ROW_MICROS: f64 = 1000.0;
/// Maximum delay of a display.
const LONGEST_DELAY_MS: f64 = 200.0;

pub(super) fn registration(file: &RegistrationFile, out: &mut RegistrationConfig) -> Result<()> {
    set(&mut out.pose, file.pose);
    out.fixed = fixed_pose(file)?;
    if out.pose == PoseSource::Fixed && out.fixed.is_none() {
        return Err(Fault::new(
            "registration.pose",
            "\"fixed\" needs the camera's pose; add `fixed_position_m` and `fixed_look_at_m`",
        ));
    }
    set(&mut out.distortion, file.distortion);
    set(&mut out.refine_lens, file.refine_lens);
    set(&mut out.predict, file.predict);
    if let Some(ms) = file.display_delay_ms {
        if !(0.0..=LONGEST_DELAY_MS).contains(&ms) {
            let reason = format!(
                "expected 0 to {LONGEST_DELAY_MS} milliseconds, found {ms}; a monitor takes half a \
                 refresh and a little more"
            );
            return Err(Fault::new("registration.display_delay_ms", reason));
        }
        out.display_delay_nanos = (ms * 1e6).round() as i64;
    }
    if let Some(micros) = file.row_time_micros {
        if micros.is_nan() || micros.abs() > MAX_ROW_MICROS {
            let reason = format!(
                "expected at most {MAX_ROW_MICROS} microseconds a row, found {micros}; a typical camera \
                 takes 10 to 60"
            );
            return Err(Fault::new("registration.row_time_micros", reason));
        }
        out.row_seconds = micros * 1e-6;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(position: [f64; 3], target: [f64; 3]) -> RigidTransform {
        let file = RegistrationFile {
            pose: Some(PoseSource::Fixed),
            fixed_position_m: Some(position),
            fixed_look_at_m: Some(target),
            ..RegistrationFile::default()
        };
        let mut out = RegistrationConfig::default();
        registration(&file, &mut out).unwrap();
        out.fixed.unwrap()
    }

    #[test]
    fn camera_looks_at_the_target_upright() {
        let pose = read([0.0, -2.0, 1.0], [0.0, 0.0, 1.0]);
        let axis = |v: DVec3| pose.rotation * v;
        assert!((axis(DVec3::Z) - DVec3::Y).length() < 1e-12, "forward");
        assert!((axis(DVec3::X) - DVec3::X).length() < 1e-12, "right");
        assert!((axis(DVec3::Y) + DVec3::Z).length() < 1e-12, "down");
        let down = read([1.0, 2.0, 3.0], [-0.5, 0.3, 0.1]);
        let seen = down.inverse().transform_point(DVec3::new(-0.5, 0.3, 0.1));
        assert!(seen.truncate().length() < 1e-12 && seen.z > 3.0);
        assert!(
            (down.rotation * DVec3::X).z.abs() < 1e-12,
            "the horizon is level"
        );
    }
}
