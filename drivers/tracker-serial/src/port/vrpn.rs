//! A tracker of a VRPN server, over TCP.

use crate::settings::TrackerSettings;
use crate::vrpn::{Client, VrpnError};
use bytes::Bytes;
use penumbra_interface::{
    Clock, DeviceError, MonotonicTime, SystemClock, Tracker, TrackerBytes, TrackerReport,
};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Time limit for the server's cookie and the first pose, sufficient for a slow network.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(3);

/// The device by which every VRPN server controls its connections.
const CONTROL: &str = "VRPN Control";
/// Maximum number of the server's names in a message.
const MAX_NAMES: usize = 8;
/// Maximum length of one of them, characters.
const MAX_NAME_LENGTH: usize = 60;

/// A connection to a VRPN server.
#[derive(Debug)]
pub struct VrpnTracker {
    stream: TcpStream,
    client: Client,
    settings: TrackerSettings,
    tracker: String,
    report: TrackerReport,
    /// When the last pose arrived.
    last_pose_at: MonotonicTime,
    buffer: Box<[u8]>,
    /// The tracker's messages that have not been passed on yet.
    messages: Vec<u8>,
}

impl VrpnTracker {
    /// Connects to `host` (`HOST:PORT`) and waits for the first pose of `tracker`.
    ///
    /// # Errors
    /// The host is unknown or does not answer, it is no VRPN server, it has no such tracker (the
    /// error lists its trackers), or it sends no pose.
    pub fn open(
        settings: &TrackerSettings,
        tracker: &str,
        host: &str,
    ) -> Result<Self, DeviceError> {
        let device = settings.port.to_string();
        let mut opened = Self {
            stream: connect(host, &device)?,
            client: Client::new(tracker),
            settings: settings.clone(),
            tracker: tracker.to_owned(),
            report: TrackerReport {
                identity: device,
                protocol: "vrpn".to_owned(),
                ..TrackerReport::default()
            },
            last_pose_at: SystemClock.now(),
            buffer: vec![0; 16 * 1024].into(),
            messages: Vec::new(),
        };
        let greeting = opened.client.greeting();
        opened
            .stream
            .write_all(&greeting)
            .map_err(|error| opened.failed(&error))?;
        opened.await_pose()?;
        let devices = listed(opened.client.senders());
        opened.report.description = Some(format!("VRPN server with {devices}"));
        Ok(opened)
    }

    fn await_pose(&mut self) -> Result<(), DeviceError> {
        let until = SystemClock.now() + HANDSHAKE_TIMEOUT;
        while self.messages.is_empty() {
            let left = until.nanos_since(SystemClock.now());
            let Ok(left @ 1..) = u64::try_from(left) else {
                return Err(self.no_pose_error());
            };
            self.read(Duration::from_nanos(left))?;
        }
        Ok(())
    }

    /// The error of a tracker that has sent no pose. Its name among the server's devices proves
    /// nothing, because a server repeats the name that a client asks for; poses of others do.
    fn no_pose_error(&self) -> DeviceError {
        if !self.client.greeted() {
            return self.silent(HANDSHAKE_TIMEOUT.as_millis() as u64);
        }
        let is_other = |name: &&str| *name != self.tracker && *name != CONTROL;
        let tracker = &self.tracker;
        let others = match listed(self.client.trackers().filter(is_other)) {
            names if !names.is_empty() => format!("trackers that send some: {names}"),
            _ => match listed(self.client.senders().filter(is_other)) {
                names if !names.is_empty() => format!("other devices of the server: {names}"),
                _ => "the server names no other device".to_owned(),
            },
        };
        self.unready(format!(
            "no pose of a tracker {tracker:?}; {others}; check the name before the @ in `device`, \
             and that the tracker is on"
        ))
    }

    /// Reads once and appends the messages of the tracker to `messages`.
    fn read(&mut self, timeout: Duration) -> Result<(), DeviceError> {
        // Zero would mean no time limit.
        let timeout = timeout.max(Duration::from_micros(1));
        let read = self
            .stream
            .set_read_timeout(Some(timeout))
            .and_then(|()| self.stream.read(&mut self.buffer));
        let arrived_at = SystemClock.now();
        let count = match read {
            Ok(0) => return Err(self.unplugged()),
            Ok(count) => count,
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {
                    return Ok(());
                }
                _ => return Err(self.failed(&error)),
            },
        };
        self.report.bytes += count as u64;
        let bytes = self.buffer.get(..count).unwrap_or_default();
        match self.client.push(bytes, &mut self.messages) {
            Ok(()) => {}
            Err(VrpnError::Closed) => return Err(self.unplugged()),
            Err(error) => return Err(self.unready(error.to_string())),
        }
        if !self.messages.is_empty() {
            self.last_pose_at = arrived_at;
        }
        Ok(())
    }

    fn unplugged(&self) -> DeviceError {
        DeviceError::Unplugged {
            device: self.settings.port.to_string(),
        }
    }

    fn silent(&self, millis: u64) -> DeviceError {
        DeviceError::Silent {
            device: self.settings.port.to_string(),
            millis,
        }
    }

    fn unready(&self, reason: String) -> DeviceError {
        DeviceError::Unready {
            device: self.settings.port.to_string(),
            reason,
        }
    }

    fn failed(&self, error: &std::io::Error) -> DeviceError {
        match error.kind() {
            ErrorKind::BrokenPipe | ErrorKind::ConnectionReset | ErrorKind::ConnectionAborted => {
                self.unplugged()
            }
            _ => self.unready(error.to_string()),
        }
    }
}

impl Tracker for VrpnTracker {
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        let until = SystemClock.now() + timeout;
        loop {
            if !self.messages.is_empty() {
                let bytes = Bytes::copy_from_slice(&self.messages);
                self.messages.clear();
                let arrived_at = self.last_pose_at;
                return Ok(Some(TrackerBytes { bytes, arrived_at }));
            }
            let now = SystemClock.now();
            let silent = u64::try_from(now.nanos_since(self.last_pose_at) / 1_000_000).unwrap_or(0);
            if silent >= self.settings.silence_millis {
                return Err(self.silent(silent));
            }
            let Ok(left @ 1..) = u64::try_from(until.nanos_since(now)) else {
                return Ok(None);
            };
            self.read(Duration::from_nanos(left))?;
        }
    }

    fn report(&self) -> TrackerReport {
        self.report.clone()
    }
}

/// Lists names from a server: few, and without control characters.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let mut names = names.map(|name| {
        let printable = name.chars().filter(|character| !character.is_control());
        printable.take(MAX_NAME_LENGTH).collect::<String>()
    });
    let mut shown: Vec<_> = names.by_ref().take(MAX_NAMES).collect();
    if names.next().is_some() {
        shown.push("…".to_owned());
    }
    shown.join(", ")
}

fn connect(host: &str, device: &str) -> Result<TcpStream, DeviceError> {
    let unready = |reason| DeviceError::Unready {
        device: device.to_owned(),
        reason,
    };
    let addresses = host
        .to_socket_addrs()
        .map_err(|error| unready(format!("the host {host} is unknown ({error})")))?;
    let mut refusal = format!("{host} has no address");
    for address in addresses {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(stream) => {
                let ready = stream
                    .set_nodelay(true)
                    .and_then(|()| stream.set_write_timeout(Some(CONNECT_TIMEOUT)));
                return ready
                    .map(|()| stream)
                    .map_err(|error| unready(error.to_string()));
            }
            Err(error) => refusal = format!("no VRPN server at {address} ({error})"),
        }
    }
    Err(unready(refusal))
}
