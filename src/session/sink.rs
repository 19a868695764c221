//! The output of a session writer, and its errors.

use super::SessionError;
use mcap::McapError;
use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// The last I/O error. The `mcap` crate reports some I/O errors as "parse failed", which hides e.g. a
/// full disk from the user.
type Fault = Arc<Mutex<Option<io::Error>>>;

/// Forwards to a writer and keeps its last error.
pub(super) struct Watched<W> {
    inner: W,
    fault: Fault,
}

impl<W> Watched<W> {
    pub fn into_inner(self) -> W {
        self.inner
    }

    fn note<T>(&self, outcome: io::Result<T>) -> io::Result<T> {
        outcome.inspect_err(|error| {
            let copy = match error.raw_os_error() {
                Some(code) => io::Error::from_raw_os_error(code),
                None => error.kind().into(),
            };
            if let Ok(mut fault) = self.fault.lock() {
                *fault = Some(copy);
            }
        })
    }
}

impl<W: Write> Write for Watched<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let outcome = self.inner.write(bytes);
        self.note(outcome)
    }

    fn flush(&mut self) -> io::Result<()> {
        let outcome = self.inner.flush();
        self.note(outcome)
    }
}

impl<W: Seek> Seek for Watched<W> {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        let outcome = self.inner.seek(to);
        self.note(outcome)
    }
}

/// Path and last error of a session's output, for error messages.
pub(super) struct Sink {
    path: PathBuf,
    fault: Fault,
}

impl Sink {
    /// Wraps a writer so that its errors are kept here.
    pub fn watch<W>(writer: W, path: &Path) -> (Self, Watched<W>) {
        let sink = Self {
            path: path.to_owned(),
            fault: Arc::default(),
        };
        let watched = Watched {
            inner: writer,
            fault: Arc::clone(&sink.fault),
        };
        (sink, watched)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn into_path(self) -> PathBuf {
        self.path
    }

    pub fn error(&self, what: &str, error: &McapError) -> SessionError {
        let fault = self.fault.lock().ok().and_then(|mut fault| fault.take());
        match fault {
            Some(source) => SessionError::Io {
                path: self.path.clone(),
                source,
            },
            None => self.unrecordable(what, &error.to_string()),
        }
    }

    pub fn unrecordable(&self, what: &str, reason: &str) -> SessionError {
        SessionError::Unrecordable {
            path: self.path.clone(),
            what: what.to_owned(),
            reason: reason.to_owned(),
        }
    }
}
