//! Calibration, as the dashboard shows it and as it is asked for.

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;
use thiserror::Error;

/// Parameters that a wish may have, and characters in each.
const MOST_PARAMETERS: usize = 16;
const LONGEST_PARAMETER: usize = 200;
/// The longest that a step may be shown things, seconds.
const LONGEST: f64 = 7200.0;

/// How a calibration goes: the answer to `GET /calibration`.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Calibration {
    /// What is being done.
    pub state: CalibrationState,
    /// That in words, with the reason where there is one.
    pub sentence: String,
    /// Which step; empty before the first.
    pub step: String,
    /// Its name for people.
    pub title: String,
    /// What it was started with.
    pub parameters: BTreeMap<String, String>,
    /// Of what it needs, 0 to 1.
    pub share: f64,
    /// What it has, in a few words.
    pub message: String,
    /// What to do next.
    pub hint: String,
    /// A device that it waits for, and why.
    pub trouble: Option<String>,
    /// Since its beginning.
    pub seconds: f64,
    /// Pictures that it was shown.
    pub pictures: u64,
    /// Pictures that could not be decoded.
    pub damaged: u64,
    /// Pictures that came while it was busy.
    pub passed_over: u64,
    /// Readings of the tracker that found no room.
    pub readings_lost: u64,
    /// The newest picture that it was shown.
    pub picture: Option<ShownPicture>,
    /// What was found in the end.
    pub result: Option<CalibrationResult>,
    /// The steps that there are.
    pub steps: Vec<StepForm>,
}

/// What is being done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum CalibrationState {
    /// Nothing can be calibrated: a recording plays.
    #[default]
    Unavailable,
    /// It waits to be asked.
    Idle,
    /// A step is shown what devices deliver.
    Running,
    /// A step concludes from what it has seen.
    Evaluating,
    /// A step has come to its end, well or not.
    Finished,
    /// A step could not come to its end.
    Failed,
}

impl CalibrationState {
    /// A step is at work.
    #[must_use]
    pub const fn is_busy(self) -> bool {
        matches!(self, Self::Running | Self::Evaluating)
    }
}

/// A picture that a step was shown.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ShownPicture {
    /// Rises with each; part of the picture's address.
    pub revision: u64,
    /// As the camera sent it; the preview may be smaller.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Whose: "scene" or "environment".
    pub eye: String,
    /// What was found in it, pixels of `width` and `height`; (0, 0) is the middle of the first.
    pub marks: Vec<[f32; 2]>,
}

/// What a step found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationResult {
    /// "good", "usable" or "refused".
    pub verdict: String,
    /// Figures with their uncertainty, a line each.
    pub lines: Vec<String>,
    /// What speaks against it, worst first.
    pub findings: Vec<CalibrationFinding>,
    /// What would make it better.
    pub hints: Vec<String>,
    /// Where it was written; none if it was refused or could not be.
    pub file: Option<String>,
    /// Where the one before it went.
    pub backup: Option<String>,
    /// There is a page at `/calibration/report`.
    pub report: bool,
}

/// What speaks against a calibration.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CalibrationFinding {
    /// "usable" or "refused".
    pub grade: String,
    /// What, and what to do.
    pub text: String,
}

/// A step that can be started.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct StepForm {
    /// As `POST /calibration/start` wants it.
    pub name: &'static str,
    /// For people.
    pub title: &'static str,
    /// What to do, in a sentence or two.
    pub about: &'static str,
    /// What has to be said.
    pub parameters: Vec<ParameterForm>,
}

/// A parameter of a step.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ParameterForm {
    /// As `POST /calibration/start` wants it.
    pub name: &'static str,
    /// For people.
    pub label: &'static str,
    /// What it means, in a few words.
    pub hint: &'static str,
    /// Without it.
    pub default: &'static str,
    /// What it may be: value and name for people; empty where any text may be.
    pub choices: &'static [(&'static str, &'static str)],
}

/// The body of `POST /calibration/start`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationWish {
    /// Which step.
    pub step: String,
    /// By name.
    #[serde(default)]
    pub parameters: BTreeMap<String, String>,
    /// End after so long; without it when it has enough, or is asked to.
    pub seconds: Option<f64>,
}

/// Why a wish was refused.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum CalibrationRefusal {
    /// The body is something else.
    #[error(
        "calibration: {reason}; send a JSON object such as {{\"step\": \"intrinsics\", \
         \"parameters\": {{\"board\": \"chess:9x6:0.025\"}}}}"
    )]
    Malformed {
        /// What is wrong.
        reason: String,
    },
    /// Nothing can be calibrated.
    #[error(
        "calibration: a recording plays; calibrate a live rig (`penumbra run`), or the recording \
         with `penumbra calibrate STEP --session FILE`"
    )]
    Unavailable,
    /// A step or a parameter that cannot be had.
    #[error("calibration: {reason}")]
    Parameter {
        /// What, and what could be.
        reason: String,
    },
    /// One is under way.
    #[error("calibration: `{step}` is under way; finish or abort that first")]
    Busy {
        /// Which.
        step: String,
    },
    /// Nothing is under way.
    #[error("calibration: nothing is under way; start a step first")]
    NotRunning,
    /// The program that calibrates was started for one step.
    #[error(
        "calibration: this program carries out one step alone; start others with `penumbra run`"
    )]
    OneStep,
    /// It cannot begin.
    #[error("calibration: {reason}")]
    Failed {
        /// Why, and what to do.
        reason: String,
    },
}

/// Who calibrates when asked to. All answers say how it goes then.
pub trait CalibrationControl: Send + Sync {
    /// How it goes.
    fn view(&self) -> Calibration;

    /// Begins.
    ///
    /// # Errors
    /// Why not; nothing has changed then.
    fn start(&self, wish: &CalibrationWish) -> Result<(), CalibrationRefusal>;

    /// Concludes from what has been seen.
    ///
    /// # Errors
    /// Nothing is under way.
    fn finish(&self) -> Result<(), CalibrationRefusal>;

    /// Ends it without a result.
    ///
    /// # Errors
    /// Nothing is under way.
    fn abort(&self) -> Result<(), CalibrationRefusal>;

    /// A picture that the step was shown, as JPEG: that of the revision, or the newest.
    fn picture(&self, revision: Option<u64>) -> Option<Bytes>;

    /// The newest report, a page of its own.
    fn report(&self) -> Option<String>;
}

impl CalibrationWish {
    /// Reads the body of a request.
    ///
    /// # Errors
    /// It is something else, or larger than any wish is.
    pub fn from_json(body: &[u8]) -> Result<Self, CalibrationRefusal> {
        let malformed = |reason: String| CalibrationRefusal::Malformed { reason };
        let wish: Self =
            serde_json::from_slice(body).map_err(|error| malformed(error.to_string()))?;
        if let Some(seconds) = wish.seconds.filter(|s| !(1.0..=LONGEST).contains(s)) {
            let reason = format!("{seconds} s is no length; send between 1 and {LONGEST}");
            return Err(CalibrationRefusal::Parameter { reason });
        }
        let pairs = wish.parameters.iter();
        let longest = pairs.map(|(key, value)| key.len().max(value.len())).max();
        if wish.parameters.len() > MOST_PARAMETERS
            || longest.unwrap_or_default().max(wish.step.len()) > LONGEST_PARAMETER
        {
            return Err(malformed("more than any step takes".to_owned()));
        }
        Ok(wish)
    }

    /// The longest that it may take.
    #[must_use]
    pub fn longest(&self) -> Option<Duration> {
        self.seconds.map(Duration::from_secs_f64)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    fn read(body: &str) -> Result<CalibrationWish, CalibrationRefusal> {
        CalibrationWish::from_json(body.as_bytes())
    }

    #[test]
    fn wishes_are_read_and_what_is_none_is_refused_in_one_line() {
        let wish = read(
            r#"{"step": "intrinsics", "parameters": {"board": "chess:9x6:0.025"}, "seconds": 60}"#,
        )
        .unwrap();
        assert_eq!(wish.parameters["board"], "chess:9x6:0.025");
        assert_eq!(wish.longest(), Some(Duration::from_secs(60)));
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
            assert!(text.to_string().contains("is no length"), "{text}");
        }
    }
}
