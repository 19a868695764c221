//! `calibration/markers.json`: tags from the step `map`, which add to or replace those of `rig.json`.

use crate::CalibrationFileError;
use crate::Header;
use crate::RigDocument;
use crate::header as head;
use crate::rig_json::Marker;
use crate::tracker_file::PoseRecord;
use penumbra_fiducials::Family;
use serde::{Deserialize, Serialize};

/// Name of the file, beside `rig.json`.
pub const MARKERS: &str = "calibration/markers.json";
/// Maximum number of tags.
const MAX_MARKERS: usize = 10_000;

/// The file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct MarkersRecord {
    /// Step, date, source, quality.
    #[serde(flatten)]
    pub header: Header,
    /// The map has a new world frame, in which the markers of `rig.json` do not apply.
    #[serde(default)]
    pub new_world: bool,
    /// The tags.
    pub markers: Vec<MarkerRecord>,
}

/// A tag.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct MarkerRecord {
    /// E.g. `tag36h11`.
    pub family: String,
    /// Number within the family.
    pub id: u32,
    /// Edge of the black border, metres.
    pub size_m: f64,
    /// Pose in the world, +Z into the paper; standard deviations along the tag's axes.
    pub pose: PoseRecord,
    /// Number of pictures that are consistent with the pose.
    #[serde(default)]
    pub sightings: usize,
    /// Root mean square reprojection error, pixels.
    #[serde(default)]
    pub rms: f64,
}

/// Applies `calibration/markers.json`, if it exists, to `rig`.
///
/// # Errors
/// The file is invalid, or was refused when it was made.
pub fn apply_markers_file<'a>(
    rig: &mut RigDocument,
    attachments: &dyn Fn(&str) -> Option<&'a [u8]>,
) -> Result<(), CalibrationFileError> {
    let Some(bytes) = attachments(MARKERS) else {
        return Ok(());
    };
    let record: MarkersRecord = head::parse(MARKERS, bytes)?;
    record.header.check(MARKERS, "map")?;
    let wrong = |key, expected| CalibrationFileError::Wrong {
        file: MARKERS.to_owned(),
        key,
        expected,
    };
    if record.markers.len() > MAX_MARKERS {
        return Err(wrong("markers", "at most 10000 tags"));
    }
    if record.new_world {
        rig.markers.clear();
    }
    for marker in &record.markers {
        if marker.family.parse::<Family>().is_err() {
            return Err(wrong("family", "a known family of tags, e.g. tag36h11"));
        }
        if !(marker.size_m > 0.0 && marker.size_m < 100.0) {
            return Err(wrong("size_m", "metres, above 0"));
        }
        let found = Marker {
            family: marker.family.clone(),
            id: marker.id,
            size: marker.size_m,
            world_from_marker: marker.pose.pose(MARKERS)?,
        };
        let same = |m: &&mut Marker| (&m.family, m.id) == (&found.family, found.id);
        match rig.markers.iter_mut().find(same) {
            Some(known) => *known = found,
            None => rig.markers.push(found),
        }
    }
    Ok(())
}
