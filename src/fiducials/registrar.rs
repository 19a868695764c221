//! Estimates the scene camera's pose from the tags of a map, from picture to picture.

use crate::detector::TagObservation;
use crate::ippe::{AMBIGUITY_RATIO, MIN_RMS, poses};
use crate::map::TagMap;
use crate::pose::{Match, PoseEstimate, refine};
use glam::DVec2;
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::{MonotonicTime, RigidTransform};

/// Root mean square reprojection error beyond which the tags contradict the map, pixels.
const MAX_RMS: f64 = 3.0;
/// Maximum age of the last pose for choosing between two candidates, seconds.
const MAX_MEMORY_SECONDS: f64 = 1.0;
/// Maximum age of the last pose for estimating the camera's motion, seconds.
const MAX_MOTION_SECONDS: f64 = 0.2;
/// Rolling-shutter passes; each reduces the remaining error to a few percent.
const ROLLING_SHUTTER_PASSES: usize = 2;
/// Maximum increase of the reprojection error by rolling-shutter correction, pixels. Beyond it the
/// camera did not move as assumed.
const MAX_RMS_INCREASE: f64 = 0.1;

/// How a pose from tags was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegistrationMethod {
    /// By several tags of the map.
    Map {
        /// Number of tags.
        tags: usize,
    },
    /// By one tag whose corners are consistent with one pose only.
    Tag,
    /// By one tag whose corners are consistent with two poses: the one closer to the previous pose
    /// or to the tracker's.
    TagByPreviousPose,
    /// By one tag whose corners are consistent with two poses, without any other information: the
    /// pose may be wrong.
    TagGuessed,
}

/// The scene camera's pose in the map's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegisteredPose {
    /// `map_from_camera`.
    pub map_from_camera: RigidTransform,
    /// The estimate from the corners, with its covariance.
    pub estimate: PoseEstimate,
    /// How the pose was found.
    pub method: RegistrationMethod,
}

/// What is known before the tags are used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PosePrior {
    /// Approximate `map_from_camera`.
    pub pose: Option<RigidTransform>,
    /// The camera's motion by a tracker; `None` to estimate it from the previous pose.
    pub motion: Option<RollingShutter>,
    /// Time from one row of the picture to the next, seconds; 0 for a global shutter.
    pub row_seconds: f64,
}

/// Estimates poses. Keeps the last one, to choose between two candidates.
#[derive(Clone, Debug)]
pub struct Registrar {
    map: TagMap,
    matches: Vec<Match>,
    /// The tags as a global shutter would have shown them.
    corrected: Vec<TagObservation>,
    last: Option<(MonotonicTime, RigidTransform)>,
}

impl Registrar {
    /// Creates a registrar for the tags of `map`.
    #[must_use]
    pub const fn new(map: TagMap) -> Self {
        Self {
            map,
            matches: Vec::new(),
            corrected: Vec::new(),
            last: None,
        }
    }

    /// The map.
    #[must_use]
    pub const fn map(&self) -> &TagMap {
        &self.map
    }

    /// Estimates the pose of a picture taken at `at` from the tags `seen` in it. `None` if it shows
    /// no tag of the map, or if the tags contradict the map.
    pub fn register(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagObservation],
        at: MonotonicTime,
    ) -> Option<RegisteredPose> {
        self.register_with(camera, seen, at, &PosePrior::default())
    }

    /// As [`Self::register`]; chooses the candidate closer to the expected pose if one tag is
    /// consistent with two. With a rolling shutter, the pose is that of the middle row.
    pub fn register_with(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagObservation],
        at: MonotonicTime,
        expected: &PosePrior,
    ) -> Option<RegisteredPose> {
        let pose = expected.pose.or_else(|| self.recent(at));
        let found = self.estimate(camera, seen, pose);
        let found = found.map(|f| self.rolling_corrected(camera, seen, at, expected, f));
        let found = found.filter(|f| f.estimate.rms < MAX_RMS)?;
        // A guess must not choose the next candidate, which would confirm it.
        if found.method != RegistrationMethod::TagGuessed {
            self.last = Some((at, found.map_from_camera));
        }
        Some(found)
    }

    fn estimate(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagObservation],
        expected: Option<RigidTransform>,
    ) -> Option<RegisteredPose> {
        let mut matches = std::mem::take(&mut self.matches);
        self.map.matches(seen, &mut matches);
        let found = self.solve(camera, seen, &matches, expected);
        self.matches = matches;
        found
    }

    /// Returns the pose at the middle row, from the `first` pose, which assumes a global shutter:
    /// each corner is shifted back by the camera's motion until its row was read.
    fn rolling_corrected(
        &mut self,
        camera: &PinholeCamera,
        seen: &[TagObservation],
        at: MonotonicTime,
        expected: &PosePrior,
        first: RegisteredPose,
    ) -> RegisteredPose {
        let pose = expected.pose.or_else(|| self.recent(at));
        let mut found = first;
        for _ in 0..ROLLING_SHUTTER_PASSES {
            let Some(motion) = self.motion(at, expected, &found) else {
                return first;
            };
            let mut corrected = std::mem::take(&mut self.corrected);
            corrected.clear();
            let correct = |tag| self.corrected(camera, tag, &motion, &found);
            corrected.extend(seen.iter().map(correct));
            let next = self.estimate(camera, &corrected, pose);
            self.corrected = corrected;
            let Some(next) = next else { return first };
            found = next;
        }
        let is_consistent = found.estimate.rms < first.estimate.rms + MAX_RMS_INCREASE;
        if is_consistent { found } else { first }
    }

    /// Returns a tag's corners as a global shutter would have shown them.
    fn corrected(
        &self,
        camera: &PinholeCamera,
        seen: &TagObservation,
        motion: &RollingShutter,
        found: &RegisteredPose,
    ) -> TagObservation {
        let mut corrected = *seen;
        let Some(tag) = self.map.get(seen.family, seen.id) else {
            return corrected;
        };
        for (pixel, corner) in corrected.corners.iter_mut().zip(tag.corners()) {
            let point = found.estimate.camera_from_frame.transform_point(corner);
            let pixels = camera.project(point).zip(motion.project(camera, point));
            *pixel += pixels.map_or(DVec2::ZERO, |(global, rolling)| global - rolling);
        }
        corrected
    }

    /// Returns the camera's motion while the picture was read out.
    fn motion(
        &self,
        at: MonotonicTime,
        expected: &PosePrior,
        found: &RegisteredPose,
    ) -> Option<RollingShutter> {
        if expected.row_seconds == 0.0 || expected.motion.is_some() {
            return expected.motion;
        }
        // A guess may have the wrong orientation and would look like a fast rotation.
        let (then, before) = self
            .last
            .filter(|_| found.method != RegistrationMethod::TagGuessed)?;
        let seconds = at.seconds_since(then);
        let now = &found.map_from_camera;
        let is_recent = (1e-3..MAX_MOTION_SECONDS).contains(&seconds);
        is_recent.then(|| RollingShutter::between(&before, now, seconds, expected.row_seconds))?
    }

    fn solve(
        &self,
        camera: &PinholeCamera,
        seen: &[TagObservation],
        matches: &[Match],
        expected: Option<RigidTransform>,
    ) -> Option<RegisteredPose> {
        let tags = matches.len() / 4;
        let (best, second) = self.candidates(camera, seen, matches)?;
        let (estimate, how) = match second {
            _ if tags > 1 => (best, RegistrationMethod::Map { tags }),
            Some(second) if second.rms < AMBIGUITY_RATIO * best.rms.max(MIN_RMS) => {
                match expected {
                    Some(pose) => (
                        nearer(best, second, pose),
                        RegistrationMethod::TagByPreviousPose,
                    ),
                    None => (best, RegistrationMethod::TagGuessed),
                }
            }
            _ => (best, RegistrationMethod::Tag),
        };
        Some(RegisteredPose {
            map_from_camera: estimate.camera_from_frame.inverse(),
            estimate,
            method: how,
        })
    }

    /// The last pose, if it is recent enough to choose between two candidates.
    fn recent(&self, at: MonotonicTime) -> Option<RigidTransform> {
        let (then, pose) = self.last?;
        (at.seconds_since(then).abs() < MAX_MEMORY_SECONDS).then_some(pose)
    }

    /// Returns the two poses that both candidates of the largest tag lead to when refined on all
    /// corners, the better one first.
    fn candidates(
        &self,
        camera: &PinholeCamera,
        seen: &[TagObservation],
        matches: &[Match],
    ) -> Option<(PoseEstimate, Option<PoseEstimate>)> {
        let used = |t: &&TagObservation| matches.iter().any(|m| m.pixel == t.corners[0]);
        let largest = seen
            .iter()
            .filter(used)
            .max_by(|a, b| a.area().total_cmp(&b.area()))?;
        let tag = self.map.get(largest.family, largest.id)?;
        let tag_from_map = tag.map_from_tag.inverse();
        let initial_poses = poses(camera, &largest.corners, tag.size)?;
        let [a, b] = initial_poses
            .map(|camera_from_tag| refine(camera, camera_from_tag * tag_from_map, matches));
        match (a, b) {
            (Some(a), Some(b)) if a.rms <= b.rms => Some((a, Some(b))),
            (Some(a), Some(b)) => Some((b, Some(a))),
            (one, other) => Some((one.or(other)?, None)),
        }
    }
}

/// Returns the pose whose orientation is closer to the expected one.
fn nearer(a: PoseEstimate, b: PoseEstimate, expected: RigidTransform) -> PoseEstimate {
    let angle = |e: &PoseEstimate| {
        e.camera_from_frame
            .inverse()
            .rotation
            .angle_between(expected.rotation)
    };
    if angle(&b) < angle(&a) { b } else { a }
}

#[cfg(test)]
mod tests;
