//! A simulated FASTRAK at the device's end of the tracker's USB cable.

use penumbra_guest::serial;
use penumbra_interface::SystemClock;
use penumbra_synthetic::{Faults, Outlet, SimulatedTracker, Source, Trajectory, serve};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use std::fs::File;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// A simulated device on a thread, until it is dropped or its cable is unplugged.
pub struct Gadget {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Gadget {
    pub fn start() -> Self {
        let mut port = Port(serial::open("/dev/ttyGS0"));
        rustix::io::ioctl_fionbio(&port.0, true).unwrap();
        let source = Source::Trajectory(Trajectory::default());
        let mut device = SimulatedTracker::new("fastrak", source, None, false).unwrap();
        let stop = Arc::<AtomicBool>::default();
        let stopped = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            let mut faults = Faults::default();
            let _ = serve(&mut device, &mut port, &mut faults, &SystemClock, &stopped);
        });
        Self {
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Gadget {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

struct Port(File);

impl Outlet for Port {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let timeout = Timespec {
            tv_sec: timeout.as_secs().cast_signed(),
            tv_nsec: timeout.subsec_nanos().into(),
        };
        if poll(&mut [PollFd::new(&self.0, PollFlags::IN)], Some(&timeout))? == 0 {
            return Ok(0);
        }
        match rustix::io::read(&self.0, buffer) {
            Ok(0) => Err(io::ErrorKind::BrokenPipe.into()),
            Err(Errno::AGAIN) => Ok(0),
            result => Ok(result?),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match rustix::io::write(&self.0, bytes) {
            // If the driver does not read, bytes are lost.
            Ok(_) | Err(Errno::AGAIN) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}
