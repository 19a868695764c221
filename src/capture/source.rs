//! The ways of having a device: real ones and replayed ones are siblings.

use super::{Maker, drivers};
use crate::session::{Camera as Stream, Session, SessionError, SessionEvent};
use penumbra_interface::{
    Camera, CameraSettings, Clock, DeviceError, Frame, Tracker, TrackerBytes,
};
use penumbra_replay::{Items, ReplayCamera, ReplayTracker, Timeline};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Before a recording's file name where a device is expected.
pub const REPLAY_PREFIX: &str = "replay:";

/// How a camera is had.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraSource {
    /// A real one, by the system's driver.
    System(CameraSettings),
    /// One that plays what was recorded of it.
    Replay(PathBuf),
    /// One that the library's user brings along.
    Made(Maker<dyn Camera>),
}

/// How a tracker is had.
#[derive(Clone, Debug, PartialEq)]
pub enum TrackerSource {
    /// A real one, at a serial port or a network address.
    System(Box<crate::config::TrackerConfig>),
    /// One that plays what was recorded of it.
    Replay(PathBuf),
    /// One that the library's user brings along.
    Made(Maker<dyn Tracker>),
}

/// The recordings that are played, each with one time for all its devices.
#[derive(Clone, Default)]
pub struct Recordings(Arc<Mutex<BTreeMap<PathBuf, Recording>>>);

#[derive(Clone)]
struct Recording {
    session: Session,
    timeline: Arc<Timeline>,
}

impl Recordings {
    /// The recording at `path`, opened when first asked for.
    fn open(&self, path: &Path, clock: &Arc<dyn Clock>) -> Result<Recording, DeviceError> {
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(recording) = known.get(path) {
            return Ok(recording.clone());
        }
        let session = Session::open(path).map_err(|error| unplayable(path, &error))?;
        let span = session.span().unwrap_or_default();
        let timeline = Timeline::new(span, Arc::clone(clock), std::thread::sleep);
        let recording = Recording {
            session,
            timeline: Arc::new(timeline),
        };
        known.insert(path.to_owned(), recording.clone());
        Ok(recording)
    }
}

fn unplayable(path: &Path, error: &SessionError) -> DeviceError {
    let device = name_of(path);
    match error {
        SessionError::NotFound { .. } => DeviceError::NotFound { device },
        _ => DeviceError::Refused {
            device,
            reason: error.to_string(),
        },
    }
}

fn name_of(path: &Path) -> String {
    format!("{REPLAY_PREFIX}{}", path.display())
}

impl CameraSource {
    /// Who it is, for messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::System(settings) if settings.device.is_empty() => "the only camera".to_owned(),
            Self::System(settings) => settings.device.clone(),
            Self::Replay(path) => name_of(path),
            Self::Made(maker) => maker.name().to_owned(),
        }
    }

    /// Opens it as the `stream` of the rig.
    ///
    /// # Errors
    /// What the driver says.
    pub fn open(
        &self,
        stream: Stream,
        recordings: &Recordings,
        clock: &Arc<dyn Clock>,
    ) -> Result<Box<dyn Camera>, DeviceError> {
        match self {
            Self::System(settings) => drivers::open_camera(settings, Arc::clone(clock)),
            Self::Made(maker) => maker.open(clock),
            Self::Replay(path) => {
                let recording = recordings.open(path, clock)?;
                let session = recording.session;
                let frames = move || frames(&session, stream);
                let camera =
                    ReplayCamera::new(&name_of(path), recording.timeline, Box::new(frames));
                Ok(Box::new(camera))
            }
        }
    }
}

impl TrackerSource {
    /// Who it is, for messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::System(config) => config.device.clone(),
            Self::Replay(path) => name_of(path),
            Self::Made(maker) => maker.name().to_owned(),
        }
    }

    /// Opens it.
    ///
    /// # Errors
    /// What the driver says; a recording without bytes of a tracker.
    pub fn open(
        &self,
        recordings: &Recordings,
        clock: &Arc<dyn Clock>,
    ) -> Result<Box<dyn Tracker>, DeviceError> {
        match self {
            Self::System(config) => drivers::open_tracker(config),
            Self::Made(maker) => maker.open(clock),
            Self::Replay(path) => {
                let Recording { session, timeline } = recordings.open(path, clock)?;
                let Some(protocol) = session.tracker_protocol().map(str::to_owned) else {
                    return Err(DeviceError::Refused {
                        device: name_of(path),
                        reason: "no bytes of a tracker in it; name another recording".to_owned(),
                    });
                };
                let bytes = move || tracker_bytes(&session);
                Ok(Box::new(ReplayTracker::new(
                    &name_of(path),
                    &protocol,
                    timeline,
                    Box::new(bytes),
                )))
            }
        }
    }
}

fn frames(session: &Session, stream: Stream) -> Items<Frame> {
    let events = session.events().filter_map(Result::ok);
    Box::new(events.filter_map(move |event| match (event, stream) {
        (SessionEvent::Scene(frame), Stream::Scene)
        | (SessionEvent::Environment(frame), Stream::Environment) => Some(frame),
        _ => None,
    }))
}

fn tracker_bytes(session: &Session) -> Items<TrackerBytes> {
    let events = session.events().filter_map(Result::ok);
    Box::new(events.filter_map(|event| match event {
        SessionEvent::TrackerBytes {
            bytes, arrived_at, ..
        } => Some(TrackerBytes { bytes, arrived_at }),
        _ => None,
    }))
}

/// A device that delivers nothing for so long is opened anew; replayed ones have the pauses
/// of their recording.
#[must_use]
pub const fn patience(is_replay: bool) -> Duration {
    Duration::from_secs(if is_replay { 3600 } else { 3 })
}
