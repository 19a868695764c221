//! The cameras' sockets on the kernel's virtual host controller.

use crate::camera::{Camera, Faults};
use crate::descriptors::CAMERAS;
use crate::lock;
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::net::UnixStream;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};
use thiserror::Error;

const ATTACH: &str = "/sys/devices/platform/vhci_hcd.0/attach";
/// How long the kernel may need to let go of a camera that was unplugged.
const PATIENCE: Duration = Duration::from_secs(5);
/// Speed as vhci_hcd numbers it: 480 Mbit/s.
const HIGH_SPEED: u32 = 3;

/// A camera could not be plugged in.
#[derive(Debug, Error)]
pub enum BusError {
    /// It is plugged in already.
    #[error("it is plugged in already")]
    Plugged,
    /// It is not plugged in.
    #[error("it is not plugged in")]
    Unplugged,
    /// The kernel took it and did not ask what it is.
    #[error("the kernel does not configure it; see dmesg")]
    Ignored,
    /// The kernel does not take it.
    #[error("{ATTACH}: {source}; is vhci_hcd loaded, and are you root?")]
    Attach {
        /// What it said.
        source: io::Error,
    },
}

/// Sockets for every camera, empty at first.
#[derive(Default)]
pub struct Bus {
    sockets: [Socket; CAMERAS.len()],
}

#[derive(Default)]
struct Socket {
    camera: Option<Arc<Camera>>,
    faults: Arc<Mutex<Faults>>,
}

impl Bus {
    /// Plugs a camera in.
    ///
    /// # Errors
    /// It is plugged in already, or the kernel does not take it.
    pub fn plug(&mut self, camera: usize) -> Result<(), BusError> {
        if self.sockets[camera].camera.is_some() {
            return Err(BusError::Plugged);
        }
        let attach = |source| BusError::Attach { source };
        let (device, host) = UnixStream::pair().map_err(attach)?;
        let faults = self.sockets[camera].faults.clone();
        let started = Camera::start(CAMERAS[camera], device, faults).map_err(attach)?;
        // The kernel holds a reference of its own to `host`.
        let line = format!("{camera} {} {} {HIGH_SPEED}", host.as_raw_fd(), camera + 1);
        let asked = Instant::now();
        while let Err(source) = std::fs::write(ATTACH, &line) {
            if asked.elapsed() > PATIENCE {
                started.unplug();
                return Err(attach(source));
            }
            thread::sleep(Duration::from_millis(20));
        }
        self.sockets[camera].camera = Some(started);
        Ok(())
    }

    /// Pulls a camera's plug.
    ///
    /// # Errors
    /// It is not plugged in.
    pub fn unplug(&mut self, camera: usize) -> Result<(), BusError> {
        let unplugged = self.sockets[camera]
            .camera
            .take()
            .ok_or(BusError::Unplugged)?;
        unplugged.unplug();
        Ok(())
    }

    /// Makes every camera as new: plugged in, without faults, its controls at their defaults;
    /// and waits until the kernel has it.
    ///
    /// # Errors
    /// The kernel does not take one.
    pub fn reset(&mut self) -> Result<(), BusError> {
        for camera in 0..CAMERAS.len() {
            *self.faults(camera) = Faults::default();
            let fresh = |c: &Arc<Camera>| c.is_plugged() && !c.is_changed();
            if !self.sockets[camera].camera.as_ref().is_some_and(fresh) {
                // The kernel keeps values of controls: only a camera that was unplugged is new.
                let _ = self.unplug(camera);
                self.plug(camera)?;
            }
        }
        let asked = Instant::now();
        while self.cameras().any(|camera| !camera.is_configured()) {
            if asked.elapsed() > PATIENCE {
                return Err(BusError::Ignored);
            }
            thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    fn cameras(&self) -> impl Iterator<Item = &Arc<Camera>> {
        self.sockets.iter().flat_map(|socket| &socket.camera)
    }

    /// A camera's faults, to be changed.
    pub fn faults(&self, camera: usize) -> std::sync::MutexGuard<'_, Faults> {
        lock(&self.sockets[camera].faults)
    }

    /// A camera's state in one line: whether it is plugged in, and its newest frame's number
    /// and settings.
    #[must_use]
    pub fn state(&self, camera: usize) -> String {
        let Some(plugged) = &self.sockets[camera].camera else {
            return "unplugged".into();
        };
        match plugged.newest() {
            None => "plugged".into(),
            Some(shot) => format!(
                "plugged frame={} exposure={} gain={} temperature={}",
                shot.number, shot.settings.exposure, shot.settings.gain, shot.settings.temperature
            ),
        }
    }
}
