//! Errors of `rig.json`, each with the complete path of its key.

use thiserror::Error;

/// Why a `rig.json` cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum RigJsonError {
    /// The file is not JSON.
    #[error("rig.json: line {line}, column {column}: {reason}; correct the JSON")]
    NotJson {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The parser's message.
        reason: String,
    },
    /// The file is larger than any calibration.
    #[error("rig.json: {bytes} bytes, more than the {limit} allowed; is it the right file?")]
    TooLarge {
        /// Size of the file.
        bytes: usize,
        /// Maximum size.
        limit: usize,
    },
    /// A required key is missing.
    #[error("rig.json: key `{path}` is missing; add it ({expected})")]
    Missing {
        /// Dotted path from the root.
        path: String,
        /// The value that belongs there.
        expected: &'static str,
    },
    /// A value has the wrong type, is out of range or contradicts another.
    #[error("rig.json: `{path}`: {reason}")]
    Wrong {
        /// Dotted path from the root.
        path: String,
        /// What is wrong, and the value that belongs there.
        reason: String,
    },
}

impl RigJsonError {
    /// The key at `path` is missing.
    pub(super) fn missing(path: String) -> Self {
        let expected = expected(&path);
        Self::Missing { path, expected }
    }

    /// The file is not JSON.
    pub(super) fn not_json(error: serde_json::Error) -> Self {
        Self::NotJson {
            line: error.line(),
            column: error.column(),
            reason: without_position(&error),
        }
    }

    /// The value at `path` cannot be used for `reason`.
    pub(super) fn wrong(path: &str, reason: &str) -> Self {
        Self::Wrong {
            path: path.to_owned(),
            reason: reason.to_owned(),
        }
    }
}

impl From<serde_path_to_error::Error<serde_json::Error>> for RigJsonError {
    fn from(error: serde_path_to_error::Error<serde_json::Error>) -> Self {
        let path = error.path().to_string();
        let error = error.into_inner();
        if !error.is_data() {
            return Self::not_json(error);
        }
        let reason = without_position(&error);
        match missing_key(&reason) {
            // serde_path_to_error calls the root ".".
            Some(key) if path == "." => Self::missing(key.to_owned()),
            Some(key) => Self::missing(format!("{path}.{key}")),
            None => Self::wrong(&path, &reason),
        }
    }
}

/// The message of an error without the position that serde_json appends.
fn without_position(error: &serde_json::Error) -> String {
    let position = format!(" at line {} column {}", error.line(), error.column());
    let message = error.to_string();
    message
        .strip_suffix(&position)
        .unwrap_or(&message)
        .to_owned()
}

/// The key that a message of [`serde::de::Error::missing_field`] names.
fn missing_key(message: &str) -> Option<&str> {
    message.strip_prefix("missing field `")?.strip_suffix('`')
}

/// The value that belongs at the end of `path`, where it is required.
fn expected(path: &str) -> &'static str {
    let key = path.rsplit('.').next().unwrap_or(path);
    match key {
        "scene_camera" => "an object with image_size and K",
        "image_size" => "[width, height] in pixels",
        "K" => "the 3x3 camera matrix",
        "kind" if path.starts_with("virtual_lights") => "\"point\" or \"spot\"",
        "kind" => "\"fisheye\" or \"sphere\"",
        "T_world_cam" => "the camera's pose in the world",
        "projection" => "an object with f, cx, cy, max_theta_rad",
        "f" => "pixels per radian at the axis",
        "cx" | "cy" => "pixels",
        "max_theta_rad" => "half the field of view, radians",
        "mirror_sphere" => "the mirrored sphere: center_world and radius",
        "center_world" => "x, y, z in metres, or a `marker`",
        "center" => "x, y, z in the marker's frame, metres",
        "radius" => "metres",
        "size_m" if path.ends_with("marker.size_m") => {
            "metres, as the marker is not among `markers`"
        }
        "size_m" => "metres",
        "family" => "e.g. \"tag36h11\"",
        "id" => "a whole number",
        "T_world_marker" => "the marker's pose in the world",
        "T_world_source" => "the transmitter's pose in the world",
        "T_sensor_cam" => "the scene camera's pose in the sensor's frame",
        "T_world_object" => "the object's pose in the world, or T_world_glb",
        "pose" => "the phantom's pose in the world",
        "glb" | "ply" | "scene" | "environment" => "a file name",
        "patches_xywh" => "a list of [x, y, width, height]",
        "position" => "matrix_row_major, or position and quaternion_wxyz",
        "quaternion_wxyz" => "four numbers w, x, y, z",
        "keys" => "a list of t, pos, target, gain",
        "intensity" => "linear RGB",
        "t" => "seconds",
        "pos" => "x, y, z in metres",
        "beam_deg" | "cutoff_deg" => "half angle, degrees",
        _ => "see the documentation of rig.json",
    }
}
