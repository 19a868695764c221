//! Opens devices: real ones, recordings that are played as devices, and devices of tests.

use crate::drivers;
use penumbra_config::{CameraSource, TrackerSource, replay_name};
use penumbra_interface::{Camera, Clock, DeviceError, Frame, Tracker, TrackerBytes};
use penumbra_replay::{Items, ReplayCamera, ReplayTracker, Timeline};
use penumbra_session::{Camera as Stream, Session, SessionError, SessionEvent};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// The opened recordings. All devices of one recording share its timeline, so that
/// they stay synchronous.
#[derive(Clone, Default)]
pub struct Recordings(Arc<Mutex<BTreeMap<PathBuf, Recording>>>);

#[derive(Clone)]
struct Recording {
    session: Session,
    timeline: Arc<Timeline>,
    damage: Damage,
}

/// Maximum number of damaged parts of a recording that are named.
const MAX_NAMED: usize = 16;

/// The damaged parts of a recording that were named. It is played again and again, by several
/// devices.
#[derive(Clone, Default)]
struct Damage(Arc<Mutex<BTreeSet<String>>>);

impl Damage {
    /// Warns of a damaged part once.
    fn warn(&self, error: &SessionError) {
        let mut named = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let text = error.to_string();
        if named.len() < MAX_NAMED && named.insert(text) {
            tracing::warn!("{error}");
        }
    }

    /// The events of the recording without its damaged parts.
    fn intact(&self, session: &Session) -> impl Iterator<Item = SessionEvent> + use<> {
        let damage = self.clone();
        let events = session.events();
        events.filter_map(move |event| event.inspect_err(|error| damage.warn(error)).ok())
    }
}

impl Recordings {
    /// Returns the recording at `path`, which is opened at the first call.
    fn open(&self, path: &Path, clock: &Arc<dyn Clock>) -> Result<Recording, DeviceError> {
        let mut opened = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(recording) = opened.get(path) {
            return Ok(recording.clone());
        }
        let session = Session::open(path).map_err(|error| unplayable(path, &error))?;
        let span = session.span().unwrap_or_default();
        let timeline = Timeline::new(span, Arc::clone(clock), std::thread::sleep);
        let recording = Recording {
            session,
            timeline: Arc::new(timeline),
            damage: Damage::default(),
        };
        let found = recording.session.damage();
        found.iter().for_each(|error| recording.damage.warn(error));
        opened.insert(path.to_owned(), recording.clone());
        Ok(recording)
    }
}

fn unplayable(path: &Path, error: &SessionError) -> DeviceError {
    let device = replay_name(path);
    match error {
        SessionError::NotFound { .. } => DeviceError::NotFound { device },
        _ => DeviceError::Refused {
            device,
            reason: error.to_string(),
        },
    }
}

/// Opens a camera. From a recording it plays the pictures of `stream`.
///
/// # Errors
/// The driver's error; a recording that is missing or cannot be read.
pub fn open_camera(
    source: &CameraSource,
    stream: Stream,
    recordings: &Recordings,
    clock: &Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    match source {
        CameraSource::System(settings) => drivers::open_camera(settings, Arc::clone(clock)),
        CameraSource::Custom(factory) => factory.open(clock),
        CameraSource::Replay(path) => {
            let recording = recordings.open(path, clock)?;
            let Recording {
                session,
                timeline,
                damage,
            } = recording;
            let frames = move || frames(&damage, &session, stream);
            let camera = ReplayCamera::new(&replay_name(path), timeline, Box::new(frames));
            Ok(Box::new(camera))
        }
    }
}

/// Opens a tracker.
///
/// # Errors
/// The driver's error; a recording that is missing, cannot be read or has no tracker bytes.
pub fn open_tracker(
    source: &TrackerSource,
    recordings: &Recordings,
    clock: &Arc<dyn Clock>,
) -> Result<Box<dyn Tracker>, DeviceError> {
    match source {
        TrackerSource::System(config) => drivers::open_tracker(config),
        TrackerSource::Custom(factory) => factory.open(clock),
        TrackerSource::Replay(path) => {
            let Recording {
                session,
                timeline,
                damage,
            } = recordings.open(path, clock)?;
            let Some(protocol) = session.tracker_protocol().map(str::to_owned) else {
                return Err(DeviceError::Refused {
                    device: replay_name(path),
                    reason: "it has no tracker data; name another recording".to_owned(),
                });
            };
            let bytes = move || tracker_bytes(&damage, &session);
            Ok(Box::new(ReplayTracker::new(
                &replay_name(path),
                &protocol,
                timeline,
                Box::new(bytes),
            )))
        }
    }
}

fn frames(damage: &Damage, session: &Session, stream: Stream) -> Items<Frame> {
    let events = damage.intact(session);
    Box::new(events.filter_map(move |event| match (event, stream) {
        (SessionEvent::Scene(frame), Stream::Scene)
        | (SessionEvent::Environment(frame), Stream::Environment) => Some(frame),
        _ => None,
    }))
}

fn tracker_bytes(damage: &Damage, session: &Session) -> Items<TrackerBytes> {
    let events = damage.intact(session);
    Box::new(events.filter_map(|event| match event {
        SessionEvent::TrackerBytes {
            bytes, arrived_at, ..
        } => Some(TrackerBytes { bytes, arrived_at }),
        _ => None,
    }))
}
