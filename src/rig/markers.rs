//! Selects the pose source of a rig and reads the map of its markers.

use crate::error::RigError;
use penumbra_config::{Config, PoseSource};
use penumbra_fiducials::{TagMap, UnknownFamily};
use penumbra_rig_model::Marker;

/// Returns the configured pose source; with `auto`, the stated pose, else the tracker, the markers or
/// both, as far as the calibration has them.
pub(super) fn pose_source(
    markers: &[Marker],
    has_tracker: bool,
    config: &Config,
) -> Result<PoseSource, RigError> {
    let wanted = match config.registration.pose {
        PoseSource::Auto if config.registration.fixed.is_some() => PoseSource::Fixed,
        PoseSource::Auto if markers.is_empty() => PoseSource::Tracker,
        PoseSource::Auto if has_tracker => PoseSource::Hybrid,
        PoseSource::Auto => PoseSource::Markers,
        wanted => wanted,
    };
    if markers.is_empty() && matches!(wanted, PoseSource::Markers | PoseSource::Hybrid) {
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

/// Returns the map of the calibration's markers if the pose source uses markers.
pub(super) fn tag_map_for(
    markers: &[Marker],
    pose: PoseSource,
) -> Result<Option<TagMap>, RigError> {
    if matches!(pose, PoseSource::Tracker | PoseSource::Fixed) {
        return Ok(None);
    }
    tag_map(markers).map(Some)
}

/// Returns the map of a calibration's markers.
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
