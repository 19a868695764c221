//! Choice of the virtual objects.

use std::path::PathBuf;

/// Which virtual objects are composited.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum SceneChoice {
    /// `"session"`: the object of the session.
    #[default]
    Session,
    /// `"none"`: no virtual objects; phantoms stay.
    None,
    /// A scene file.
    File(PathBuf),
}

impl SceneChoice {
    /// Parses the text of the command line or the configuration: `none`, `session` or a path.
    #[must_use]
    pub fn from_text(text: &str) -> Self {
        match text {
            "none" => Self::None,
            "session" => Self::Session,
            path => Self::File(path.into()),
        }
    }
}
