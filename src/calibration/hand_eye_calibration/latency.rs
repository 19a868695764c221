//! The step `latency`: how late the tracker is, and each camera.

use super::graded;
use super::readings::Readings;
use super::surveyor::{Landmarks, Sighting, Surveyor};
use crate::intrinsics::Grey;
use crate::latency::follow::{Means, by_motion};
use crate::latency::{
    CameraMotion, CameraTurn, ClockOffset, Flow, ImageMotion, LatencyError, Mounted, TrackerTrack,
    from_motion, from_rotations,
};
use crate::step::{Eye, Finished, Made, Progress, Shown, ShownPicture, Step, Wants};
use penumbra_interface::MonotonicTime;
use penumbra_numerics::median;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::RigCalibration;
use penumbra_rig_model::latency_file::{LatencyRecord, OffsetRecord};

/// Pictures farther apart are no neighbours, seconds.
pub(super) const NEIGHBOURS: f64 = 0.15;
/// The picture of a camera that stands still moves by less, pixels from picture to picture.
const STILL: f64 = 0.35;

/// A pose is a wrong one that turns away from its neighbours by so many times the usual, and by
/// so much, radians.
const JUMP: (f64, f64) = (8.0, 0.02);

/// What the step is told.
#[derive(Clone, Debug)]
pub struct LatencyOptions {
    /// Largest offset that is tried, seconds.
    pub range: f64,
    /// The tracker's station on the rig.
    pub station: u8,
}

impl Default for LatencyOptions {
    fn default() -> Self {
        Self {
            range: 0.25,
            station: 1,
        }
    }
}

/// One camera's pictures, and how they moved.
#[derive(Default)]
pub(super) struct Watched {
    flow: ImageMotion,
    last: Option<MonotonicTime>,
    /// By the pictures themselves.
    pub motions: Vec<(MonotonicTime, MonotonicTime, Flow)>,
    pub pictures: usize,
}

impl Watched {
    fn look(&mut self, shown: &ShownPicture) {
        self.pictures += 1;
        let moved = self.flow.next(&Grey::from_picture(shown.picture));
        let before = self.last.replace(shown.captured_at);
        if let (Some(moved), Some(before)) = (moved, before)
            && near(before, shown.captured_at)
        {
            self.motions.push((before, shown.captured_at, moved));
        }
    }

    pub fn motions(&self, zero: MonotonicTime) -> Vec<CameraMotion> {
        let motion = |(from, to, flow): &(MonotonicTime, MonotonicTime, Flow)| CameraMotion {
            from: from.seconds_since(zero),
            to: to.seconds_since(zero),
            flow: *flow,
        };
        self.motions.iter().map(motion).collect()
    }

    fn stands_still(&self) -> bool {
        let moved = self.motions.iter().filter(|m| m.2.length > STILL).count();
        10 * moved < self.motions.len()
    }
}

fn near(before: MonotonicTime, after: MonotonicTime) -> bool {
    let gap = after.seconds_since(before);
    gap > 0.0 && gap < NEIGHBOURS
}

/// How the camera turned from sighting to sighting; poses that no hand could reach are passed over.
pub(super) fn turns(sightings: &[Sighting], zero: MonotonicTime) -> Vec<CameraTurn> {
    let steady = steady(sightings);
    let neighbours = steady.windows(2).filter(|w| near(w[0].stamp, w[1].stamp));
    neighbours
        .map(|w| CameraTurn {
            from: w[0].stamp.seconds_since(zero),
            to: w[1].stamp.seconds_since(zero),
            rotation: w[0].world_from_camera.rotation.inverse() * w[1].world_from_camera.rotation,
        })
        .collect()
}

/// Without those that turn away from both neighbours, as the other pose of a tag does.
fn steady(sightings: &[Sighting]) -> Vec<&Sighting> {
    let turn = |s: &Sighting| s.world_from_camera.rotation;
    let off: Vec<f64> = (0..sightings.len())
        .map(|i| match (i.checked_sub(1), sightings.get(i + 1)) {
            (Some(before), Some(after)) => {
                let between = turn(&sightings[before]).slerp(turn(after), 0.5);
                between.angle_between(turn(&sightings[i]))
            }
            _ => 0.0,
        })
        .collect();
    let usual = median(off.iter().copied()).unwrap_or(0.0);
    let limit = (JUMP.0 * usual).max(JUMP.1);
    let beside = |i: usize| {
        let before = i.checked_sub(1).map_or(0.0, |b| off[b]);
        before.max(off.get(i + 1).copied().unwrap_or(0.0))
    };
    let kept = |i: &usize| off[*i] <= limit || off[*i] < beside(*i);
    (0..sightings.len())
        .filter(kept)
        .map(|i| &sightings[i])
        .collect()
}

/// The step.
pub struct LatencyStep {
    pub(super) options: LatencyOptions,
    rig: RigCalibration,
    surveyor: Option<Surveyor>,
    pub(super) readings: Readings,
    pub(super) sightings: Vec<Sighting>,
    pub(super) scene: Watched,
    pub(super) environment: Watched,
    pub(super) zero: Option<MonotonicTime>,
    marks: Vec<glam::DVec2>,
}

/// What was found of both cameras.
pub(super) struct Offsets {
    pub scene: Result<(ClockOffset, Means), LatencyError>,
    /// The other means' answer, where both have one.
    pub check: Option<(ClockOffset, Means)>,
    pub environment: Option<Result<ClockOffset, LatencyError>>,
}

impl LatencyStep {
    /// With the poses by `landmarks`, where there are any in the pictures.
    #[must_use]
    pub fn new(
        rig: &RigCalibration,
        landmarks: Option<Landmarks>,
        options: LatencyOptions,
    ) -> Self {
        Self {
            surveyor: landmarks.map(|l| Surveyor::new(rig, l)),
            rig: rig.clone(),
            readings: Readings::of_station(options.station),
            options,
            sightings: Vec::new(),
            scene: Watched::default(),
            environment: Watched::default(),
            zero: None,
            marks: Vec::new(),
        }
    }

    pub(super) fn track(&self) -> Option<TrackerTrack> {
        Some(self.readings.track(self.zero?))
    }

    pub(super) fn offsets(&self) -> Option<Offsets> {
        let (zero, track) = (self.zero?, self.track()?);
        let range = self.options.range;
        let poses = from_rotations(&track, &turns(&self.sightings, zero), range);
        let mounted = Mounted::scene_camera(&self.rig);
        let flow = by_motion(&track, &self.scene.motions(zero), mounted.as_ref(), range);
        let (scene, check) = match (poses, flow) {
            (Ok(poses), flow) => (Ok((poses, Means::Poses)), flow.ok()),
            (Err(_), Ok(flow)) => (Ok(flow), None),
            // What is said of poses says more, where there are enough of them.
            (Err(poses), Err(flow)) => {
                let seen = !matches!(poses, LatencyError::TooShort { .. });
                (Err(if seen { poses } else { flow }), None)
            }
        };
        let moves = self.environment.pictures > 0 && !self.environment.stands_still();
        let environment =
            moves.then(|| from_motion(&track, &self.environment.motions(zero), range));
        Some(Offsets {
            scene,
            check,
            environment,
        })
    }

    /// Seconds, of the scene camera, as the calibration has it.
    pub(super) fn scene_latency(&self) -> f64 {
        1e-9 * self.rig.scene_camera.latency_nanos as f64
    }

    fn record(&self, offsets: &Offsets, header: Header) -> Option<LatencyRecord> {
        let (scene, means) = offsets.scene.as_ref().ok()?;
        let of = |found: &ClockOffset, means: Means| OffsetRecord {
            seconds: found.seconds,
            sigma: found.sigma,
            correlation: found.correlation,
            pictures: found.samples,
            by: means.name().to_owned(),
        };
        let environment = offsets.environment.as_ref().and_then(|e| e.as_ref().ok());
        Some(LatencyRecord {
            header,
            tracker_minus_scene: of(scene, *means),
            tracker_minus_environment: environment.map(|e| of(e, Means::Flow)),
        })
    }
}

impl Step for LatencyStep {
    fn name(&self) -> &'static str {
        "latency"
    }

    fn wants(&self) -> Wants {
        Wants {
            scene: true,
            environment: true,
            brackets: false,
            poses: true,
            spacing: 0.0,
        }
    }

    fn look(&mut self, shown: &Shown) {
        match shown {
            Shown::Pose(sample) => self.readings.push(sample),
            Shown::Picture(picture) if picture.eye == Eye::Environment => {
                self.environment.look(picture);
            }
            Shown::Picture(picture) => {
                self.zero.get_or_insert(picture.captured_at);
                self.scene.look(picture);
                let surveyor = self.surveyor.as_mut();
                let seen = surveyor.and_then(|s| s.look(picture.picture, picture.captured_at));
                self.marks = seen.as_ref().map_or_else(Vec::new, |s| s.marks.clone());
                self.sightings.extend(seen);
            }
        }
    }

    fn progress(&self) -> Progress {
        let pictures = self.scene.pictures;
        Progress {
            share: (pictures as f64 / 600.0).min(1.0),
            message: format!(
                "{pictures} pictures, {} with poses, {} readings",
                self.sightings.len(),
                self.readings.len()
            ),
            hint: if pictures < 600 {
                "turn the rig briskly and unevenly".to_owned()
            } else {
                String::new()
            },
            marks: self.marks.clone(),
            eye: Some(Eye::Scene),
        }
    }

    fn finish(&mut self, made: &Made) -> Finished {
        let offsets = self.offsets();
        let mut findings = self.judge(offsets.as_ref());
        let grade = graded(&mut findings);
        let mut found = Finished {
            grade,
            lines: offsets.as_ref().map_or_else(Vec::new, |o| self.lines(o)),
            findings,
            hints: Vec::new(),
            page: String::new(),
            file: None,
        };
        found.page = self.page(made, &found, offsets.as_ref());
        if grade != Grade::Refused {
            let header = found.header("latency", made);
            let record = offsets.and_then(|o| self.record(&o, header));
            found.file = record.and_then(|r| serde_json::to_string_pretty(&r).ok());
        }
        found
    }
}
