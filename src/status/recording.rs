//! Recording, as the status shows it and as it is asked for.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// How a recording goes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Recording {
    /// What the recorder is doing.
    pub state: RecordingState,
    /// That in words, with the reason where there is one.
    pub sentence: String,
    /// The newest recording.
    pub file: Option<String>,
    /// Its size.
    pub bytes: u64,
    /// Its length so far.
    pub seconds: f64,
    /// Until it ends by itself: the disk is full, or it is as long as was asked for.
    pub seconds_left: Option<f64>,
    /// Room on its disk.
    pub free_bytes: Option<u64>,
    /// What was recorded: pictures, readings, notes.
    pub events: u64,
    /// What was not, because the disk was too slow or it could not be written down.
    pub dropped: u64,
}

/// What the recorder is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordingState {
    /// Nothing can be recorded: a recording plays.
    #[default]
    Unavailable,
    /// It waits to be asked.
    Idle,
    /// It records.
    Recording,
    /// It has finished a recording in order.
    Finished,
    /// It had to end one early.
    Failed,
}

impl RecordingState {
    /// As it stands in `/status` and as a metric label.
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
pub struct RecordingWish {
    /// Begin, or end.
    pub record: bool,
    /// Name of the file in the recordings' folder; by date and time without it.
    pub file: Option<String>,
    /// End after so long.
    pub seconds: Option<f64>,
}

/// Why a wish was refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum RecordingRefusal {
    /// The body is something else.
    #[error("recording: {reason}; send a JSON object such as {{\"record\": true}}")]
    Malformed {
        /// What the parser said.
        reason: String,
    },
    /// Nothing can be recorded.
    #[error("recording: a recording plays; only a live rig (`penumbra run`) can be recorded")]
    Unavailable,
    /// One is under way.
    #[error("recording: {file} is being recorded; end that first")]
    Busy {
        /// Which.
        file: String,
    },
    /// The name leads out of the recordings' folder, or is no session's.
    #[error("recording: {file:?} is no plain file name such as desk.mcap")]
    FileName {
        /// As it was sent.
        file: String,
    },
    /// The length is none.
    #[error("recording: {seconds} s is no length; send between 1 and 10000000")]
    Length {
        /// As it was sent.
        seconds: String,
    },
    /// It cannot begin.
    #[error("recording: {reason}")]
    Failed {
        /// Why.
        reason: String,
    },
}

/// Who records when asked to.
pub trait RecordingControl: Send + Sync {
    /// Begins or ends a recording, and says how it goes then.
    ///
    /// # Errors
    /// Why not; nothing has changed then.
    fn carry_out(&self, wish: &RecordingWish) -> Result<Recording, RecordingRefusal>;
}

impl RecordingWish {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// It is something else, or names a file elsewhere.
    pub fn from_json(body: &[u8]) -> Result<Self, RecordingRefusal> {
        let wish: Self =
            serde_json::from_slice(body).map_err(|error| RecordingRefusal::Malformed {
                reason: error.to_string(),
            })?;
        if let Some(seconds) = wish.seconds.filter(|s| !(1.0..=1e7).contains(s)) {
            let seconds = seconds.to_string();
            return Err(RecordingRefusal::Length { seconds });
        }
        match &wish.file {
            Some(file) if !is_plain_name(file) => {
                Err(RecordingRefusal::FileName { file: file.clone() })
            }
            _ => Ok(wish),
        }
    }
}

/// A name within a folder, on any system.
fn is_plain_name(file: &str) -> bool {
    let plain = |c: char| c.is_alphanumeric() || "-_. +=".contains(c);
    let stem = file.strip_suffix(".mcap").unwrap_or_default();
    (1..=200).contains(&stem.len()) && !file.starts_with('.') && file.chars().all(plain)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    fn read(body: &str) -> Result<RecordingWish, RecordingRefusal> {
        RecordingWish::from_json(body.as_bytes())
    }

    #[test]
    fn wishes_are_read_and_files_elsewhere_refused() {
        let wish = read(r#"{"record": true, "file": "desk 1.mcap", "seconds": 5}"#).unwrap();
        assert_eq!(
            (wish.file.as_deref(), wish.seconds),
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
    fn labels_are_what_the_json_says() {
        use RecordingState::{Failed, Finished, Idle, Recording, Unavailable};
        for state in [Unavailable, Idle, Recording, Finished, Failed] {
            assert_eq!(serde_json::to_value(state).unwrap(), state.label());
        }
    }
}
