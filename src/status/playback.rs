//! Playback of a recording: pause, position, repetition.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// What the rig shall do with the recording; written by requests, read by the rig.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Playback {
    /// Whether the picture stands still.
    pub paused: bool,
    /// Whether the recording starts again at its end; otherwise it pauses there.
    pub repeat: bool,
    /// Number of times that a pause has ended.
    pub resumes: u64,
    /// Number of jumps requested.
    pub jumps: u64,
    /// Where the newest jump leads, share of the recording, 0..=1.
    pub position: f64,
}

/// Status of the playback.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaybackStatus {
    /// Why the playback cannot be controlled; `None` if it can.
    pub closed: Option<String>,
    /// Whether the picture stands still; filled in when the snapshot is read.
    pub paused: bool,
    /// Whether the recording is repeated; filled in likewise.
    pub repeat: bool,
    /// Number of jumps requested; filled in likewise.
    pub jumps_requested: u64,
    /// Number of the jump after which the newest picture was composed.
    pub jumps: u64,
    /// Length of the recording, seconds.
    pub duration_s: Option<f64>,
}

impl Default for PlaybackStatus {
    fn default() -> Self {
        Self {
            closed: Some("no recording plays".to_owned()),
            paused: false,
            repeat: false,
            jumps_requested: 0,
            jumps: 0,
            duration_s: None,
        }
    }
}

/// The body of `POST /playback`; omitted fields keep their values.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaybackChange {
    /// Pause or go on.
    pub paused: Option<bool>,
    /// Start again at the end or pause there.
    pub repeat: Option<bool>,
    /// Jump to this share of the recording, 0..=1.
    pub position: Option<f64>,
}

/// Why a change was refused; nothing of it is applied.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlaybackRefusal {
    /// The body is malformed.
    #[error("playback: {reason}; send a JSON object such as {{\"paused\": true}}")]
    Malformed {
        /// The parser's message.
        reason: String,
    },
    /// Out of range or not a number.
    #[error("position: {position} is not a share of the recording; choose a number from 0 to 1")]
    Position {
        /// The requested value.
        position: f64,
    },
    /// The playback cannot be controlled.
    #[error("playback: {reason}")]
    Closed {
        /// The reason.
        reason: String,
    },
}

impl PlaybackChange {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// The body is malformed, or the position is out of range.
    pub fn from_json(body: &[u8]) -> Result<Self, PlaybackRefusal> {
        let change: Self =
            serde_json::from_slice(body).map_err(|error| PlaybackRefusal::Malformed {
                reason: error.to_string(),
            })?;
        match change.position.filter(|p| !(0.0..=1.0).contains(p)) {
            Some(position) => Err(PlaybackRefusal::Position { position }),
            None => Ok(change),
        }
    }

    /// Applies the change.
    pub const fn apply_to(&self, playback: &mut Playback) {
        if let Some(paused) = self.paused {
            if playback.paused && !paused {
                playback.resumes += 1;
            }
            playback.paused = paused;
        }
        if let Some(repeat) = self.repeat {
            playback.repeat = repeat;
        }
        if let Some(position) = self.position {
            playback.position = position;
            playback.jumps += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn omitted_fields_keep_their_values_and_each_position_is_a_jump() {
        let read = |body: &str| PlaybackChange::from_json(body.as_bytes()).unwrap();
        let mut playback = Playback::default();
        read(r#"{"paused": true, "position": 0.25}"#).apply_to(&mut playback);
        read(r#"{"repeat": true}"#).apply_to(&mut playback);
        read(r#"{"position": 0.25}"#).apply_to(&mut playback);
        let expected = Playback {
            paused: true,
            repeat: true,
            resumes: 0,
            jumps: 2,
            position: 0.25,
        };
        assert_eq!(playback, expected);
    }

    #[test]
    fn refuses_what_is_no_share_and_unknown_fields() {
        let text = |body: &str| {
            let refused = PlaybackChange::from_json(body.as_bytes());
            refused.unwrap_err().to_string()
        };
        assert_eq!(
            text(r#"{"position": 1.5}"#),
            "position: 1.5 is not a share of the recording; choose a number from 0 to 1"
        );
        assert!(text(r#"{"pause": true}"#).contains("unknown field `pause`"));
        assert!(text("").contains("{\"paused\": true}"));
    }
}
