//! Threads: named, and joined by whoever starts them.

use std::io;
use std::thread::{Builder, JoinHandle};

/// Starts a thread of that name that leaves the processors to all others: work that nobody
/// waits for.
///
/// # Errors
/// The system has no more threads.
pub fn spawn_patient<T: Send + 'static>(
    name: &str,
    job: impl FnOnce() -> T + Send + 'static,
) -> io::Result<JoinHandle<T>> {
    spawn(name, move || {
        step_back();
        job()
    })
}

/// Lowers the priority of the calling thread alone. Linux takes a thread's number for a
/// process's here; elsewhere the whole program would step back, so nothing is done. Where
/// it is refused the work is done at the usual priority.
fn step_back() {
    #[cfg(target_os = "linux")]
    {
        use rustix::process::{getpriority_process, setpriority_process};
        let this = Some(rustix::thread::gettid());
        let usual = getpriority_process(this).unwrap_or_default();
        let _ = setpriority_process(this, usual + PATIENT);
    }
}

/// Steps of niceness. With ten the thread still gets a tenth of a busy core; with nineteen it
/// is a seventieth, and light lagged two seconds behind on a machine that had more to do.
#[cfg(target_os = "linux")]
const PATIENT: i32 = 10;

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
