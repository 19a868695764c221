//! Errors of imports. Each message is one line: what, where, what to do.

use crate::SessionError;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A folder cannot be imported.
#[derive(Debug, Error)]
pub enum ImportError {
    /// The output exists.
    #[error("{path}: exists already; name another file or pass --force", path = path.display())]
    Exists {
        /// The output.
        path: PathBuf,
    },
    /// The output is a folder.
    #[error("{path}: is a folder; name a file such as {path}/session.mcap", path = path.display())]
    IsFolder {
        /// The output.
        path: PathBuf,
    },
    /// No such folder.
    #[error("{path}: no such folder", path = path.display())]
    NoFolder {
        /// The folder.
        path: PathBuf,
    },
    /// The folder has neither of the known layouts.
    #[error("{path}: contains neither scene_timestamps.csv (a rig's recording) nor rgb.txt (TUM RGB-D)", path = path.display())]
    UnknownLayout {
        /// The folder.
        path: PathBuf,
    },
    /// The folder has no pictures.
    #[error("{path}: lists no pictures of the scene camera", path = path.display())]
    NoPictures {
        /// The folder.
        path: PathBuf,
    },
    /// The operating system reports an error.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's message.
        source: io::Error,
    },
    /// A file is too large.
    #[error("{path}: {bytes} bytes; at most {limit} are read", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The maximum size, bytes.
        limit: u64,
    },
    /// A file name that leads out of the folder.
    #[error("{path}: leads out of the folder that is imported; copy the file into it", path = path.display())]
    Outside {
        /// The file.
        path: PathBuf,
    },
    /// A picture that is neither JPEG nor PNG.
    #[error("{path}: pictures must end in .jpg or .png", path = path.display())]
    PictureFormat {
        /// The file.
        path: PathBuf,
    },
    /// A line of a table is malformed.
    #[error("{path}:{line}: {reason}", path = path.display())]
    Line {
        /// The table.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        reason: String,
    },
    /// `rig.json` is not JSON.
    #[error("{path}: {reason}", path = path.display())]
    Rig {
        /// The file.
        path: PathBuf,
        /// The parser's message.
        reason: String,
    },
    /// The session could not be written.
    #[error(transparent)]
    Session(#[from] SessionError),
}

impl ImportError {
    pub(super) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}
