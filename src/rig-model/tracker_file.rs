//! `calibration/tracker.json`: mounting of the tracker from the step `tracker`, which replaces that of
//! `rig.json`.

use super::latency_file::OffsetRecord;
use crate::CalibrationFileError;
use crate::Header;
use crate::RigDocument;
use crate::TrackerCalibration;
use crate::header as head;
use crate::tracker_field::{Grid, TrackerField};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Name of the file, beside `rig.json`.
pub const TRACKER: &str = "calibration/tracker.json";
/// Maximum coordinate of a position, metres.
const MAX_COORDINATE: f64 = 1000.0;
/// Maximum length of a correction, metres and radians.
const MAX_CORRECTION: f64 = 2.0;

/// The file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct TrackerRecord {
    /// Step, date, source, quality.
    #[serde(flatten)]
    pub header: Header,
    /// The transmitter's pose in the world.
    pub world_from_transmitter: PoseRecord,
    /// The scene camera's pose in the sensor's frame.
    pub sensor_from_scene_camera: PoseRecord,
    /// Metres per unit of the tracker's positions.
    pub metres_per_unit: f64,
    /// The offset of the latencies with which both were calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker_minus_scene: Option<OffsetRecord>,
    /// Root mean square residual: metres and radians.
    #[serde(default)]
    pub residual: [f64; 2],
    /// Number of pairs of poses used, and of all.
    #[serde(default)]
    pub pairs: [usize; 2],
    /// Correction of field distortion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distortion: Option<FieldRecord>,
}

/// A pose and its standard deviations.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct PoseRecord {
    /// Position, metres.
    pub position: [f64; 3],
    /// Unit quaternion.
    pub quaternion_wxyz: [f64; 4],
    /// Standard deviations of the position, metres.
    #[serde(default)]
    pub position_sigma: [f64; 3],
    /// Standard deviations of the rotation about the axes, radians.
    #[serde(default)]
    pub rotation_sigma: [f64; 3],
}

/// A map of corrections; see [`TrackerField`].
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct FieldRecord {
    /// Minimum corner of the volume, transmitter's frame, metres.
    pub low: [f64; 3],
    /// Edge of a cell, metres.
    pub spacing: f64,
    /// Number of cells along each axis.
    pub cells: [usize; 3],
    /// Translations by control point, x fastest, metres.
    pub shift: Vec<[f64; 3]>,
    /// Rotation vectors by control point, x fastest, radians.
    pub turn: Vec<[f64; 3]>,
    /// Root mean square error on held-out data without and with the map, metres.
    #[serde(default)]
    pub held_out_position: [f64; 2],
    /// The same, radians.
    #[serde(default)]
    pub held_out_rotation: [f64; 2],
}

impl PoseRecord {
    /// Creates the record of a pose with its standard deviations (rotation in radians, translation in
    /// metres).
    #[must_use]
    pub fn new(pose: RigidTransform, (turn, shift): (DVec3, DVec3)) -> Self {
        let q = pose.rotation;
        Self {
            position: pose.translation.to_array(),
            quaternion_wxyz: [q.w, q.x, q.y, q.z],
            position_sigma: shift.to_array(),
            rotation_sigma: turn.to_array(),
        }
    }

    /// Returns the pose; `file` is used in the error.
    ///
    /// # Errors
    /// The position is out of range or the quaternion has not length 1.
    pub fn pose(&self, file: &str) -> Result<RigidTransform, CalibrationFileError> {
        let wrong = |key, expected| CalibrationFileError::Wrong {
            file: file.to_owned(),
            key,
            expected,
        };
        let place = DVec3::from(self.position);
        if !place.is_finite() || place.abs().max_element() > MAX_COORDINATE {
            return Err(wrong("position", "x, y, z in metres"));
        }
        let [w, x, y, z] = self.quaternion_wxyz;
        let rotation = DQuat::from_xyzw(x, y, z, w);
        if !rotation.is_finite() || (rotation.length() - 1.0).abs() > 1e-3 {
            return Err(wrong("quaternion_wxyz", "w, x, y, z of length 1"));
        }
        Ok(RigidTransform::new(rotation.normalize(), place))
    }
}

impl FieldRecord {
    /// Creates the record of a field.
    #[must_use]
    pub fn from_field(field: &TrackerField) -> Self {
        let grid = field.grid();
        Self {
            low: grid.low.to_array(),
            spacing: grid.spacing,
            cells: grid.cells,
            shift: field.values().iter().map(|v| v.0.to_array()).collect(),
            turn: field.values().iter().map(|v| v.1.to_array()).collect(),
            held_out_position: [0.0; 2],
            held_out_rotation: [0.0; 2],
        }
    }

    /// Returns the field; `file` is used in the error.
    ///
    /// # Errors
    /// The grid is invalid, or the corrections are too large or their number is wrong.
    pub fn field(&self, file: &str) -> Result<TrackerField, CalibrationFileError> {
        let values = self.shift.iter().zip(&self.turn);
        let values: Vec<_> = values
            .map(|(s, t)| (DVec3::from(*s), DVec3::from(*t)))
            .collect();
        let small = |v: &DVec3| v.is_finite() && v.length() <= MAX_CORRECTION;
        let grid = Grid {
            low: DVec3::from(self.low),
            spacing: self.spacing,
            cells: self.cells,
        };
        let sound = grid.low.is_finite()
            && (1e-3..=10.0).contains(&grid.spacing)
            && self.shift.len() == self.turn.len()
            && values.iter().all(|(s, t)| small(s) && small(t));
        let field = sound.then(|| TrackerField::new(grid, values)).flatten();
        field.ok_or_else(|| CalibrationFileError::Wrong {
            file: file.to_owned(),
            key: "distortion",
            expected: "a grid with a translation and a rotation for each control point",
        })
    }
}

/// Applies `calibration/tracker.json`, if it exists, to `rig`.
///
/// # Errors
/// The file is invalid, or was refused when it was made.
pub fn apply_tracker_file<'a>(
    rig: &mut RigDocument,
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<(), CalibrationFileError> {
    let Some(bytes) = attachments(TRACKER) else {
        return Ok(());
    };
    let record: TrackerRecord = head::parse(TRACKER, bytes)?;
    record.header.check(TRACKER, "tracker")?;
    if !(record.metres_per_unit > 0.0 && record.metres_per_unit <= 1000.0) {
        return Err(CalibrationFileError::Wrong {
            file: TRACKER.to_owned(),
            key: "metres_per_unit",
            expected: "above 0",
        });
    }
    let rig = &mut rig.calibration;
    let offset = record.tracker_minus_scene.as_ref();
    let latency_nanos = match (offset.map(|o| o.nanos(TRACKER)).transpose()?, &rig.tracker) {
        (Some(offset), _) => rig.scene_camera.latency_nanos.saturating_add(offset),
        (None, Some(tracker)) => tracker.latency_nanos,
        (None, None) => 0,
    };
    let field = record.distortion.as_ref();
    rig.tracker = Some(TrackerCalibration {
        world_from_transmitter: record.world_from_transmitter.pose(TRACKER)?,
        sensor_from_scene_camera: record.sensor_from_scene_camera.pose(TRACKER)?,
        latency_nanos,
        metres_per_unit: record.metres_per_unit,
        field: field.map(|f| f.field(TRACKER)).transpose()?.map(Arc::new),
    });
    Ok(())
}
