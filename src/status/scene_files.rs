//! Scene files and models that a user chooses, uploads and saves while the rig runs.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Maximum length of a file's name, bytes.
const MAX_NAME_BYTES: usize = 100;

/// What a file of the folder is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum SceneFileKind {
    /// A scene file.
    Scene,
    /// A model, which alone makes a scene.
    Model,
    /// A picture that scene files use as a texture; it can be uploaded, but not shown alone.
    Texture,
}

impl SceneFileKind {
    /// Returns the kind of a file by the extension of its name; `None` for other files.
    #[must_use]
    pub fn of(name: &str) -> Option<Self> {
        let (_, extension) = name.rsplit_once('.')?;
        match extension.to_ascii_lowercase().as_str() {
            "toml" => Some(Self::Scene),
            "glb" | "gltf" | "ply" => Some(Self::Model),
            "png" | "jpg" | "jpeg" => Some(Self::Texture),
            _ => None,
        }
    }
}

/// A file of the folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SceneFileEntry {
    /// Its name.
    pub name: String,
    /// What it is.
    pub kind: SceneFileKind,
    /// Its size, bytes.
    pub bytes: u64,
}

/// The answer to `GET /scenes`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SceneFolder {
    /// The folder as configured.
    pub folder: String,
    /// Why nothing can be chosen; `None` if it can.
    pub closed: Option<String>,
    /// Maximum size of an uploaded file, bytes; 0: none is accepted.
    pub max_upload_bytes: u64,
    /// Whether the session has a scene of its own, which `"session"` shows.
    pub session: bool,
    /// Scene files and models, by name.
    pub files: Vec<SceneFileEntry>,
    /// Number of further files that are not listed.
    pub left_out: usize,
}

/// The body of `POST /scenes`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneRequest {
    /// Name of a scene file or model of the folder, `"session"` or `"none"`.
    pub show: String,
}

/// The body of `POST /scenes/save`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SaveRequest {
    /// Name of the scene file to write; by date and time without it.
    pub file: Option<String>,
}

/// The answer to a change of the scene.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SceneAnswer {
    /// The file, or `"session"` or `"none"`.
    pub file: String,
    /// Whether it is still being loaded; `scene` in `/status` shows the outcome.
    pub loading: bool,
}

/// Why a request was refused; nothing changes.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SceneRefusal {
    /// The body is malformed.
    #[error("scenes: {reason}; send a JSON object such as {{\"show\": \"desk.toml\"}}")]
    Malformed {
        /// The parser's message.
        reason: String,
    },
    /// The name is not that of a file of the folder.
    #[error("{name:?} is not a plain file name that ends in {endings}")]
    FileName {
        /// The value as sent.
        name: String,
        /// The accepted endings.
        endings: &'static str,
    },
    /// There is no such file.
    #[error("there is no file {name:?} in the folder of scenes")]
    Missing {
        /// The value as sent.
        name: String,
    },
    /// There is such a file already; none is overwritten.
    #[error("there is a file {name:?} already; choose another name")]
    Exists {
        /// The name.
        name: String,
    },
    /// The file is too large.
    #[error("the file is larger than {megabytes} MB ([scene] max_upload_mb)")]
    TooLarge {
        /// The limit, megabytes.
        megabytes: u64,
    },
    /// The content cannot be used.
    #[error("{reason}")]
    Content {
        /// The loader's message.
        reason: String,
    },
    /// The rig cannot do that now.
    #[error("scenes: {reason}")]
    Unavailable {
        /// The reason.
        reason: String,
    },
}

/// The endings of [`SceneFileKind`].
pub const ENDINGS: &str = ".toml, .glb, .gltf, .ply, .png, .jpg";

impl SceneRequest {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// The body is malformed or the name is not that of a file of a folder.
    pub fn from_json(body: &[u8]) -> Result<Self, SceneRefusal> {
        let request: Self =
            serde_json::from_slice(body).map_err(|error| SceneRefusal::Malformed {
                reason: error.to_string(),
            })?;
        if matches!(request.show.as_str(), "session" | "none") || is_listed_name(&request.show) {
            return Ok(request);
        }
        Err(SceneRefusal::FileName {
            name: request.show,
            endings: ".toml, .glb, .gltf or .ply",
        })
    }
}

impl SaveRequest {
    /// Reads the body of a request; the name is sanitised.
    ///
    /// # Errors
    /// The body is malformed or the name is not that of a scene file.
    pub fn from_json(body: &[u8]) -> Result<Self, SceneRefusal> {
        let request: Self =
            serde_json::from_slice(body).map_err(|error| SceneRefusal::Malformed {
                reason: error.to_string(),
            })?;
        let Some(name) = request.file else {
            return Ok(request);
        };
        let file = sanitised_name(&name)
            .ok()
            .filter(|file| file.ends_with(".toml"));
        let endings = ".toml";
        let file = file.ok_or(SceneRefusal::FileName { name, endings })?;
        Ok(Self { file: Some(file) })
    }
}

/// Returns whether a name stays within a folder on any system, and is that of a file that can be shown.
#[must_use]
pub fn is_listed_name(name: &str) -> bool {
    let kind = SceneFileKind::of(name);
    is_plain_name(name) && matches!(kind, Some(SceneFileKind::Scene | SceneFileKind::Model))
}

/// Whether the name stays within a folder, on any system.
fn is_plain_name(name: &str) -> bool {
    let is_forbidden = |c: char| c.is_control() || "/\\:*?\"<>|".contains(c);
    (1..=255).contains(&name.len()) && !name.starts_with('.') && !name.contains(is_forbidden)
}

/// Returns the name under which an uploaded file is kept: the last part of the path, other characters
/// than letters, digits, `-`, `_`, `+` and `.` replaced by `-`.
///
/// # Errors
/// Nothing is left of it, or its ending is unknown.
pub fn sanitised_name(name: &str) -> Result<String, SceneRefusal> {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_+.".contains(c);
    let clean: String = last
        .chars()
        .map(|c| if plain(c) { c } else { '-' })
        .collect();
    let clean = clean.trim_start_matches(['.', '-']).to_owned();
    let has_stem = clean.rsplit_once('.').is_some_and(|(s, _)| !s.is_empty());
    if has_stem && clean.len() <= MAX_NAME_BYTES && SceneFileKind::of(&clean).is_some() {
        return Ok(clean);
    }
    let name = last.chars().take(MAX_NAME_BYTES).collect();
    Err(SceneRefusal::FileName {
        name,
        endings: ENDINGS,
    })
}

/// Lists, loads and stores the scenes of a rig.
pub trait SceneControl: Send + Sync {
    /// Returns the content of the folder.
    fn list(&self) -> SceneFolder;

    /// Returns the maximum size of an uploaded file, bytes; 0: none is accepted.
    fn max_upload_bytes(&self) -> u64;

    /// Shows a scene in place of the current one; waits some seconds for the outcome.
    ///
    /// # Errors
    /// It cannot be shown; nothing changes.
    fn show(&self, request: &SceneRequest) -> Result<SceneAnswer, SceneRefusal>;

    /// Checks an uploaded file and keeps it in the folder.
    ///
    /// # Errors
    /// It cannot be used, or there is such a file; nothing changes.
    fn keep(&self, name: &str, content: &[u8]) -> Result<SceneFileEntry, SceneRefusal>;

    /// Writes the shown scene, its objects where they are, to a new scene file of the folder, and
    /// returns its path.
    ///
    /// # Errors
    /// The scene cannot be saved, or there is such a file; nothing is written.
    fn save(&self, request: &SaveRequest) -> Result<SceneAnswer, SceneRefusal>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_within_the_folder() {
        let read = |name: &str| {
            let body = serde_json::json!({ "show": name }).to_string();
            SceneRequest::from_json(body.as_bytes())
        };
        for name in ["session", "none", "a.toml", "my model.GLB", "Bär.ply"] {
            assert_eq!(read(name).unwrap().show, name);
        }
        for name in [
            "",
            "a",
            "../a.toml",
            "a/b.glb",
            "a\\b.glb",
            ".a.toml",
            "C:a.glb",
            "a.png",
        ] {
            let refused = read(name);
            assert!(
                matches!(refused, Err(SceneRefusal::FileName { .. })),
                "{name}"
            );
        }
        let text = SceneRequest::from_json(b"{}").unwrap_err().to_string();
        assert!(text.contains("desk.toml"), "{text}");
    }

    #[test]
    fn saved_scenes_have_plain_names() {
        let file = |body: &str| SaveRequest::from_json(body.as_bytes()).map(|r| r.file);
        assert_eq!(file("{}").unwrap(), None);
        let named = file(r#"{"file": "../my desk.toml"}"#).unwrap();
        assert_eq!(named.as_deref(), Some("my-desk.toml"));
        for body in [
            "",
            r#"{"file": "a.glb"}"#,
            r#"{"file": ""}"#,
            r#"{"name": "a"}"#,
        ] {
            assert!(file(body).is_err(), "{body}");
        }
    }

    #[test]
    fn uploaded_names_are_sanitised() {
        for (name, kept) in [
            ("teapot.glb", "teapot.glb"),
            ("C:\\models\\tea pot.glb", "tea-pot.glb"),
            ("../../etc/x.toml", "x.toml"),
            ("..toml.toml", "toml.toml"),
            ("Bär.PLY", "B-r.PLY"),
            ("a\u{0}b.png", "a-b.png"),
        ] {
            assert_eq!(sanitised_name(name).unwrap(), kept);
        }
        let long = format!("{}.glb", "x".repeat(120));
        for name in ["", "a", ".glb", "..", "a.exe", "a.mcap", "a.bin", &long] {
            assert!(sanitised_name(name).is_err(), "{name}");
        }
    }
}
