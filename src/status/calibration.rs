//! Status of a calibration, and requests to calibrate.

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;
use thiserror::Error;

/// Maximum number of parameters of a request, and of characters in each.
const MAX_PARAMETERS: usize = 16;
const MAX_PARAMETER_BYTES: usize = 200;
/// Maximum duration of a step, seconds.
const MAX_SECONDS: f64 = 7200.0;

/// Status of a calibration: the answer to `GET /calibration`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Calibration {
    /// State.
    pub state: CalibrationState,
    /// The state in words, with the reason if there is one.
    pub description: String,
    /// Name of the step; empty before the first.
    pub step: String,
    /// Title of the step.
    pub title: String,
    /// Its parameters.
    pub parameters: BTreeMap<String, String>,
    /// Progress, 0 to 1.
    pub share: f64,
    /// Collected data, in a few words.
    pub message: String,
    /// What to do next.
    pub hint: String,
    /// A missing device, and the reason.
    pub device_error: Option<String>,
    /// Time since its start, seconds.
    pub seconds: f64,
    /// Pictures given to the step.
    pub pictures: u64,
    /// Pictures that could not be decoded.
    pub damaged: u64,
    /// Pictures skipped while it was busy.
    pub skipped: u64,
    /// Readings of the tracker dropped because a queue was full.
    pub readings_lost: u64,
    /// The newest picture given to the step.
    pub picture: Option<ShownPicture>,
    /// The result.
    pub result: Option<CalibrationResult>,
    /// The available steps.
    pub steps: Vec<StepForm>,
}

/// State of a calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CalibrationState {
    /// Nothing can be calibrated: a recording plays.
    #[default]
    Unavailable,
    /// Ready.
    Idle,
    /// A step collects data.
    Running,
    /// A step computes its result.
    Evaluating,
    /// A step has finished, with any grade.
    Finished,
    /// A step was stopped by an error.
    Failed,
}

impl CalibrationState {
    /// Whether a step is running.
    #[must_use]
    pub const fn is_busy(self) -> bool {
        matches!(self, Self::Running | Self::Evaluating)
    }
}

/// A picture given to a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ShownPicture {
    /// Number of the picture; part of its address.
    pub revision: u64,
    /// Width of the camera's picture, pixels; the preview may be smaller.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// Camera: "scene" or "environment".
    pub camera: String,
    /// Overlay points found in it, pixels of `width` and `height`; (0, 0) is the middle of the first.
    pub points: Vec<[f32; 2]>,
}

/// Result of a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationResult {
    /// "good", "usable" or "refused".
    pub grade: String,
    /// Figures with their uncertainty, one line each.
    pub lines: Vec<String>,
    /// Findings against the result, worst first.
    pub findings: Vec<CalibrationFinding>,
    /// Suggested improvements.
    pub hints: Vec<String>,
    /// The file; `None` if the result was refused or could not be written.
    pub file: Option<String>,
    /// Backup of the previous file.
    pub backup: Option<String>,
    /// Whether `/calibration/report` exists.
    pub report: bool,
}

/// A finding against a calibration.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationFinding {
    /// "usable" or "refused".
    pub grade: String,
    /// Description and remedy.
    pub text: String,
}

/// A step that can be started.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StepForm {
    /// Name for `POST /calibration/start`.
    pub name: &'static str,
    /// Title.
    pub title: &'static str,
    /// Instructions, in a sentence or two.
    pub about: &'static str,
    /// Parameters.
    pub parameters: Vec<ParameterForm>,
}

/// A parameter of a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ParameterForm {
    /// Name for `POST /calibration/start`.
    pub name: &'static str,
    /// Title.
    pub label: &'static str,
    /// Description, in a few words.
    pub hint: &'static str,
    /// Default.
    pub default: &'static str,
    /// Permitted values with titles; empty if any text is permitted.
    pub choices: &'static [(&'static str, &'static str)],
}

/// The body of `POST /calibration/start`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRequest {
    /// Name of the step.
    pub step: String,
    /// Parameters by name.
    #[serde(default)]
    pub parameters: BTreeMap<String, String>,
    /// Duration after which to finish, seconds; `None`: when the data suffice, or on request.
    pub seconds: Option<f64>,
}

/// Why a request was refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum CalibrationRefusal {
    /// The body is malformed.
    #[error(
        "calibration: {reason}; send a JSON object such as {{\"step\": \"intrinsics\", \
         \"parameters\": {{\"board\": \"chess:9x6:0.025\"}}}}"
    )]
    Malformed {
        /// The reason.
        reason: String,
    },
    /// Nothing can be calibrated.
    #[error(
        "calibration: a recording plays; calibrate a live rig (`penumbra run`), or the recording \
         with `penumbra calibrate STEP --session FILE`"
    )]
    Unavailable,
    /// An unknown step or an invalid parameter.
    #[error("calibration: {reason}")]
    Parameter {
        /// The value and the permitted ones.
        reason: String,
    },
    /// A step is running.
    #[error("calibration: `{step}` is running; finish or abort it first")]
    Busy {
        /// Its name.
        step: String,
    },
    /// No step is running.
    #[error("calibration: no step is running; start one first")]
    NotRunning,
    /// The program that calibrates was started for one step.
    #[error("calibration: this program runs a single step; start others with `penumbra run`")]
    OneStep,
    /// The step cannot start.
    #[error("calibration: {reason}")]
    Failed {
        /// Reason and remedy.
        reason: String,
    },
}

/// A calibrator. All methods return the status afterwards.
pub trait CalibrationControl: Send + Sync {
    /// Returns the status.
    fn view(&self) -> Calibration;

    /// Starts a step.
    ///
    /// # Errors
    /// The request cannot be met; nothing changes.
    fn start(&self, request: &CalibrationRequest) -> Result<(), CalibrationRefusal>;

    /// Finishes the step with the data so far.
    ///
    /// # Errors
    /// No step is running.
    fn finish(&self) -> Result<(), CalibrationRefusal>;

    /// Aborts the step without a result.
    ///
    /// # Errors
    /// No step is running.
    fn abort(&self) -> Result<(), CalibrationRefusal>;

    /// Returns a picture given to the step, as JPEG: that of the revision, or the newest.
    fn picture(&self, revision: Option<u64>) -> Option<Bytes>;

    /// Returns the newest report, an HTML page.
    fn report(&self) -> Option<String>;
}

impl CalibrationRequest {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// The body is malformed or too large.
    pub fn from_json(body: &[u8]) -> Result<Self, CalibrationRefusal> {
        let malformed = |reason: String| CalibrationRefusal::Malformed { reason };
        let request: Self =
            serde_json::from_slice(body).map_err(|error| malformed(error.to_string()))?;
        if let Some(seconds) = request.seconds.filter(|s| !(1.0..=MAX_SECONDS).contains(s)) {
            let reason =
                format!("{seconds} s is not a valid duration; send between 1 and {MAX_SECONDS}");
            return Err(CalibrationRefusal::Parameter { reason });
        }
        let pairs = request.parameters.iter();
        let max_len = pairs.map(|(key, value)| key.len().max(value.len())).max();
        if request.parameters.len() > MAX_PARAMETERS
            || max_len.unwrap_or_default().max(request.step.len()) > MAX_PARAMETER_BYTES
        {
            return Err(malformed("too many parameters".to_owned()));
        }
        Ok(request)
    }

    /// Returns the maximum duration.
    #[must_use]
    pub fn longest(&self) -> Option<Duration> {
        self.seconds.map(Duration::from_secs_f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(body: &str) -> Result<CalibrationRequest, CalibrationRefusal> {
        CalibrationRequest::from_json(body.as_bytes())
    }

    #[test]
    fn reads_requests_and_refuses_others_in_one_line() {
        let request = read(
            r#"{"step": "intrinsics", "parameters": {"board": "chess:9x6:0.025"}, "seconds": 60}"#,
        )
        .unwrap();
        assert_eq!(request.parameters["board"], "chess:9x6:0.025");
        assert_eq!(request.longest(), Some(Duration::from_secs(60)));
        assert_eq!(read(r#"{"step": "map"}"#).unwrap().longest(), None);
        let long = "x".repeat(300);
        for body in [
            "",
            "{}",
            "[]",
            r#"{"step": 1}"#,
            r#"{"step": "a", "file": "/etc/passwd"}"#,
            r#"{"step": "a", "parameters": {"a": 1}}"#,
            &format!(r#"{{"step": "a", "parameters": {{"a": "{long}"}}}}"#),
            &format!(r#"{{"step": "{long}"}}"#),
        ] {
            let text = read(body).unwrap_err().to_string();
            assert!(
                text.contains("send a JSON object") && !text.contains('\n'),
                "{text}"
            );
        }
        for seconds in ["0", "-1", "1e9"] {
            let text = read(&format!(r#"{{"step": "a", "seconds": {seconds}}}"#)).unwrap_err();
            assert!(
                text.to_string().contains("is not a valid duration"),
                "{text}"
            );
        }
    }
}
