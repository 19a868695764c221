//! What every calibration file begins with.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Version of the format.
pub const VERSION: u32 = 1;
/// No such file is larger, bytes.
const LARGEST_FILE: usize = 16 << 20;

/// Of which step, when, from what, how good; flattened into the file's own object.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Header {
    /// Version of the format.
    pub penumbra_calibration: u32,
    /// Which step made it.
    pub step: String,
    /// When, UTC, as ISO 8601.
    pub date: String,
    /// From what: a session, or "live".
    #[serde(default)]
    pub source: String,
    /// Which device.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<DeviceRecord>,
    /// "good", "usable" or "refused".
    #[serde(default)]
    pub verdict: String,
    /// Why not good.
    #[serde(default)]
    pub findings: Vec<String>,
}

/// The camera itself.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct DeviceRecord {
    /// As it calls itself.
    pub name: String,
    /// Its serial number, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
}

/// What a calibration may be used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grade {
    /// For everything.
    Good,
    /// It can be used; something would make it better.
    Usable,
    /// Not to be used: it may be wrong.
    Refused,
}

impl Grade {
    /// As files and reports spell it.
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
    /// Not JSON, or not of this form.
    #[error("{file}: line {line}, column {column}: {reason}; calibrate again, or mend the JSON")]
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
    /// A value that makes no sense.
    #[error("{file}: `{key}` must be {expected}")]
    Wrong {
        /// Its name.
        file: String,
        /// The key.
        key: &'static str,
        /// What the value should be.
        expected: &'static str,
    },
    /// The rig cannot use it.
    #[error("{file}: {reason}")]
    Unusable {
        /// Its name.
        file: String,
        /// Why, and what to do.
        reason: String,
    },
}

impl Header {
    /// Whether `file` can be used for `step`.
    ///
    /// # Errors
    /// It is of another step, of a newer Penumbra, or was refused when it was made.
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
                "is of the step `{}`, not `{step}`; name it as it belongs",
                self.step
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
/// Too large; not JSON, or not of this form: with line and column.
pub fn parse<T: DeserializeOwned>(file: &str, bytes: &[u8]) -> Result<T, CalibrationFileError> {
    if bytes.len() > LARGEST_FILE {
        return Err(CalibrationFileError::Unusable {
            file: file.to_owned(),
            reason: "more than 16 MiB: no calibration".to_owned(),
        });
    }
    serde_json::from_slice(bytes).map_err(|e| CalibrationFileError::NotJson {
        file: file.to_owned(),
        line: e.line(),
        column: e.column(),
        reason: e.to_string(),
    })
}
