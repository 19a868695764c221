//! Simulated devices in the place of real ones: a tracker at a pseudo-terminal or behind
//! datagrams, which the live rig cannot tell from one that is plugged in.

use crate::service::Service;
use penumbra_interface::SystemClock;
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

/// What to simulate, and where.
#[derive(Clone, Debug)]
pub struct SimulateOptions {
    /// A protocol's name; `None` for the recording's.
    pub protocol: Option<String>,
    /// Where the device is to be found.
    pub place: SimulatedPlace,
    /// Records a second; `None` for the device's own rate.
    pub rate: Option<f64>,
    /// What moves it.
    pub source: SimulatedSource,
    /// What is wrong with its line.
    pub faults: Faults,
}

/// Where a simulated tracker is to be found.
#[derive(Clone, Debug)]
pub enum SimulatedPlace {
    /// A pseudo-terminal, under this name too if there is one.
    Pty(Option<PathBuf>),
    /// Datagrams to this address.
    Udp(SocketAddr),
}

/// What moves a simulated tracker.
#[derive(Clone, Debug)]
pub enum SimulatedSource {
    /// Once around a point.
    Orbit,
    /// A file of poses.
    File(PathBuf),
    /// The bytes of a recorded session, as they came.
    Session(PathBuf),
}

/// The simulation cannot start or go on. Each text is the one line that the user gets.
#[derive(Debug, Error)]
pub enum SimulateError {
    /// The recording.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// It has no tracker's bytes.
    #[error("{}: holds no bytes of a tracker; record one, or leave --session out", path.display())]
    NoBytes {
        /// The session.
        path: PathBuf,
    },
    /// Nobody said which protocol.
    #[error("which tracker? add --protocol fastrak, liberty, patriot, flock, freed or csv")]
    NoProtocol,
    /// Nobody speaks it.
    #[error(transparent)]
    Protocol(#[from] UnknownProtocol),
    /// The file of poses.
    #[error("{}: {source}", path.display())]
    Trajectory {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: TrajectoryError,
    },
    /// A file, the pseudo-terminal, the socket.
    #[error("{place}: {source}")]
    Io {
        /// Path or address.
        place: String,
        /// What the system says.
        source: io::Error,
    },
}

/// Simulates until a signal ends the program or the faults say to hang up. `ready` is told
/// where the device is as soon as it can be opened.
///
/// # Errors
/// Unreadable sources, an unknown protocol, and what the system refuses.
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

/// What is sent, and the protocol of a recording.
fn source(source: &SimulatedSource) -> Result<(Source, Option<String>), SimulateError> {
    match source {
        SimulatedSource::Orbit => Ok((Source::Trajectory(Trajectory::default()), None)),
        SimulatedSource::File(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|e| failed(&path.display().to_string(), e))?;
            let path_of_it =
                Trajectory::parse(&text).map_err(|source| SimulateError::Trajectory {
                    path: path.clone(),
                    source,
                })?;
            Ok((Source::Trajectory(path_of_it), None))
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

/// The tracker's bytes of a session, damaged stretches left out.
fn recording(session: &Session) -> Recording {
    let chunks = session.events().filter_map(|event| match event {
        Ok(SessionEvent::TrackerBytes {
            bytes, arrived_at, ..
        }) => Some((arrived_at, bytes.to_vec())),
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
