//! What every calibration file begins with.

use super::intrinsics::Grade;
use super::record::{DeviceRecord, RecordError};
use super::step::{Finished, Made};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Version of the format.
const VERSION: u32 = 1;
/// No such file is larger, bytes.
const LARGEST_FILE: usize = 16 << 20;

/// Of which step, when, from what, how good; flattened into the file's own object.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Head {
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

impl Head {
    /// Of what a step has found.
    #[must_use]
    pub fn of(step: &str, made: &Made, found: &Finished) -> Self {
        Self {
            penumbra_calibration: VERSION,
            step: step.to_owned(),
            date: made.date.clone(),
            source: made.source.clone(),
            device: made.device.as_ref().map(|name| DeviceRecord {
                name: name.clone(),
                serial: made.serial.clone(),
            }),
            verdict: found.grade.name().to_owned(),
            findings: found.findings.iter().map(|f| f.1.clone()).collect(),
        }
    }

    /// Whether `file` can be used for `step`.
    ///
    /// # Errors
    /// It is of another step, of a newer Penumbra, or was refused when it was made.
    pub fn check(&self, file: &str, step: &str) -> Result<(), RecordError> {
        let unusable = |reason: String| RecordError::Unusable {
            file: file.to_owned(),
            reason,
        };
        if self.penumbra_calibration != VERSION {
            return Err(RecordError::Wrong {
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
pub fn parse<T: DeserializeOwned>(file: &str, bytes: &[u8]) -> Result<T, RecordError> {
    if bytes.len() > LARGEST_FILE {
        return Err(RecordError::Unusable {
            file: file.to_owned(),
            reason: "more than 16 MiB: no calibration".to_owned(),
        });
    }
    serde_json::from_slice(bytes).map_err(|e| RecordError::NotJson {
        file: file.to_owned(),
        line: e.line(),
        column: e.column(),
        reason: e.to_string(),
    })
}
