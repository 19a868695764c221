//! Threads: named, and joined by whoever starts them.

use std::io;
use std::thread::{Builder, JoinHandle};

/// Starts a thread of that name.
///
/// # Errors
/// The system has no more threads.
#[expect(
    clippy::disallowed_methods,
    reason = "this is the one place that starts threads"
)]
pub fn spawn<T: Send + 'static>(
    name: &str,
    job: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    Builder::new().name(name.to_owned()).spawn(job)
}
