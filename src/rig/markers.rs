//! The pose source of a rig and the map of its markers.

use crate::error::RigError;
use penumbra_config::{Config, PoseSource};
use penumbra_fiducials::{TagMap, UnknownFamily};
use penumbra_rig_model::Marker;

/// What tells the pose: what the configuration wants, or by itself what the calibration lists.
pub(super) fn pose_source(
    markers: &[Marker],
    tracker: bool,
    config: &Config,
) -> Result<PoseSource, RigError> {
    let wanted = match config.registration.pose {
        PoseSource::Auto if markers.is_empty() => PoseSource::Tracker,
        PoseSource::Auto if tracker => PoseSource::Hybrid,
        PoseSource::Auto => PoseSource::Markers,
        wanted => wanted,
    };
    if markers.is_empty() && wanted != PoseSource::Tracker {
        return Err(RigError::NoMarkers {
            wanted: if wanted == PoseSource::Hybrid {
                "hybrid"
            } else {
                "markers"
            },
        });
    }
    Ok(wanted)
}

/// The map of the calibration's markers, where the pose is to come by them.
pub(super) fn wanted_tags(
    markers: &[Marker],
    pose: PoseSource,
) -> Result<Option<TagMap>, RigError> {
    if pose == PoseSource::Tracker {
        return Ok(None);
    }
    tag_map(markers).map(Some)
}

/// The map of a calibration's markers.
pub(super) fn tag_map(markers: &[Marker]) -> Result<TagMap, RigError> {
    let unknown = |e: UnknownFamily| RigError::Markers {
        reason: e.to_string(),
    };
    let tags = markers.iter().map(Marker::tag).collect::<Result<_, _>>();
    let tags = tags.map_err(unknown)?;
    TagMap::new(tags).map_err(|e| RigError::Markers {
        reason: e.to_string(),
    })
}
