//! The scene camera's pose by the tags of a map, from picture to picture.

use super::ippe::poses;
use super::pose::{Match, PoseEstimate, refine};
use super::{TagMap, TagSeen};
use crate::calibration::PinholeCamera;
use penumbra_interface::{MonotonicTime, RigidTransform};

/// One of the two poses of a single tag is taken for what the corners say where the other is
/// this many times farther off.
pub(super) const CLEAR: f64 = 2.5;
/// Root mean square distance of the corners, pixels, past which tags are not where the map says.
const MOST_RMS: f64 = 3.0;
/// Seconds for which the last pose helps to choose between two.
const MEMORY: f64 = 1.0;

/// Where a pose from tags comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Registration {
    /// Several tags of the map.
    Map {
        /// How many.
        tags: usize,
    },
    /// One tag, whose corners allow one pose only.
    Tag,
    /// One tag whose corners allow two poses; the one nearer to the pose before.
    TagByMemory,
    /// One tag whose corners allow two poses, and nothing to choose by but the corners: it
    /// may be wrong.
    TagGuessed,
}

/// The scene camera's pose in the map's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Registered {
    /// `map_from_camera`.
    pub map_from_camera: RigidTransform,
    /// What the corners say, with its uncertainty.
    pub estimate: PoseEstimate,
    /// How it was found.
    pub how: Registration,
}

/// Finds poses. Keeps the last, to choose by.
#[derive(Clone, Debug)]
pub struct Registrar {
    map: TagMap,
    matches: Vec<Match>,
    last: Option<(MonotonicTime, RigidTransform)>,
}

impl Registrar {
    /// By the tags of `map`.
    #[must_use]
    pub const fn new(map: TagMap) -> Self {
        Self {
            map,
            matches: Vec::new(),
            last: None,
        }
    }

    /// The map.
    #[must_use]
    pub const fn map(&self) -> &TagMap {
        &self.map
    }

    /// The pose at the instant of a picture, by the tags seen in it. `None` where it shows none of
    /// the map's, or where they are not where the map says.
    pub fn register(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        at: MonotonicTime,
    ) -> Option<Registered> {
        let mut matches = std::mem::take(&mut self.matches);
        self.map.matches(seen, &mut matches);
        let found = self.solve(camera, seen, &matches, at);
        self.matches = matches;
        let found = found.filter(|f| f.estimate.rms < MOST_RMS)?;
        // A guess is nothing to remember: the next would agree with it.
        if found.how != Registration::TagGuessed {
            self.last = Some((at, found.map_from_camera));
        }
        Some(found)
    }

    fn solve(
        &self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        matches: &[Match],
        at: MonotonicTime,
    ) -> Option<Registered> {
        let tags = matches.len() / 4;
        let (best, second) = self.candidates(camera, seen, matches)?;
        let (estimate, how) = match second {
            _ if tags > 1 => (best, Registration::Map { tags }),
            Some(second) if second.rms < CLEAR * best.rms.max(0.05) => match self.memory(at) {
                Some(last) => (nearer(best, second, last), Registration::TagByMemory),
                None => (best, Registration::TagGuessed),
            },
            _ => (best, Registration::Tag),
        };
        Some(Registered {
            map_from_camera: estimate.camera_from_frame.inverse(),
            estimate,
            how,
        })
    }

    fn memory(&self, at: MonotonicTime) -> Option<RigidTransform> {
        let (then, pose) = self.last?;
        (at.seconds_since(then).abs() < MEMORY).then_some(pose)
    }

    /// The best pose for all corners, starting from both poses of the largest tag, and the
    /// other one.
    fn candidates(
        &self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        matches: &[Match],
    ) -> Option<(PoseEstimate, Option<PoseEstimate>)> {
        let used = |t: &&TagSeen| matches.iter().any(|m| m.pixel == t.corners[0]);
        let largest = seen
            .iter()
            .filter(used)
            .max_by(|a, b| a.area().total_cmp(&b.area()))?;
        let tag = self.map.get(largest.family, largest.id)?;
        let tag_from_map = tag.map_from_tag.inverse();
        let starts = poses(camera, &largest.corners, tag.size)?;
        let [a, b] =
            starts.map(|camera_from_tag| refine(camera, camera_from_tag * tag_from_map, matches));
        match (a, b) {
            (Some(a), Some(b)) if a.rms <= b.rms => Some((a, Some(b))),
            (Some(a), Some(b)) => Some((b, Some(a))),
            (one, other) => Some((one.or(other)?, None)),
        }
    }
}

/// Of two poses the one from which the camera looks more like it did last.
fn nearer(a: PoseEstimate, b: PoseEstimate, last: RigidTransform) -> PoseEstimate {
    let turn = |e: &PoseEstimate| {
        e.camera_from_frame
            .inverse()
            .rotation
            .angle_between(last.rotation)
    };
    if turn(&b) < turn(&a) { b } else { a }
}

#[cfg(test)]
mod tests;
