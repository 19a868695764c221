//! The step `map`: relative poses of tags, from pictures that show several at a time.
//!
//! `step` gathers views and grades the map; `initial_poses` computes initial poses from pairs of
//! tags seen together; `bundle` minimises the reprojection error over all tags and cameras (`schur`
//! solves its normal equations); `build` rejects outliers and computes each tag's standard
//! deviation; `report` presents the result.

mod build;
mod bundle;
mod initial_poses;
mod report;
mod schur;
mod step;

pub use step::{MapOptions, MapStep};

use glam::DVec2;
use penumbra_fiducials::Family;
use penumbra_interface::RigidTransform;

/// A tag of the map, known or observed.
#[derive(Clone, Debug)]
struct MapTag {
    family: Family,
    id: u32,
    /// Edge of the black border, metres.
    size: f64,
    /// Calibrated pose, if the tag is a marker of the rig.
    calibrated_pose: Option<RigidTransform>,
    /// Estimated pose; `None` until it is initialised.
    map_from_tag: Option<RigidTransform>,
    /// Whether the adjustment holds the pose fixed.
    is_fixed: bool,
    /// Ratio of the estimated to the given size.
    scale: f64,
}

impl MapTag {
    fn name(&self) -> String {
        format!("{} {}", self.family, self.id)
    }
}

/// A tag in a picture.
#[derive(Clone, Copy, Debug)]
struct Observation {
    /// Index of the tag.
    tag: usize,
    /// Detected corners, pixels.
    corners: [DVec2; 4],
    /// Whether it is consistent with the others and therefore used.
    is_used: bool,
}

/// A picture with tags.
#[derive(Clone, Debug)]
struct View {
    observations: Vec<Observation>,
    /// `None` if no observed tag determines it.
    camera_from_map: Option<RigidTransform>,
}

#[cfg(test)]
mod tests;
