//! The scene camera's pose by the tags of a map, from picture to picture.

use super::ippe::poses;
use super::pose::{Match, PoseEstimate, refine};
use super::{TagMap, TagSeen};
use glam::DVec2;
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::{MonotonicTime, RigidTransform};

/// One of the two poses of a single tag is taken for what the corners say where the other is
/// this many times farther off.
pub(super) const CLEAR: f64 = 2.5;
/// Root mean square distance of the corners, pixels, past which tags are not where the map says.
const MOST_RMS: f64 = 3.0;
/// Seconds for which the last pose helps to choose between two.
const MEMORY: f64 = 1.0;
/// Seconds for which it tells how the camera moves.
const MOVING: f64 = 0.2;
/// Rounds of a pose and the rows that it is seen by: what is left after each is some percents.
const ROUNDS: usize = 2;
/// Pixels by which corners may agree worse than before where rows are taken apart; past that the
/// camera did not move so.
const WORSE: f64 = 0.1;

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
    /// One tag whose corners allow two poses; the one nearer to the pose before, or to the
    /// one that a tracker lets expect.
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

/// What is known before the tags are looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Expectation {
    /// `map_from_camera`, roughly.
    pub pose: Option<RigidTransform>,
    /// How the camera moved, if a tracker tells; else the pose before does.
    pub motion: Option<RollingShutter>,
    /// From one row of the picture to the next, seconds; 0 where all are exposed at once.
    pub row_seconds: f64,
}

/// Finds poses. Keeps the last, to choose by.
#[derive(Clone, Debug)]
pub struct Registrar {
    map: TagMap,
    matches: Vec<Match>,
    /// What would have been seen, had all rows been exposed at once.
    at_once: Vec<TagSeen>,
    last: Option<(MonotonicTime, RigidTransform)>,
}

impl Registrar {
    /// By the tags of `map`.
    #[must_use]
    pub const fn new(map: TagMap) -> Self {
        Self {
            map,
            matches: Vec::new(),
            at_once: Vec::new(),
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
        self.register_near(camera, seen, at, &Expectation::default())
    }

    /// The same; where one tag allows two poses, the one nearer to what is expected. With a rolling
    /// shutter the pose is that of the middle row.
    pub fn register_near(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        at: MonotonicTime,
        expected: &Expectation,
    ) -> Option<Registered> {
        let pose = expected.pose.or_else(|| self.memory(at));
        let found = self.look(camera, seen, pose);
        let found = found.map(|found| self.unrolled(camera, seen, at, expected, found));
        let found = found.filter(|f| f.estimate.rms < MOST_RMS)?;
        // A guess is nothing to remember: the next would agree with it.
        if found.how != Registration::TagGuessed {
            self.last = Some((at, found.map_from_camera));
        }
        Some(found)
    }

    fn look(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        expected: Option<RigidTransform>,
    ) -> Option<Registered> {
        let mut matches = std::mem::take(&mut self.matches);
        self.map.matches(seen, &mut matches);
        let found = self.solve(camera, seen, &matches, expected);
        self.matches = matches;
        found
    }

    /// The pose at the middle row, from the one by corners as if all rows were exposed at once:
    /// each corner goes back by what the camera moved until its row was read.
    fn unrolled(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        at: MonotonicTime,
        expected: &Expectation,
        first: Registered,
    ) -> Registered {
        let pose = expected.pose.or_else(|| self.memory(at));
        let mut found = first;
        for _ in 0..ROUNDS {
            let Some(motion) = self.motion(at, expected, &found) else {
                return first;
            };
            let mut at_once = std::mem::take(&mut self.at_once);
            at_once.clear();
            let back = |tag| self.back_at_once(camera, tag, &motion, &found);
            at_once.extend(seen.iter().map(back));
            let next = self.look(camera, &at_once, pose);
            self.at_once = at_once;
            let Some(next) = next else { return first };
            found = next;
        }
        let agrees = found.estimate.rms < first.estimate.rms + WORSE;
        if agrees { found } else { first }
    }

    fn back_at_once(
        &self,
        camera: &PinholeCamera,
        seen: &TagSeen,
        motion: &RollingShutter,
        found: &Registered,
    ) -> TagSeen {
        let mut back = *seen;
        let Some(tag) = self.map.get(seen.family, seen.id) else {
            return back;
        };
        for (pixel, corner) in back.corners.iter_mut().zip(tag.corners()) {
            let point = found.estimate.camera_from_frame.transform_point(corner);
            let places = camera.project(point).zip(motion.project(camera, point));
            *pixel += places.map_or(DVec2::ZERO, |(still, rolled)| still - rolled);
        }
        back
    }

    /// How the camera moved while the picture was read.
    fn motion(
        &self,
        at: MonotonicTime,
        expected: &Expectation,
        found: &Registered,
    ) -> Option<RollingShutter> {
        if expected.row_seconds == 0.0 || expected.motion.is_some() {
            return expected.motion;
        }
        // A guess may face elsewhere, and would be a quick turn.
        let (then, before) = self
            .last
            .filter(|_| found.how != Registration::TagGuessed)?;
        let seconds = at.seconds_since(then);
        let now = &found.map_from_camera;
        let near = (1e-3..MOVING).contains(&seconds);
        near.then(|| RollingShutter::between(&before, now, seconds, expected.row_seconds))?
    }

    fn solve(
        &self,
        camera: &PinholeCamera,
        seen: &[TagSeen],
        matches: &[Match],
        expected: Option<RigidTransform>,
    ) -> Option<Registered> {
        let tags = matches.len() / 4;
        let (best, second) = self.candidates(camera, seen, matches)?;
        let (estimate, how) = match second {
            _ if tags > 1 => (best, Registration::Map { tags }),
            Some(second) if second.rms < CLEAR * best.rms.max(0.05) => match expected {
                Some(pose) => (nearer(best, second, pose), Registration::TagByMemory),
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

/// Of two poses the one from which the camera looks more as expected.
fn nearer(a: PoseEstimate, b: PoseEstimate, expected: RigidTransform) -> PoseEstimate {
    let turn = |e: &PoseEstimate| {
        e.camera_from_frame
            .inverse()
            .rotation
            .angle_between(expected.rotation)
    };
    if turn(&b) < turn(&a) { b } else { a }
}

#[cfg(test)]
mod tests;
