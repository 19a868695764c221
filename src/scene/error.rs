//! Errors of scenes and their files.

use penumbra_strict_toml::TomlError;
use thiserror::Error;

/// A scene, or a file it is made of, cannot be used.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The operating system refused to read a file.
    #[error("{file}: cannot be read ({reason}); check the path and the permissions")]
    Unreadable {
        /// Path or attachment name.
        file: String,
        /// Message of the operating system.
        reason: String,
    },
    /// A file is damaged, too large, or uses an unsupported feature.
    #[error("{file}: {reason}")]
    Broken {
        /// Path or attachment name.
        file: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// A scene file is invalid.
    #[error(transparent)]
    File(#[from] TomlError),
}

impl SceneError {
    /// Creates a [`SceneError::Broken`].
    pub(crate) fn broken(file: &str, reason: impl Into<String>) -> Self {
        Self::Broken {
            file: file.to_owned(),
            reason: reason.into(),
        }
    }
}
