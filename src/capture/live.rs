//! All devices of a rig, each supervised on a thread of its own.

use super::drivers::camera_name_and_serial;
use super::source::{Recordings, open_camera, open_tracker, patience};
use super::{Account, Board, Condition, Hub, Limits, LiveTime, Sink, supervise};
use penumbra_config::{CameraSource, TrackerSource};
use penumbra_interface::DeviceKind;
use penumbra_interface::threads;
use penumbra_interface::{Clock, Frame, SystemClock, TrackerBytes};
use penumbra_session::{Camera as Stream, SessionEvent};
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;

/// Which devices a rig has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Devices {
    /// The camera whose picture is augmented.
    pub scene_camera: Option<CameraSource>,
    /// The camera that sees the light.
    pub environment_camera: Option<CameraSource>,
    /// What says where the scene camera is.
    pub tracker: Option<TrackerSource>,
}

/// One supervised device.
#[derive(Clone)]
pub struct LiveDevice {
    /// What it is for.
    pub kind: DeviceKind,
    /// As the configuration names it.
    pub name: String,
    board: Arc<Board>,
}

impl LiveDevice {
    /// What is known of it.
    #[must_use]
    pub fn condition(&self) -> Condition {
        self.board.condition()
    }

    /// Its own name, or what comes nearest to it, and its serial number; as far as it has been
    /// open and they are known.
    #[must_use]
    pub fn name_and_serial(&self) -> Option<(String, Option<String>)> {
        match self.condition().account {
            Account::None => None,
            Account::Camera(report) => {
                Some(camera_name_and_serial(&report.identity).unwrap_or((report.identity, None)))
            }
            Account::Tracker(report) => Some((report.said.unwrap_or(report.identity), None)),
        }
    }
}

/// The running supervisors. Dropping it closes all devices in order and waits for that.
pub struct Capture {
    devices: Vec<LiveDevice>,
    threads: Vec<JoinHandle<()>>,
    time: Arc<LiveTime>,
    hub: Arc<Hub>,
}

impl Capture {
    /// Starts to supervise every device; what they deliver goes to `hub`.
    ///
    /// # Errors
    /// The system has no more threads.
    pub fn start(devices: &Devices, hub: &Arc<Hub>) -> io::Result<Self> {
        let mut capture = Self {
            devices: Vec::new(),
            threads: Vec::new(),
            time: Arc::default(),
            hub: Arc::clone(hub),
        };
        let recordings = Recordings::default();
        let cameras = [
            (Stream::Scene, &devices.scene_camera),
            (Stream::Environment, &devices.environment_camera),
        ];
        for (stream, source) in cameras {
            if let Some(source) = source {
                capture.camera(stream, source.clone(), recordings.clone())?;
            }
        }
        if let Some(source) = &devices.tracker {
            capture.tracker(source.clone(), recordings)?;
        }
        Ok(capture)
    }

    /// The devices, in a fixed order.
    #[must_use]
    pub fn devices(&self) -> &[LiveDevice] {
        &self.devices
    }

    fn camera(
        &mut self,
        stream: Stream,
        source: CameraSource,
        recordings: Recordings,
    ) -> io::Result<()> {
        let (kind, thread) = match stream {
            Stream::Scene => (DeviceKind::SceneCamera, "scene-camera"),
            Stream::Environment => (DeviceKind::EnvironmentCamera, "env-camera"),
        };
        let (name, board) = self.add(kind, source.name());
        let (time, hub) = (Arc::clone(&self.time), Arc::clone(&self.hub));
        let limits = limits(matches!(source, CameraSource::Replay(_)));
        self.threads.push(threads::spawn(thread, move || {
            let clock: Arc<dyn Clock> = Arc::new(SystemClock);
            let mut open = || open_camera(&source, stream, &recordings, &clock);
            let mut sink = CameraSink { stream, hub };
            supervise(&name, &mut open, &mut sink, (&board, &*time, limits));
        })?);
        Ok(())
    }

    fn tracker(&mut self, source: TrackerSource, recordings: Recordings) -> io::Result<()> {
        let (name, board) = self.add(DeviceKind::Tracker, source.name());
        let (time, hub) = (Arc::clone(&self.time), Arc::clone(&self.hub));
        let limits = limits(matches!(source, TrackerSource::Replay(_)));
        self.threads.push(threads::spawn("tracker", move || {
            let clock: Arc<dyn Clock> = Arc::new(SystemClock);
            let mut open = || open_tracker(&source, &recordings, &clock);
            let mut sink = TrackerSink {
                protocol: Arc::from(""),
                hub,
            };
            supervise(&name, &mut open, &mut sink, (&board, &*time, limits));
        })?);
        Ok(())
    }

    fn add(&mut self, kind: DeviceKind, name: String) -> (String, Arc<Board>) {
        let board = Arc::<Board>::default();
        self.devices.push(LiveDevice {
            kind,
            name: name.clone(),
            board: Arc::clone(&board),
        });
        (name, board)
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        self.time.stop();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
        self.hub.end();
    }
}

fn limits(is_replay: bool) -> Limits {
    Limits {
        reopen_after: patience(is_replay),
        ..Limits::default()
    }
}

/// A camera's way into the hub.
struct CameraSink {
    stream: Stream,
    hub: Arc<Hub>,
}

impl Sink<Frame> for CameraSink {
    fn account(&mut self, _: &Account) {}

    fn deliver(&mut self, frame: Frame) {
        self.hub.deliver(match self.stream {
            Stream::Scene => SessionEvent::Scene(frame),
            Stream::Environment => SessionEvent::Environment(frame),
        });
    }
}

/// A tracker's way into the hub.
struct TrackerSink {
    protocol: Arc<str>,
    hub: Arc<Hub>,
}

impl Sink<TrackerBytes> for TrackerSink {
    fn account(&mut self, account: &Account) {
        if let Account::Tracker(report) = account
            && *self.protocol != *report.protocol
        {
            self.protocol = Arc::from(report.protocol.as_str());
        }
    }

    fn deliver(&mut self, item: TrackerBytes) {
        self.hub.deliver(SessionEvent::TrackerBytes {
            protocol: Arc::clone(&self.protocol),
            bytes: item.bytes,
            arrived_at: item.arrived_at,
        });
    }
}
