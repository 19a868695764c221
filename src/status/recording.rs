//! Status of recording, and requests to record.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Status of a recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recording {
    /// State of the recorder.
    pub state: RecordingState,
    /// The state in words, with the reason if there is one.
    pub description: String,
    /// The newest recording.
    pub file: Option<String>,
    /// Its size, bytes.
    pub bytes: u64,
    /// Its length so far, seconds.
    pub seconds: f64,
    /// Time until it ends by itself, by free space or requested length, seconds.
    pub seconds_left: Option<f64>,
    /// Free space on its disk, bytes.
    pub free_bytes: Option<u64>,
    /// Number of recorded messages: pictures, readings, notes.
    pub events: u64,
    /// Number of messages not recorded, because the disk was too slow or they could not be encoded.
    pub dropped: u64,
    /// Whether composited pictures are recorded, too; before a recording as configured.
    pub composite: bool,
    /// Number of composited pictures recorded.
    pub composites: u64,
    /// Number of composited pictures not recorded, because encoder or disk were too slow.
    pub composites_dropped: u64,
    /// Mean data rate, bytes per second; `None` in the first second.
    pub bytes_per_second: Option<f64>,
}

/// State of the recorder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordingState {
    /// Nothing can be recorded: a recording plays.
    #[default]
    Unavailable,
    /// Ready.
    Idle,
    /// Recording.
    Recording,
    /// The last recording was finished.
    Finished,
    /// The last recording ended early.
    Failed,
}

impl RecordingState {
    /// Returns the name in `/status` and in metric labels.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Unavailable => "unavailable",
            Self::Idle => "idle",
            Self::Recording => "recording",
            Self::Finished => "finished",
            Self::Failed => "failed",
        }
    }
}

/// The body of `POST /recording`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingRequest {
    /// Start or stop.
    pub record: bool,
    /// Name of the file in the recordings' folder; by date and time without it.
    pub file: Option<String>,
    /// Duration after which to stop, seconds.
    pub seconds: Option<f64>,
    /// Whether the composited pictures are recorded, too; as configured without it.
    pub composite: Option<bool>,
}

/// Why a request was refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RecordingRefusal {
    /// The body is malformed.
    #[error("recording: {reason}; send a JSON object such as {{\"record\": true}}")]
    Malformed {
        /// The parser's message.
        reason: String,
    },
    /// Nothing can be recorded.
    #[error("recording: a recording plays; only a live rig (`penumbra run`) can be recorded")]
    Unavailable,
    /// A recording is running.
    #[error("recording: {file} is being recorded; stop it first")]
    Busy {
        /// Its file.
        file: String,
    },
    /// The name is outside the recordings' folder or is not a session's.
    #[error("recording: {file:?} is not a plain file name such as desk.mcap")]
    FileName {
        /// The value as sent.
        file: String,
    },
    /// The duration is invalid.
    #[error("recording: {seconds} s is not a valid duration; send between 1 and 10000000")]
    Length {
        /// The value as sent.
        seconds: String,
    },
    /// The recording cannot start.
    #[error("recording: {reason}")]
    Failed {
        /// The reason.
        reason: String,
    },
}

/// A recorder.
pub trait RecordingControl: Send + Sync {
    /// Starts or stops a recording and returns its status.
    ///
    /// # Errors
    /// The request cannot be met; nothing changes.
    fn carry_out(&self, request: &RecordingRequest) -> Result<Recording, RecordingRefusal>;
}

impl RecordingRequest {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// The body is malformed, or names a file outside the folder.
    pub fn from_json(body: &[u8]) -> Result<Self, RecordingRefusal> {
        let request: Self =
            serde_json::from_slice(body).map_err(|error| RecordingRefusal::Malformed {
                reason: error.to_string(),
            })?;
        if let Some(seconds) = request.seconds.filter(|s| !(1.0..=1e7).contains(s)) {
            let seconds = seconds.to_string();
            return Err(RecordingRefusal::Length { seconds });
        }
        match &request.file {
            Some(file) if !is_plain_name(file) => {
                Err(RecordingRefusal::FileName { file: file.clone() })
            }
            _ => Ok(request),
        }
    }
}

/// Whether the name stays within a folder, on any system.
fn is_plain_name(file: &str) -> bool {
    let plain = |c: char| c.is_alphanumeric() || "-_. +=".contains(c);
    let stem = file.strip_suffix(".mcap").unwrap_or_default();
    (1..=200).contains(&stem.len()) && !file.starts_with('.') && file.chars().all(plain)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(body: &str) -> Result<RecordingRequest, RecordingRefusal> {
        RecordingRequest::from_json(body.as_bytes())
    }

    #[test]
    fn reads_requests_and_refuses_files_outside_the_folder() {
        let request = read(r#"{"record": true, "file": "desk 1.mcap", "seconds": 5}"#).unwrap();
        assert_eq!(
            (request.file.as_deref(), request.seconds),
            (Some("desk 1.mcap"), Some(5.0))
        );
        assert!(!read(r#"{"record": false}"#).unwrap().record);
        for file in [
            "../a.mcap",
            "/etc/a.mcap",
            "a/b.mcap",
            "a\\\\b.mcap",
            ".mcap",
            ".a.mcap",
            "a.txt",
            "C:a.mcap",
        ] {
            let refused = read(&format!("{{\"record\": true, \"file\": \"{file}\"}}"));
            assert!(
                matches!(refused, Err(RecordingRefusal::FileName { .. })),
                "{file}"
            );
        }
        for body in [
            "",
            "{}",
            "[]",
            "{\"record\": 1}",
            "{\"record\": true, \"path\": \"a\"}",
        ] {
            let text = read(body).unwrap_err().to_string();
            assert!(text.contains("{\"record\": true}"), "{text}");
        }
        for seconds in ["0", "-1", "1e9"] {
            let refused = read(&format!("{{\"record\": true, \"seconds\": {seconds}}}"));
            assert!(
                matches!(refused, Err(RecordingRefusal::Length { .. })),
                "{seconds}"
            );
        }
    }

    #[test]
    fn labels_equal_the_json_values() {
        use RecordingState::{Failed, Finished, Idle, Recording, Unavailable};
        for state in [Unavailable, Idle, Recording, Finished, Failed] {
            assert_eq!(serde_json::to_value(state).unwrap(), state.label());
        }
    }
}
