//! The ports of the cameras on the kernel's virtual host controller.

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
/// Time limit for the kernel to release an unplugged camera.
const TIMEOUT: Duration = Duration::from_secs(5);
/// Speed as vhci_hcd numbers it: 480 Mbit/s.
const HIGH_SPEED: u32 = 3;

/// A camera could not be plugged in.
#[derive(Debug, Error)]
pub enum BusError {
    /// The camera is plugged in already.
    #[error("it is plugged in already")]
    Plugged,
    /// The camera is not plugged in.
    #[error("it is not plugged in")]
    Unplugged,
    /// The kernel attached the camera but did not configure it.
    #[error("the kernel does not configure it; see dmesg")]
    Ignored,
    /// The kernel does not attach the camera.
    #[error("{ATTACH}: {source}; is vhci_hcd loaded, and are you root?")]
    Attach {
        /// The kernel's error.
        source: io::Error,
    },
}

/// One port for each camera, empty at first.
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
    /// The camera is plugged in already, or the kernel does not attach it.
    pub fn plug(&mut self, camera: usize) -> Result<(), BusError> {
        if self.sockets[camera].camera.is_some() {
            return Err(BusError::Plugged);
        }
        let attach = |source| BusError::Attach { source };
        let (device, host) = UnixStream::pair().map_err(attach)?;
        let faults = self.sockets[camera].faults.clone();
        let started = Camera::start(CAMERAS[camera], device, faults).map_err(attach)?;
        // The kernel holds a separate reference to `host`.
        let line = format!("{camera} {} {} {HIGH_SPEED}", host.as_raw_fd(), camera + 1);
        let asked = Instant::now();
        while let Err(source) = std::fs::write(ATTACH, &line) {
            if asked.elapsed() > TIMEOUT {
                started.unplug();
                return Err(attach(source));
            }
            thread::sleep(Duration::from_millis(20));
        }
        self.sockets[camera].camera = Some(started);
        Ok(())
    }

    /// Unplugs a camera.
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

    /// Resets every camera: plugged in, without faults, controls at their defaults. Waits until the
    /// kernel has configured it.
    ///
    /// # Errors
    /// The kernel does not attach a camera.
    pub fn reset(&mut self) -> Result<(), BusError> {
        for camera in 0..CAMERAS.len() {
            *self.faults(camera) = Faults::default();
            let fresh = |c: &Arc<Camera>| c.is_plugged() && !c.is_changed();
            if !self.sockets[camera].camera.as_ref().is_some_and(fresh) {
                // The kernel caches control values until a camera is unplugged.
                let _ = self.unplug(camera);
                self.plug(camera)?;
            }
        }
        let asked = Instant::now();
        while self.cameras().any(|camera| !camera.is_configured()) {
            if asked.elapsed() > TIMEOUT {
                return Err(BusError::Ignored);
            }
            thread::sleep(Duration::from_millis(10));
        }
        Ok(())
    }

    fn cameras(&self) -> impl Iterator<Item = &Arc<Camera>> {
        self.sockets.iter().flat_map(|socket| &socket.camera)
    }

    /// The faults of a camera, locked for changes.
    pub fn faults(&self, camera: usize) -> std::sync::MutexGuard<'_, Faults> {
        lock(&self.sockets[camera].faults)
    }

    /// Describes a camera in one line: whether it is plugged in, and the number and settings of its
    /// newest frame.
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
