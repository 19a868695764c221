//! Maps of tags at fixed relative poses.

use crate::detector::TagObservation;
use crate::family::Family;
use crate::pose::{Match, square};
use glam::DVec3;
use penumbra_interface::RigidTransform;

/// A tag at a known pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tag {
    /// Family.
    pub family: Family,
    /// Number in the family.
    pub id: u32,
    /// Edge of the black border, metres.
    pub size: f64,
    /// Pose in the map's frame. Tag frame: +X right, +Y down as it is read, +Z into the paper.
    pub map_from_tag: RigidTransform,
}

impl Tag {
    /// Returns the corners in the map's frame, metres, clockwise as the tag is read, from the top left.
    #[must_use]
    pub fn corners(&self) -> [DVec3; 4] {
        square(0.5 * self.size).map(|c| self.map_from_tag.transform_point(c))
    }
}

/// Tags on one rigid object, each once.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TagMap {
    tags: Vec<Tag>,
}

/// A map that holds a tag twice.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{family} {id} is in the map twice; remove one of them")]
pub struct DuplicateTag {
    family: Family,
    id: u32,
}

impl TagMap {
    /// Creates a map of `tags`.
    ///
    /// # Errors
    /// A number of a family occurs more than once.
    pub fn new(mut tags: Vec<Tag>) -> Result<Self, DuplicateTag> {
        tags.sort_unstable_by_key(|t| (t.family, t.id));
        let twice = tags
            .windows(2)
            .find(|w| (w[0].family, w[0].id) == (w[1].family, w[1].id));
        match twice {
            Some(w) => Err(DuplicateTag {
                family: w[0].family,
                id: w[0].id,
            }),
            None => Ok(Self { tags }),
        }
    }

    /// All tags, sorted by family and number.
    #[must_use]
    pub fn tags(&self) -> &[Tag] {
        &self.tags
    }

    /// Returns the tag of a number, if the map has it.
    #[must_use]
    pub fn get(&self, family: Family, id: u32) -> Option<&Tag> {
        let found = self
            .tags
            .binary_search_by_key(&(family, id), |t| (t.family, t.id));
        found.ok().map(|i| &self.tags[i])
    }

    /// Returns the families that occur, each once.
    #[must_use]
    pub fn families(&self) -> Vec<Family> {
        let mut families: Vec<_> = self.tags.iter().map(|t| t.family).collect();
        families.dedup();
        families
    }

    /// Fills `out` with the corners of the map's tags in `seen`. Tags of one number that are seen
    /// twice are left out, because at most one of them can be the map's.
    pub(super) fn matches(&self, seen: &[TagObservation], out: &mut Vec<Match>) {
        out.clear();
        for tag in seen {
            let same = |t: &&TagObservation| (t.family, t.id) == (tag.family, tag.id);
            if seen.iter().filter(same).count() > 1 {
                continue;
            }
            if let Some(known) = self.get(tag.family, tag.id) {
                let corners = known.corners().into_iter().zip(tag.corners);
                out.extend(corners.map(|(point, pixel)| Match { point, pixel }));
            }
        }
    }
}
