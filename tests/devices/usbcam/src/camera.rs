//! One plugged-in camera: a thread that answers requests, and one that makes frames.

use crate::controls::Controls;
use crate::descriptors::{DEVICE, Identity, configuration, string};
use crate::link::Link;
use crate::picture::{Sensor, Shot, develop};
use crate::stream::{Format, Negotiation, payloads};
use crate::usbip::{Request, STALLED, Setup, Submit, read_request};
use crate::{Stall, lock};
use std::io;
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

/// A frame that the kernel has not read after this time is dropped: the stream was stopped.
const TIMEOUT: Duration = Duration::from_millis(500);

/// Faults of a camera. They belong to its port, so they survive unplugging.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Faults {
    /// The camera sends no frames but answers requests.
    pub frozen: bool,
    /// Number of coming frames that have the error bit set.
    pub damaged: u32,
    /// Number of coming frames that are cut in half without an error bit.
    pub truncated: u32,
    /// Whether JPEG frames contain their Huffman tables.
    pub huffman_tables: bool,
    /// Frames until a setting takes effect.
    pub lag: usize,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            frozen: false,
            damaged: 0,
            truncated: 0,
            huffman_tables: true,
            lag: 0,
        }
    }
}

/// A plugged-in camera.
pub struct Camera {
    identity: Identity,
    socket: UnixStream,
    link: Link<UnixStream>,
    controls: Mutex<Controls>,
    negotiation: Mutex<Negotiation>,
    faults: Arc<Mutex<Faults>>,
    newest: Mutex<Option<Shot>>,
    configured: AtomicBool,
}

impl Camera {
    /// Starts a camera at its end of the socket pair.
    ///
    /// # Errors
    /// The socket cannot be shared.
    pub fn start(
        identity: Identity,
        socket: UnixStream,
        faults: Arc<Mutex<Faults>>,
    ) -> io::Result<Arc<Self>> {
        let requests = socket.try_clone()?;
        let camera = Arc::new(Self {
            identity,
            link: Link::new(socket.try_clone()?),
            socket,
            controls: Mutex::default(),
            negotiation: Mutex::default(),
            faults,
            newest: Mutex::default(),
            configured: AtomicBool::default(),
        });
        let [answering, streaming] = [camera.clone(), camera.clone()];
        thread::spawn(move || answering.answer_requests(requests));
        thread::spawn(move || streaming.make_frames());
        Ok(camera)
    }

    /// Closes the socket, as if the camera were unplugged.
    pub fn unplug(&self) {
        self.link.close();
        // An error means that the kernel closed it first.
        let _ = self.socket.shutdown(std::net::Shutdown::Both);
    }

    /// Whether the kernel still has the camera.
    pub fn is_plugged(&self) -> bool {
        !self.link.is_closed()
    }

    /// Whether the kernel has configured the camera. It has then released the previous camera at
    /// the same port.
    pub fn is_configured(&self) -> bool {
        self.configured.load(Ordering::Relaxed)
    }

    /// Whether a control was set since the camera was plugged in.
    pub fn is_changed(&self) -> bool {
        lock(&self.controls).is_changed()
    }

    /// The newest frame that was transferred completely.
    pub fn newest(&self) -> Option<Shot> {
        *lock(&self.newest)
    }

    fn answer_requests(&self, mut socket: UnixStream) {
        while let Ok(request) = read_request(&mut socket) {
            let answered = match request {
                Request::Unlink { sequence, target } => self.link.unlink(sequence, target),
                Request::Submit(submit) => self.answer(&submit),
            };
            if answered.is_err() {
                break;
            }
        }
        self.link.close();
    }

    fn answer(&self, submit: &Submit) -> io::Result<()> {
        if !self.link.accept(submit.sequence)? {
            return Ok(());
        }
        if submit.endpoint != 0 {
            self.link.keep(submit.sequence, submit.length);
            return Ok(());
        }
        match self.control(&submit.setup, &submit.data) {
            Ok(_) if !submit.to_host => self.link.answer(submit.sequence, 0, submit.length, &[]),
            Ok(mut data) => {
                data.truncate(submit.setup.length.into());
                self.link.answer(submit.sequence, 0, data.len(), &data)
            }
            Err(Stall) => self.link.answer(submit.sequence, STALLED, 0, &[]),
        }
    }

    /// Answers a control transfer: standard USB requests, and those of the video class to the
    /// control interface (0) and the streaming interface (1).
    fn control(&self, setup: &Setup, data: &[u8]) -> Result<Vec<u8>, Stall> {
        match (setup.kind, setup.request) {
            (0x80, 6) => match (setup.value >> 8, setup.value as u8) {
                (1, _) => Ok(DEVICE.to_vec()),
                (2, _) => Ok(configuration(self.identity)),
                (3, index) => Ok(string(self.identity, index)),
                _ => Err(Stall),
            },
            (0x80..=0x82, 0) => Ok(vec![0, 0]),
            (0x81, 10) => Ok(vec![0]),
            (0x00..=0x02, request) => {
                let configures = (setup.kind, request) == (0x00, 9);
                self.configured.fetch_or(configures, Ordering::Relaxed);
                Ok(Vec::new())
            }
            (0x21 | 0xa1, _) if setup.index as u8 == 1 => {
                lock(&self.negotiation).request(setup, data)
            }
            (0x21 | 0xa1, _) => lock(&self.controls).request(setup, data),
            _ => Err(Stall),
        }
    }

    fn make_frames(&self) {
        let mut sensor = Sensor::default();
        let mut due = Instant::now();
        let mut parity = false;
        while self.is_plugged() {
            if lock(&self.faults).frozen || !self.link.wanted(Duration::from_millis(20)) {
                thread::sleep(Duration::from_millis(2));
                due = Instant::now();
                continue;
            }
            due = (due + lock(&self.negotiation).mode().interval).max(Instant::now());
            thread::sleep(due.saturating_duration_since(Instant::now()));
            self.make_frame(&mut sensor, parity);
            parity = !parity;
        }
    }

    fn make_frame(&self, sensor: &mut Sensor, parity: bool) {
        let mode = lock(&self.negotiation).mode();
        let faults = *lock(&self.faults);
        let shot = sensor.expose(lock(&self.controls).settings(), faults.lag);
        let mut frame = develop(shot, mode, faults.huffman_tables);
        if faults.truncated > 0 && mode.format == Format::Mjpeg {
            frame.truncate(frame.len() / 2);
        }
        let is_complete = payloads(&frame, parity, faults.damaged > 0)
            .all(|payload| self.link.deliver(&payload, TIMEOUT));
        if is_complete {
            *lock(&self.newest) = Some(shot);
            // Only the faults of this frame: a command may have set others meanwhile.
            let mut left = lock(&self.faults);
            left.damaged = left.damaged.saturating_sub(faults.damaged.min(1));
            left.truncated = left.truncated.saturating_sub(faults.truncated.min(1));
        }
    }
}
