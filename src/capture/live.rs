//! All devices of a rig, each supervised on its own thread.

use crate::device::DeviceReport;
use crate::drivers::camera_name_and_serial;
use crate::hub::Hub;
use crate::irregular::{ArrivalCheck, FrameCheck, Irregularity, is_whole};
use crate::monitor::{DeviceMonitor, DeviceStatus};
use crate::source::{Recordings, open_camera, open_tracker};
use crate::supervisor::{Limits, Sink, Supervisor};
use crate::time::StoppableSystemClock;
use bytes::Bytes;
use penumbra_config::{CameraSource, TrackerSource};
use penumbra_interface::{
    Clock, DeviceKind, Frame, MonotonicTime, SystemClock, TrackerBytes, threads,
};
use penumbra_session::{Camera as Stream, SessionEvent};
use std::io;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Time without data after which a replayed device is reopened: long, because it repeats the pauses
/// of its recording.
const REPLAY_REOPEN_AFTER: Duration = Duration::from_secs(3600);

/// The devices of a rig.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Devices {
    /// The camera whose picture is augmented.
    pub scene_camera: Option<CameraSource>,
    /// The camera that captures the surroundings.
    pub environment_camera: Option<CameraSource>,
    /// The tracker of the scene camera.
    pub tracker: Option<TrackerSource>,
}

/// Size of the shortest record of a tracker, bytes.
const MIN_RECORD_BYTES: usize = 16;

/// One supervised device.
#[derive(Clone)]
pub struct LiveDevice {
    /// Its role.
    pub kind: DeviceKind,
    /// Its name in the configuration.
    pub name: String,
    monitor: Arc<DeviceMonitor>,
}

impl LiveDevice {
    /// Returns its status.
    #[must_use]
    pub fn status(&self) -> DeviceStatus {
        self.monitor.status()
    }

    /// Counts a delivery that could not be decoded, for this reason.
    pub fn undecodable(&self, reason: &str) {
        let kind = Irregularity::Undecodable;
        self.monitor.irregular(kind, &self.name, Some(reason));
    }

    /// Returns its product name, or else its identity, and its serial number; `None` before it
    /// has been open.
    #[must_use]
    pub fn name_and_serial(&self) -> Option<(String, Option<String>)> {
        match self.status().report {
            DeviceReport::None => None,
            DeviceReport::Camera(report) => {
                Some(camera_name_and_serial(&report.identity).unwrap_or((report.identity, None)))
            }
            DeviceReport::Tracker(report) => {
                Some((report.description.unwrap_or(report.identity), None))
            }
        }
    }
}

/// The running supervisors. Dropping it closes all devices, waits for that, and ends the hub.
pub struct Capture {
    devices: Vec<LiveDevice>,
    threads: Vec<JoinHandle<()>>,
    clock: Arc<StoppableSystemClock>,
    hub: Arc<Hub>,
}

impl Capture {
    /// Starts a thread for each device, whose deliveries go to `hub`.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(devices: &Devices, hub: &Arc<Hub>) -> io::Result<Self> {
        let mut capture = Self {
            devices: Vec::new(),
            threads: Vec::new(),
            clock: Arc::default(),
            hub: Arc::clone(hub),
        };
        let recordings = Recordings::default();
        let cameras = [
            (Stream::Scene, &devices.scene_camera),
            (Stream::Environment, &devices.environment_camera),
        ];
        for (stream, source) in cameras {
            if let Some(source) = source {
                capture.start_camera(stream, source.clone(), recordings.clone())?;
            }
        }
        if let Some(source) = &devices.tracker {
            capture.start_tracker(source.clone(), recordings)?;
        }
        Ok(capture)
    }

    /// Returns the devices: scene camera, environment camera, tracker, as far as the rig has them.
    #[must_use]
    pub fn devices(&self) -> &[LiveDevice] {
        &self.devices
    }

    fn start_camera(
        &mut self,
        stream: Stream,
        source: CameraSource,
        recordings: Recordings,
    ) -> io::Result<()> {
        let (kind, thread) = match stream {
            Stream::Scene => (DeviceKind::SceneCamera, "scene-camera"),
            Stream::Environment => (DeviceKind::EnvironmentCamera, "env-camera"),
        };
        let (name, monitor) = self.add(kind, source.name());
        let (stop, hub) = (Arc::clone(&self.clock), Arc::clone(&self.hub));
        let limits = limits(matches!(source, CameraSource::Replay(_)));
        self.threads.push(threads::spawn(thread, move || {
            let clock: Arc<dyn Clock> = Arc::new(SystemClock);
            let mut open = || open_camera(&source, stream, &recordings, &clock);
            let mut sink = CameraSink {
                stream,
                hub,
                notes: Notes::new(&name, &monitor),
                check: FrameCheck::default(),
            };
            let supervisor = Supervisor {
                name: &name,
                monitor: &monitor,
                clock: &*stop,
                limits,
            };
            supervisor.run(&mut open, &mut sink);
        })?);
        Ok(())
    }

    fn start_tracker(&mut self, source: TrackerSource, recordings: Recordings) -> io::Result<()> {
        let (name, monitor) = self.add(DeviceKind::Tracker, source.name());
        let (stop, hub) = (Arc::clone(&self.clock), Arc::clone(&self.hub));
        let limits = limits(matches!(source, TrackerSource::Replay(_)));
        self.threads.push(threads::spawn("tracker", move || {
            let clock: Arc<dyn Clock> = Arc::new(SystemClock);
            let mut open = || open_tracker(&source, &recordings, &clock);
            let mut sink = TrackerSink {
                protocol: Arc::from(""),
                hub,
                notes: Notes::new(&name, &monitor),
                last: Bytes::new(),
            };
            let supervisor = Supervisor {
                name: &name,
                monitor: &monitor,
                clock: &*stop,
                limits,
            };
            supervisor.run(&mut open, &mut sink);
        })?);
        Ok(())
    }

    fn add(&mut self, kind: DeviceKind, name: String) -> (String, Arc<DeviceMonitor>) {
        let monitor = Arc::<DeviceMonitor>::default();
        self.devices.push(LiveDevice {
            kind,
            name: name.clone(),
            monitor: Arc::clone(&monitor),
        });
        (name, monitor)
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        self.clock.stop();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
        self.hub.end();
    }
}

fn limits(is_replay: bool) -> Limits {
    let mut limits = Limits::default();
    if is_replay {
        limits.reopen_after = REPLAY_REOPEN_AFTER;
    }
    limits
}

/// Notes irregular deliveries of a device.
struct Notes<'a> {
    name: &'a str,
    monitor: &'a DeviceMonitor,
    arrivals: ArrivalCheck,
}

impl<'a> Notes<'a> {
    fn new(name: &'a str, monitor: &'a DeviceMonitor) -> Self {
        let arrivals = ArrivalCheck::default();
        Self {
            name,
            monitor,
            arrivals,
        }
    }

    fn note(&self, kind: Irregularity) {
        self.monitor.irregular(kind, self.name, None);
    }

    fn arrived(&mut self, at: MonotonicTime) {
        if let Some(kind) = self.arrivals.add(at) {
            self.note(kind);
        }
    }
}

/// Puts a camera's pictures into the hub.
struct CameraSink<'a> {
    stream: Stream,
    hub: Arc<Hub>,
    notes: Notes<'a>,
    check: FrameCheck,
}

impl Sink<Frame> for CameraSink<'_> {
    fn report(&mut self, _: &DeviceReport) {}

    fn deliver(&mut self, mut frame: Frame) {
        self.notes.arrived(frame.arrived_at);
        let notes = &self.notes;
        if !self.check.check(&mut frame, |kind| notes.note(kind)) {
            return;
        }
        // The light reads only some of these pictures, so their damage would show late or never.
        if self.stream == Stream::Environment && !is_whole(&frame) {
            notes.note(Irregularity::Undecodable);
            return;
        }
        self.hub.deliver(match self.stream {
            Stream::Scene => SessionEvent::Scene(frame),
            Stream::Environment => SessionEvent::Environment(frame),
        });
    }
}

/// Puts a tracker's bytes into the hub, with the protocol that the driver reports.
struct TrackerSink<'a> {
    protocol: Arc<str>,
    hub: Arc<Hub>,
    notes: Notes<'a>,
    /// The bytes of the delivery before.
    last: Bytes,
}

impl Sink<TrackerBytes> for TrackerSink<'_> {
    fn report(&mut self, report: &DeviceReport) {
        if let DeviceReport::Tracker(report) = report
            && *self.protocol != *report.protocol
        {
            self.protocol = Arc::from(report.protocol.as_str());
        }
    }

    fn deliver(&mut self, item: TrackerBytes) {
        // A sensor at rest sends equal records, but not at once. Short pieces of a record may be equal.
        // They are passed on, because a piece of a record that is missing would damage it.
        let is_long = item.bytes.len() >= MIN_RECORD_BYTES;
        let is_premature = self.notes.arrivals.is_premature(item.arrived_at);
        if is_long && is_premature && item.bytes == self.last {
            self.notes.note(Irregularity::Repeated);
        }
        self.notes.arrived(item.arrived_at);
        self.last = item.bytes.clone();
        self.hub.deliver(SessionEvent::TrackerBytes {
            protocol: Arc::clone(&self.protocol),
            bytes: item.bytes,
            arrived_at: item.arrived_at,
        });
    }
}
