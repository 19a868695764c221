//! `calibration/markers.json`: the tags that the step `map` found, beside or in the place of
//! those that `rig.json` says.

use super::rig_json::Marker;
use super::tracker_file::PoseRecord;
use crate::CalibrationFileError;
use crate::Header;
use crate::RigDocument;
use crate::header as head;
use penumbra_fiducials::Family;
use serde::{Deserialize, Serialize};

/// Beside `rig.json`.
pub const MARKERS: &str = "calibration/markers.json";
/// No map has more.
const MOST: usize = 10_000;

/// The file.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct MarkersRecord {
    /// When, from what, how good.
    #[serde(flatten)]
    pub header: Header,
    /// The map has a world of its own: markers that `rig.json` says are in another.
    #[serde(default)]
    pub new_world: bool,
    /// The tags.
    pub markers: Vec<MarkerRecord>,
}

/// A tag.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct MarkerRecord {
    /// Such as `tag36h11`.
    pub family: String,
    /// Number within the family.
    pub id: u32,
    /// Edge of the black border, metres.
    pub size_m: f64,
    /// In the world: +Z into the paper. Deviations are along the tag's own axes.
    pub pose: PoseRecord,
    /// Pictures that agree on it.
    #[serde(default)]
    pub sightings: usize,
    /// Root mean square reprojection error, pixels.
    #[serde(default)]
    pub rms: f64,
}

/// Puts the tags of `calibration/markers.json`, if there is one, into `rig`.
///
/// # Errors
/// A file that cannot be read, or was refused when it was made.
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
    if record.markers.len() > MOST {
        return Err(wrong("markers", "at most 10000 tags"));
    }
    if record.new_world {
        rig.markers.clear();
    }
    for marker in &record.markers {
        if marker.family.parse::<Family>().is_err() {
            return Err(wrong("family", "a family of tags that is known"));
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
