//! What can be wrong with a scene's files.

use crate::calibration::RigJsonError;
use crate::calibration::record::RecordError;
use crate::config::ConfigError;
use thiserror::Error;

/// A scene, or a file it is made of, cannot be used.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The operating system refused to read a file.
    #[error("{file}: cannot be read ({reason}); check the path and the permissions")]
    Unreadable {
        /// Path or attachment name.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// A session lacks an attachment.
    #[error(
        "the session has no attachment {file}, which {wanted_by}; import it again from a complete folder"
    )]
    NoAttachment {
        /// Name of the attachment.
        file: String,
        /// Who asks for it.
        wanted_by: String,
    },
    /// A file is damaged, too large, or uses what Penumbra does not know.
    #[error("{file}: {reason}")]
    Broken {
        /// Path or attachment name.
        file: String,
        /// What is wrong and what to do.
        reason: String,
    },
    /// `rig.json` is wrong.
    #[error(transparent)]
    Rig(#[from] RigJsonError),
    /// A lens's calibration file is wrong.
    #[error(transparent)]
    Lens(#[from] RecordError),
    /// A scene file's text is wrong.
    #[error(transparent)]
    File(#[from] ConfigError),
}

impl SceneError {
    /// A [`SceneError::Broken`].
    pub(crate) fn broken(file: &str, reason: impl Into<String>) -> Self {
        Self::Broken {
            file: file.to_owned(),
            reason: reason.into(),
        }
    }
}
