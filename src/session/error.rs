//! Errors of sessions. Each message is one line: what, where, what to do.

use super::loss::{LostMessages, sentence};
use std::io;
use std::path::PathBuf;
use thiserror::Error;

/// A session cannot be read or written.
#[derive(Debug, Error)]
pub enum SessionError {
    /// No such file.
    #[error("{path}: no such session; make one with `penumbra import DIR {path}`", path = path.display())]
    NotFound {
        /// The session.
        path: PathBuf,
    },
    /// The file exists; recordings are never overwritten.
    #[error("{path}: exists already; name another file", path = path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The operating system reports an error.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The session.
        path: PathBuf,
        /// The system's message.
        source: io::Error,
    },
    /// Not an MCAP file.
    #[error("{path}: not an MCAP file; make a session with `penumbra import DIR OUT.mcap`", path = path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// The file is empty.
    #[error("{path}: the file is empty; was the recording stopped before it began?", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// An MCAP file that is not a session.
    #[error("{path}: an MCAP file, but not a session of Penumbra: no topic {expected}, only {topics}", path = path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The topic that every session has.
        expected: &'static str,
        /// The topics of the file.
        topics: String,
    },
    /// The file ends before its first complete chunk.
    #[error("{path}: truncated before its first complete chunk; nothing can be replayed", path = path.display())]
    NoCompleteChunk {
        /// The file.
        path: PathBuf,
    },
    /// A part of the file is damaged; the parts after it can still be read.
    #[error("{path}: damaged at byte {offset} ({reason}); {lost}", path = path.display(), lost = sentence(lost))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Offset of the damaged part, bytes.
        offset: u64,
        /// The kind of damage.
        reason: String,
        /// The messages that the part held, as far as they are known.
        lost: Vec<LostMessages>,
    },
    /// A part of the file is too large.
    #[error("{path}: {what} of {bytes} bytes; at most {limit} are read", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The part.
        what: String,
        /// Its size.
        bytes: u64,
        /// The maximum size, bytes.
        limit: u64,
    },
    /// An attachment's name leads out of the session.
    #[error("{path}: attachment name {name:?} is not a plain relative path such as object/object.glb", path = path.display())]
    AttachmentName {
        /// The file.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// An event cannot be recorded.
    #[error("{path}: cannot record {what}: {reason}", path = path.display())]
    Unrecordable {
        /// The file.
        path: PathBuf,
        /// The message or stream.
        what: String,
        /// The reason.
        reason: String,
    },
}

impl SessionError {
    /// The messages that a damaged part held, as far as they are known.
    #[must_use]
    pub fn lost(&self) -> &[LostMessages] {
        match self {
            Self::Damaged { lost, .. } => lost,
            _ => &[],
        }
    }
}
