//! What can be wrong with a session. Each text is one line: what, where, what to do.

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
    /// Recordings are never written over.
    #[error("{path}: exists already; name another file", path = path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The session.
        path: PathBuf,
        /// What it said.
        source: io::Error,
    },
    /// Some other kind of file.
    #[error("{path}: not an MCAP file; make a session with `penumbra import DIR OUT.mcap`", path = path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
    },
    /// Nothing in it.
    #[error("{path}: the file is empty; was the recording stopped before it began?", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// An MCAP file of something else.
    #[error("{path}: an MCAP file, but not a session of Penumbra: no topic {expected}, only {topics}", path = path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
        /// The topic that a session has at least.
        expected: &'static str,
        /// Those that there are.
        topics: String,
    },
    /// The writer was killed too early.
    #[error("{path}: cut off before its first whole chunk; nothing can be replayed", path = path.display())]
    NothingWhole {
        /// The file.
        path: PathBuf,
    },
    /// A stretch of the file is damaged; what comes after it can still be read.
    #[error("{path}: damaged at byte {offset} ({reason}); that stretch is left out", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the stretch begins.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A size that no recording has.
    #[error("{path}: {what} of {bytes} bytes; at most {limit} are read", path = path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// What is so large.
        what: String,
        /// Its size.
        bytes: u64,
        /// The most that is accepted.
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
    /// Something that cannot be recorded.
    #[error("{path}: cannot record {what}: {reason}", path = path.display())]
    Unrecordable {
        /// The file.
        path: PathBuf,
        /// The message or stream.
        what: String,
        /// Why not.
        reason: String,
    },
}
