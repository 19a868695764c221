//! `calibration/latency.json`: latencies from the step `latency`, which replace those of `rig.json`.
//!
//! Only differences of latencies are observable. The scene camera's latency is kept; the tracker's is
//! that plus the measured offset, the environment camera's is the tracker's minus its own offset.

use crate::CalibrationFileError;
use crate::Header;
use crate::RigDocument;
use crate::header as head;
use serde::{Deserialize, Serialize};

/// Name of the file, beside `rig.json`.
pub const LATENCY: &str = "calibration/latency.json";
/// Maximum offset, seconds.
const MAX_SECONDS: f64 = 10.0;

/// The file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct LatencyRecord {
    /// Step, date, source, quality.
    #[serde(flatten)]
    pub header: Header,
    /// Latency of the tracker minus that of the scene camera.
    pub tracker_minus_scene: OffsetRecord,
    /// Latency of the tracker minus that of the environment camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker_minus_environment: Option<OffsetRecord>,
}

/// Offset of two latencies.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct OffsetRecord {
    /// Latency of the tracker minus that of the camera, seconds.
    pub seconds: f64,
    /// Standard deviation, seconds.
    pub sigma: f64,
    /// Correlation of the two motions, 0 to 1.
    #[serde(default)]
    pub correlation: f64,
    /// Number of pairs of pictures.
    #[serde(default)]
    pub pictures: usize,
    /// Method: "poses" or "image motion".
    #[serde(default)]
    pub by: String,
}

/// Applies `calibration/latency.json`, if it exists, to `rig`.
///
/// # Errors
/// The file is invalid, or was refused when it was made.
pub fn apply_latency_file<'a>(
    rig: &mut RigDocument,
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<(), CalibrationFileError> {
    let Some(bytes) = attachments(LATENCY) else {
        return Ok(());
    };
    let record: LatencyRecord = head::parse(LATENCY, bytes)?;
    record.header.check(LATENCY, "latency")?;
    let scene = record.tracker_minus_scene.nanos(LATENCY)?;
    let rig = &mut rig.calibration;
    let tracker = rig.scene_camera.latency_nanos.saturating_add(scene);
    if let Some(calibrated) = &mut rig.tracker {
        calibrated.latency_nanos = tracker;
    }
    if let (Some(offset), Some(environment)) =
        (&record.tracker_minus_environment, &mut rig.environment)
    {
        environment.latency_nanos = tracker.saturating_sub(offset.nanos(LATENCY)?);
    }
    Ok(())
}

impl OffsetRecord {
    /// Returns the offset in nanoseconds; `file` is used in the error.
    ///
    /// # Errors
    /// The offset is not finite or longer than ten seconds.
    pub fn nanos(&self, file: &str) -> Result<i64, CalibrationFileError> {
        if self.seconds.is_finite() && self.seconds.abs() <= MAX_SECONDS {
            return Ok((1e9 * self.seconds).round() as i64);
        }
        Err(CalibrationFileError::Wrong {
            file: file.to_owned(),
            key: "seconds",
            expected: "a number of at most 10",
        })
    }
}
