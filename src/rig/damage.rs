//! The damaged parts of a recording, for the user: warnings, status, report.

use penumbra_session::{Camera, LostMessages, Session, SessionError, SessionEvent};
use penumbra_status::SharedStatus;
use serde::Serialize;

/// Maximum number of damaged parts that are named in the log.
const MAX_LOGGED: u64 = 16;
/// Maximum number of damaged parts that are listed in the report.
const MAX_LISTED: usize = 256;

/// Returns the events of a recording, and warns of its damaged parts.
pub(super) fn intact_events(session: &Session) -> impl Iterator<Item = SessionEvent> {
    let mut number = 0;
    let mut warn = move |error: &SessionError| {
        log(error, number);
        number += 1;
    };
    session.damage().iter().for_each(&mut warn);
    let events = session.events();
    events.filter_map(move |event| event.inspect_err(&mut warn).ok())
}

/// Warns of the damaged part with this number.
pub(super) fn log(error: &SessionError, number: u64) {
    if number < MAX_LOGGED {
        tracing::warn!("{error}");
    } else if number == MAX_LOGGED {
        tracing::warn!("further damaged parts are only counted");
    }
}

/// Counts of what the damaged parts of a recording held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LostCounts {
    /// Pictures of the scene camera.
    pub scene_frames: u64,
    /// Pictures of the environment camera, brackets included.
    pub environment_frames: u64,
    /// Messages of the tracker.
    pub tracker_messages: u64,
}

/// A damaged part of a recording, in the report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DamagedPart {
    /// What is damaged, and where.
    pub description: String,
    /// The messages that it held, as far as they are known.
    pub lost: Vec<LostMessages>,
}

/// Damaged parts so far. Repetitions of the recording count once.
#[derive(Debug, Default)]
pub(super) struct DamageLog {
    pub parts: Vec<DamagedPart>,
    pub counts: LostCounts,
    number: u64,
    is_complete: bool,
}

impl DamageLog {
    /// Starts with the damage that was found when the recording was opened.
    pub fn new(found: &[SessionError], status: &SharedStatus) -> Self {
        let mut log = Self::default();
        found.iter().for_each(|error| log.count(error, status));
        log
    }

    /// Adds a damaged part, and warns of it.
    pub fn add(&mut self, error: &SessionError, status: &SharedStatus) {
        if self.is_complete {
            return;
        }
        log(error, self.number);
        self.count(error, status);
    }

    fn count(&mut self, error: &SessionError, status: &SharedStatus) {
        self.number += 1;
        let description = error.to_string();
        status.update(|s| s.warn(&description));
        for lost in error.lost() {
            self.counts.scene_frames += lost.pictures_of(Camera::Scene);
            self.counts.environment_frames += lost.pictures_of(Camera::Environment);
            self.counts.tracker_messages += lost.tracker_messages();
        }
        if self.parts.len() < MAX_LISTED {
            self.parts.push(DamagedPart {
                description,
                lost: error.lost().to_vec(),
            });
        }
    }

    /// Ends the first pass over the recording.
    pub const fn complete(&mut self) {
        self.is_complete = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_status::Settings;

    fn damaged(offset: u64) -> SessionError {
        let lost = |stream: &str, messages| LostMessages {
            stream: Some(stream.to_owned()),
            messages: Some(messages),
            from_seconds: 1.0,
            to_seconds: 2.0,
        };
        SessionError::Damaged {
            path: "session.mcap".into(),
            offset,
            reason: "a chunk's checksum is wrong".to_owned(),
            lost: vec![
                lost("/scene_camera/image", 12),
                lost("/environment_camera/image_ev-4", 3),
                lost("/tracker/bytes", 40),
            ],
        }
    }

    #[test]
    fn damage_stands_in_the_status_and_counts_once() {
        let status = SharedStatus::new(Settings::default());
        let mut log = DamageLog::new(&[damaged(1)], &status);
        log.add(&damaged(2), &status);
        log.complete();
        log.add(&damaged(2), &status);
        let expected = LostCounts {
            scene_frames: 24,
            environment_frames: 6,
            tracker_messages: 80,
        };
        assert_eq!((log.counts, log.parts.len()), (expected, 2));
        let warnings = status.snapshot().warnings;
        assert_eq!(warnings.len(), 2);
        let text = "12 of /scene_camera/image from 1.000 s to 2.000 s";
        assert!(warnings[0].text.contains(text), "{}", warnings[0].text);
    }
}
