//! Which virtual objects are composited.

use std::path::PathBuf;

/// Which virtual objects are composited.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum SceneChoice {
    /// `"session"`: the object that the session brings.
    #[default]
    Session,
    /// `"none"`: nothing virtual; phantoms stay.
    None,
    /// A scene file.
    File(PathBuf),
}

impl SceneChoice {
    /// From the command line or the configuration: `none`, `session`, or a path.
    #[must_use]
    pub fn from_text(text: &str) -> Self {
        match text {
            "none" => Self::None,
            "session" => Self::Session,
            path => Self::File(path.into()),
        }
    }
}
