//! Simulates trackers at a pseudo-terminal or by UDP datagrams. A live rig opens them like real
//! devices.

use crate::damage::intact_events;
use crate::service::Service;
use penumbra_interface::SystemClock;
use penumbra_picture::read_text_bounded;
use penumbra_session::{Session, SessionError, SessionEvent};
#[cfg(unix)]
use penumbra_synthetic::Pty;
use penumbra_synthetic::{
    Faults, Recording, SimulatedTracker, Source, Trajectory, TrajectoryError, UdpOutlet,
    UnknownProtocol, serve,
};
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use thiserror::Error;

/// Options of a simulation.
#[derive(Clone, Debug)]
pub struct SimulateOptions {
    /// Name of the protocol; `None` for that of the recording.
    pub protocol: Option<String>,
    /// Address of the device.
    pub place: SimulatedPlace,
    /// Records per second; `None` for the device's default rate.
    pub rate: Option<f64>,
    /// Source of its motion.
    pub source: SimulatedSource,
    /// Faults of its connection.
    pub faults: Faults,
}

/// Address of a simulated tracker.
#[derive(Clone, Debug)]
pub enum SimulatedPlace {
    /// A pseudo-terminal, linked to this path if there is one.
    Pty(Option<PathBuf>),
    /// Datagrams to this address.
    Udp(SocketAddr),
}

/// Source of the motion of a simulated tracker.
#[derive(Clone, Debug)]
pub enum SimulatedSource {
    /// An orbit around a point.
    Orbit,
    /// A file of poses.
    File(PathBuf),
    /// The bytes of a recorded session, with their timing.
    Session(PathBuf),
}

/// An error of a simulation, with a one-line message for the user.
#[derive(Debug, Error)]
pub enum SimulateError {
    /// The session cannot be read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The session has no tracker data.
    #[error(
        "{}: has no tracker data; record a session with a tracker, or omit --session",
        path.display()
    )]
    NoBytes {
        /// The session.
        path: PathBuf,
    },
    /// No protocol was given.
    #[error("no protocol given; add --protocol fastrak, liberty, patriot, flock, freed or csv")]
    NoProtocol,
    /// The protocol is unknown.
    #[error(transparent)]
    Protocol(#[from] UnknownProtocol),
    /// The file of poses is invalid.
    #[error("{}: {source}", path.display())]
    Trajectory {
        /// The file.
        path: PathBuf,
        /// The error in the file.
        source: TrajectoryError,
    },
    /// A file, the pseudo-terminal or the socket failed.
    #[error("{place}: {source}")]
    Io {
        /// Path or address.
        place: String,
        /// The error of the system.
        source: io::Error,
    },
}

/// Simulates until a signal ends the program or the faults end the connection. Calls `ready` with
/// the device's address as soon as it can be opened.
///
/// # Errors
/// The source cannot be read, the protocol is missing or unknown, or a system call fails.
pub fn simulate(options: SimulateOptions, ready: impl FnOnce(&str)) -> Result<(), SimulateError> {
    let (source, recorded) = source(&options.source)?;
    let protocol = options.protocol.or(recorded);
    let protocol = protocol.ok_or(SimulateError::NoProtocol)?;
    let by_datagram = matches!(options.place, SimulatedPlace::Udp(_));
    let mut device = SimulatedTracker::new(&protocol, source, options.rate, by_datagram)?;
    let stop = Arc::new(AtomicBool::new(false));
    let _signals = Service::start(None, Arc::clone(&stop)).map_err(|e| failed("signals", e))?;
    let mut faults = options.faults;
    match options.place {
        SimulatedPlace::Udp(address) => {
            let place = format!("udp:{address}");
            let mut outlet = UdpOutlet::new(address).map_err(|e| failed(&place, e))?;
            ready(&place);
            serve(&mut device, &mut outlet, &mut faults, &SystemClock, &stop)
                .map_err(|e| failed(&place, e))
        }
        SimulatedPlace::Pty(link) => {
            at_pty(&mut device, link.as_deref(), &mut faults, &stop, ready)
        }
    }
}

#[cfg(unix)]
fn at_pty(
    device: &mut SimulatedTracker,
    link: Option<&Path>,
    faults: &mut Faults,
    stop: &AtomicBool,
    ready: impl FnOnce(&str),
) -> Result<(), SimulateError> {
    let mut pty = Pty::open().map_err(|e| failed("pseudo-terminal", e))?;
    let place = link.unwrap_or(pty.path()).display().to_string();
    if let Some(link) = link {
        pty.link(link).map_err(|e| failed(&place, e))?;
    }
    ready(&place);
    serve(device, &mut pty, faults, &SystemClock, stop).map_err(|e| failed(&place, e))
}

#[cfg(not(unix))]
fn at_pty(
    _device: &mut SimulatedTracker,
    _link: Option<&Path>,
    _faults: &mut Faults,
    _stop: &AtomicBool,
    _ready: impl FnOnce(&str),
) -> Result<(), SimulateError> {
    Err(failed("pseudo-terminal", io::ErrorKind::Unsupported.into()))
}

/// Maximum size of a trajectory file, bytes.
const MAX_TRAJECTORY_BYTES: u64 = 64 << 20;

/// Returns the data source, and the protocol of a recording.
fn source(source: &SimulatedSource) -> Result<(Source, Option<String>), SimulateError> {
    match source {
        SimulatedSource::Orbit => Ok((Source::Trajectory(Trajectory::default()), None)),
        SimulatedSource::File(path) => {
            let text = read_text_bounded(path, MAX_TRAJECTORY_BYTES)
                .map_err(|e| failed(&path.display().to_string(), e))?;
            let trajectory =
                Trajectory::parse(&text).map_err(|source| SimulateError::Trajectory {
                    path: path.clone(),
                    source,
                })?;
            Ok((Source::Trajectory(trajectory), None))
        }
        SimulatedSource::Session(path) => {
            let session = Session::open(path)?;
            let recording = recording(&session);
            if recording.is_empty() {
                return Err(SimulateError::NoBytes { path: path.clone() });
            }
            let protocol = session.tracker_protocol().map(str::to_owned);
            Ok((Source::Recording(recording), protocol))
        }
    }
}

/// Returns the tracker's bytes of a session, without damaged records.
fn recording(session: &Session) -> Recording {
    let chunks = intact_events(session).filter_map(|event| match event {
        SessionEvent::TrackerBytes {
            bytes, arrived_at, ..
        } => Some((arrived_at, bytes.to_vec())),
        _ => None,
    });
    Recording::new(chunks.collect())
}

fn failed(place: &str, source: io::Error) -> SimulateError {
    SimulateError::Io {
        place: place.to_owned(),
        source,
    }
}
