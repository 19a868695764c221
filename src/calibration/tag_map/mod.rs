//! The step `map`: where tags are on one another, from pictures that show several at a time.
//!
//! `start` chains tags by pairs that are seen together, `bundle` brings all tags and all
//! cameras to the least reprojection error, `build` leaves out what contradicts and finds how
//! sure each tag is, `step` shows it and judges.

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

/// A tag that was seen.
#[derive(Clone, Debug)]
struct Seen {
    family: Family,
    id: u32,
    /// Edge of the black border, metres.
    size: f64,
    /// What the rig's calibration says of its place.
    known: Option<RigidTransform>,
    /// Its place, once there is one.
    map_from_tag: Option<RigidTransform>,
    /// Its place stays as it is.
    fixed: bool,
    /// How many times as large as said it is.
    scale: f64,
}

impl Seen {
    fn name(&self) -> String {
        format!("{} {}", self.family, self.id)
    }
}

/// A tag in a picture.
#[derive(Clone, Copy, Debug)]
struct Sight {
    /// Which.
    tag: usize,
    corners: [DVec2; 4],
    /// It agrees with the others.
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
