//! Outputs of finished pictures: a window and a folder of PNG files.

pub mod files;
mod surface;
pub mod window;

use penumbra_compositor::{Compositor, GpuError};
use std::path::PathBuf;
use thiserror::Error;

/// Shows finished pictures.
pub trait Screen: Send {
    /// Presents the compositor's finished picture. Returns false once the user has closed the window.
    fn show(&mut self, compositor: &Compositor) -> bool;
}

/// An error of an output.
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
    /// The folder for frames already holds frames.
    #[error("{path}: already holds pictures; name another folder or pass --force", path = path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// The window could not be opened.
    #[error("no window: {reason}; run with --headless")]
    Window {
        /// What the window system reported.
        reason: String,
    },
    /// The graphics device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}
