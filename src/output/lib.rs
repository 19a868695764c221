//! Takes a finished picture to a window, a folder of files or a stream, and draws nothing.

pub mod files;
mod surface;
pub mod window;

use penumbra_compositor::{Compositor, GpuError};
use std::path::PathBuf;
use thiserror::Error;

/// Shows finished pictures.
pub trait Screen: Send {
    /// Shows the picture that the compositor has just finished. Returns false once the user has
    /// closed the window.
    fn show(&mut self, compositor: &Compositor) -> bool;
}

/// An output cannot be used.
#[derive(Debug, Error)]
pub enum OutputError {
    /// A file could not be written.
    #[error("{path}: {source}; free space, or name another folder", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system reported.
        source: std::io::Error,
    },
    /// The folder for frames holds frames already.
    #[error("{path}: holds pictures already; name another folder or pass --force", path = path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// No window could be opened.
    #[error("no window: {reason}; run with --headless to do without")]
    Window {
        /// What the window system reported.
        reason: String,
    },
    /// The graphics device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}
