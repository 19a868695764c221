//! A tracker at a pseudo-terminal of this process.

use super::BenchError;

#[cfg(unix)]
pub(super) use at_pty::PlayedTracker;

#[cfg(unix)]
mod at_pty {
    use super::BenchError;
    use penumbra_interface::SystemClock;
    use penumbra_interface::threads;
    use penumbra_synthetic::{Faults, Pty, SimulatedTracker, Source, Trajectory, serve};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread::JoinHandle;

    /// Name of its thread, so that its cost is not counted as the rig's.
    const THREAD: &str = "simulated";

    /// A FASTRAK that orbits a point and answers commands. Dropping it ends the simulation.
    pub struct PlayedTracker {
        device: String,
        stop: Arc<AtomicBool>,
        thread: Option<JoinHandle<()>>,
    }

    impl PlayedTracker {
        pub fn start() -> Result<Self, BenchError> {
            let mut pty = Pty::open().map_err(|source| BenchError::Tracker { source })?;
            let device = pty.path().display().to_string();
            let path = Source::Trajectory(Trajectory::default());
            let mut tracker = SimulatedTracker::new("fastrak", path, None, false)?;
            let stop = Arc::<AtomicBool>::default();
            let stopped = Arc::clone(&stop);
            let job = move || {
                // An error needs no report here: the rig's status reports the lost tracker.
                let mut faults = Faults::default();
                let _ = serve(&mut tracker, &mut pty, &mut faults, &SystemClock, &stopped);
            };
            let thread = threads::spawn(THREAD, job);
            Ok(Self {
                device,
                stop,
                thread: Some(thread.map_err(|source| BenchError::Tracker { source })?),
            })
        }

        /// Path for the driver.
        pub fn device(&self) -> Option<&str> {
            Some(&self.device)
        }
    }

    impl Drop for PlayedTracker {
        fn drop(&mut self) {
            self.stop.store(true, Ordering::Relaxed);
            if let Some(thread) = self.thread.take() {
                let _ = thread.join();
            }
        }
    }
}

/// No tracker, on systems without pseudo-terminals.
#[cfg(not(unix))]
pub(super) struct PlayedTracker;

#[cfg(not(unix))]
impl PlayedTracker {
    pub fn start() -> Result<Self, BenchError> {
        Ok(Self)
    }

    pub fn device(&self) -> Option<&str> {
        None
    }
}
