//! `calibration/latency.json`: what the step `latency` found, in the place of what `rig.json`
//! says.
//!
//! Only differences of clocks can be seen. The scene camera's latency stays as the calibration
//! has it; the tracker's is that plus the offset found, the environment camera's the tracker's
//! minus its own offset.

use crate::CalibrationFileError;
use crate::Header;
use crate::RigDocument;
use crate::header as head;
use serde::{Deserialize, Serialize};

/// Beside `rig.json`.
pub const LATENCY: &str = "calibration/latency.json";
/// No device is later, seconds.
const LARGEST: f64 = 10.0;

/// The file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct LatencyRecord {
    /// When, from what, how good.
    #[serde(flatten)]
    pub header: Header,
    /// Latency of the tracker minus that of the scene camera.
    pub tracker_minus_scene: OffsetRecord,
    /// Latency of the tracker minus that of the environment camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker_minus_environment: Option<OffsetRecord>,
}

/// How two clocks differ.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct OffsetRecord {
    /// The tracker's stamps are ahead of the camera's by so many seconds.
    pub seconds: f64,
    /// 1σ, seconds.
    pub sigma: f64,
    /// Of both motions, 0 to 1.
    #[serde(default)]
    pub correlation: f64,
    /// Pairs of pictures.
    #[serde(default)]
    pub pictures: usize,
    /// "poses" or "image motion".
    #[serde(default)]
    pub by: String,
}

/// Puts the latencies of `calibration/latency.json`, if there is one, into `rig`.
///
/// # Errors
/// A file that cannot be read, or was refused when it was made.
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
    /// In nanoseconds; `file` is for complaints.
    ///
    /// # Errors
    /// No number, or more than ten seconds.
    pub fn nanos(&self, file: &str) -> Result<i64, CalibrationFileError> {
        if self.seconds.is_finite() && self.seconds.abs() <= LARGEST {
            return Ok((1e9 * self.seconds).round() as i64);
        }
        Err(CalibrationFileError::Wrong {
            file: file.to_owned(),
            key: "seconds",
            expected: "a number of at most 10",
        })
    }
}
