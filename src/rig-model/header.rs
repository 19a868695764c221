//! The header of calibration files, and their errors.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Version of the format.
pub const VERSION: u32 = 1;
/// Maximum size of a calibration file, bytes.
const MAX_FILE_BYTES: usize = 16 << 20;

/// Step, date, source and quality of a calibration; flattened into the file's object.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Header {
    /// Version of the format.
    pub penumbra_calibration: u32,
    /// Calibration step.
    pub step: String,
    /// Date, UTC, ISO 8601.
    pub date: String,
    /// Source: a session, or "live".
    #[serde(default)]
    pub source: String,
    /// Device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceRecord>,
    /// "good", "usable" or "refused".
    #[serde(default)]
    pub verdict: String,
    /// Reasons for a grade below good.
    #[serde(default)]
    pub findings: Vec<String>,
}

/// A camera.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct DeviceRecord {
    /// Name that the device reports.
    pub name: String,
    /// Serial number, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
}

/// Quality of a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// Suitable for everything.
    Good,
    /// Usable, but could be improved.
    Usable,
    /// Not usable: it may be wrong.
    Refused,
}

impl Grade {
    /// Name in files and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Usable => "usable",
            Self::Refused => "refused",
        }
    }
}

/// A calibration file that cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum CalibrationFileError {
    /// The file is not JSON, or has another structure.
    #[error("{file}: line {line}, column {column}: {reason}; calibrate again, or correct the JSON")]
    NotJson {
        /// Its name.
        file: String,
        /// From 1.
        line: usize,
        /// From 1.
        column: usize,
        /// The parser's words.
        reason: String,
    },
    /// A value is invalid.
    #[error("{file}: `{key}` must be {expected}")]
    Wrong {
        /// Its name.
        file: String,
        /// The key.
        key: &'static str,
        /// What the value should be.
        expected: &'static str,
    },
    /// The file does not apply to the rig.
    #[error("{file}: {reason}")]
    Unusable {
        /// Its name.
        file: String,
        /// The reason, and what to do.
        reason: String,
    },
}

impl Header {
    /// Checks that `file` can be used for `step`.
    ///
    /// # Errors
    /// The file is of another step, of a newer Penumbra, or was refused when it was made.
    pub fn check(&self, file: &str, step: &str) -> Result<(), CalibrationFileError> {
        let unusable = |reason: String| CalibrationFileError::Unusable {
            file: file.to_owned(),
            reason,
        };
        if self.penumbra_calibration != VERSION {
            return Err(CalibrationFileError::Wrong {
                file: file.to_owned(),
                key: "penumbra_calibration",
                expected: "1: it is of a newer Penumbra",
            });
        }
        if self.step != step {
            return Err(unusable(format!(
                "is of the step `{}`, not `{step}`; rename it",
                one_line(&self.step)
            )));
        }
        if self.verdict == Grade::Refused.name() {
            return Err(unusable(
                "was refused when it was made; calibrate again, or remove it".to_owned(),
            ));
        }
        Ok(())
    }
}

/// Reads the bytes of the calibration file `file`.
///
/// # Errors
/// The file is larger than 16 MiB, not JSON, or has another structure (with line and column).
pub fn parse<T: DeserializeOwned>(file: &str, bytes: &[u8]) -> Result<T, CalibrationFileError> {
    if bytes.len() > MAX_FILE_BYTES {
        return Err(CalibrationFileError::Unusable {
            file: file.to_owned(),
            reason: "more than 16 MiB; is it the right file?".to_owned(),
        });
    }
    serde_json::from_slice(bytes).map_err(|e| CalibrationFileError::NotJson {
        file: file.to_owned(),
        line: e.line(),
        column: e.column(),
        reason: one_line(&e.to_string()),
    })
}

/// Words from a file on one line of at most 200 characters.
fn one_line(words: &str) -> String {
    let visible = |c: char| if c.is_control() { ' ' } else { c };
    words.chars().map(visible).take(200).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_with_words_from_a_file_are_one_short_line() {
        let step = format!("\nlens{}", "x".repeat(1000));
        let file = serde_json::json!({"penumbra_calibration": 1, "step": step, "date": ""});
        let header: Header = parse("lens.json", file.to_string().as_bytes()).unwrap();
        let message = header.check("lens.json", "lens").unwrap_err().to_string();
        assert!(message.starts_with("lens.json: is of the step ` lensxxx"));
        assert!(!message.contains('\n') && message.len() < 300, "{message}");
    }
}
