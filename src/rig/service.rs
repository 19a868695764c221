//! Runs the status server and handles the signals that end the program, on its own thread. Frames
//! do not wait for it.

use penumbra_interface::threads;
use penumbra_status::{StatusError, StatusServer};
use std::future::Future;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use tokio::sync::oneshot;

/// The service thread; runs until it is dropped.
pub struct Service {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Service {
    /// Serves `server`, if there is one. SIGINT (Ctrl-C), SIGTERM and SIGHUP (its terminal is
    /// closed) set `shutdown`, which the frame loop checks.
    ///
    /// # Errors
    /// The system cannot provide a thread, a runtime or a signal handler.
    pub fn start(server: Option<StatusServer>, shutdown: Arc<AtomicBool>) -> io::Result<Self> {
        Self::serving(
            async move {
                match server {
                    Some(server) => server.serve(std::future::pending()).await,
                    None => Ok(()),
                }
            },
            shutdown,
        )
    }

    /// The same with any server: runs it until it ends or the service is dropped.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn serving(
        server: impl Future<Output = Result<(), StatusError>> + Send + 'static,
        shutdown: Arc<AtomicBool>,
    ) -> io::Result<Self> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        let signals = {
            let _inside = runtime.enter();
            Signals::new()?
        };
        let (stop, stopped) = oneshot::channel();
        let thread = threads::spawn("service", move || {
            runtime.block_on(run(server, signals, shutdown, stopped));
        })?;
        Ok(Self {
            stop: Some(stop),
            thread: Some(thread),
        })
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        // Sending fails only where the thread has ended already.
        let _ = self.stop.take().map(|stop| stop.send(()));
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Runs the server and the signal handler concurrently until `stopped`.
async fn run(
    server: impl Future<Output = Result<(), StatusError>>,
    signals: Signals,
    shutdown: Arc<AtomicBool>,
    stopped: oneshot::Receiver<()>,
) {
    tokio::select! {
        _ = stopped => (),
        () = serve(server) => (),
        () = handle_signals(signals, &shutdown) => (),
    }
}

/// Serves until it is cancelled, also where the server has ended or there is none.
async fn serve(server: impl Future<Output = Result<(), StatusError>>) {
    if let Err(error) = server.await {
        tracing::warn!(%error, "the server of the page has stopped");
    }
    std::future::pending().await
}

/// Sets `shutdown` at every signal.
async fn handle_signals(mut signals: Signals, shutdown: &AtomicBool) {
    while signals.next().await {
        shutdown.store(true, Ordering::Relaxed);
    }
    std::future::pending().await
}

/// The signals that end the program.
#[cfg(unix)]
struct Signals {
    interrupt: tokio::signal::unix::Signal,
    terminate: tokio::signal::unix::Signal,
    /// `None` if the signal is ignored, as `nohup` has it.
    hang_up: Option<tokio::signal::unix::Signal>,
}

#[cfg(unix)]
impl Signals {
    fn new() -> io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self {
            interrupt: signal(SignalKind::interrupt())?,
            terminate: signal(SignalKind::terminate())?,
            hang_up: (!ignores_hang_up())
                .then(|| signal(SignalKind::hangup()))
                .transpose()?,
        })
    }

    /// Waits for a signal; returns false if none can arrive any more.
    async fn next(&mut self) -> bool {
        let hang_up = async {
            match &mut self.hang_up {
                Some(signal) => signal.recv().await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            signal = self.interrupt.recv() => signal.is_some(),
            signal = self.terminate.recv() => signal.is_some(),
            signal = hang_up => signal.is_some(),
        }
    }
}

/// Returns whether SIGHUP is ignored; unknown on other systems than Linux.
#[cfg(unix)]
fn ignores_hang_up() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    // Signal 1.
    ignored.is_some_and(|mask| mask & 1 == 1)
}

/// The signals that end the program.
#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    #[expect(clippy::unnecessary_wraps, reason = "same signature as on Unix")]
    const fn new() -> io::Result<Self> {
        Ok(Self)
    }

    /// Waits for a signal; returns false if none can arrive any more.
    async fn next(&mut self) -> bool {
        tokio::signal::ctrl_c().await.is_ok()
    }
}
