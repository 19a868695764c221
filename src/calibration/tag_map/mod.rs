//! The step `map`: relative poses of tags, from pictures that show several at a time.
//!
//! `step` gathers views and grades the map; `start` computes initial poses from pairs of tags seen
//! together; `bundle` minimises the reprojection error over all tags and cameras (`schur` solves
//! its normal equations); `build` rejects outliers and computes each tag's standard deviation;
//! `page` presents the result.

mod build;
mod bundle;
mod page;
mod schur;
mod start;
mod step;

pub use step::{MapOptions, MapStep};

use glam::DVec2;
use penumbra_fiducials::Family;
use penumbra_interface::RigidTransform;

/// A tag of the map, known or observed.
#[derive(Clone, Debug)]
struct Seen {
    family: Family,
    id: u32,
    /// Edge of the black border, metres.
    size: f64,
    /// Pose in the rig's calibration, if it is known there.
    known: Option<RigidTransform>,
    /// Estimated pose, once there is one.
    map_from_tag: Option<RigidTransform>,
    /// The pose is held fixed.
    fixed: bool,
    /// Ratio of the estimated size to the given size.
    scale: f64,
}

impl Seen {
    fn name(&self) -> String {
        format!("{} {}", self.family, self.id)
    }
}

/// A sighting: a tag in a picture.
#[derive(Clone, Copy, Debug)]
struct Sight {
    /// Index of the tag.
    tag: usize,
    corners: [DVec2; 4],
    /// Consistent with the other sightings, and therefore used.
    used: bool,
}

/// A picture with tags.
#[derive(Clone, Debug)]
struct View {
    sights: Vec<Sight>,
    camera_from_map: Option<RigidTransform>,
}

#[cfg(test)]
mod tests;
