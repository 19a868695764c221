//! The one-minute check of a calibrated rig: reprojection error of the markers, colour difference
//! between the cameras, remaining clock offset between tracker and camera.
//!
//! `reprojection` compares corners, `colour` surfaces that both cameras see, [`super::latency`]
//! measures the offset, `judge` grades the figures, `written` writes file and report.

pub mod colour;
mod judge;
mod reprojection;
mod written;

pub use judge::{Judgement, Measured};
pub use reprojection::{Off, Reprojection};

use super::intrinsics::Grey;
use super::latency::{
    CameraMotion, CameraRotation, ClockOffset, ImageMotion, LatencyError, MountedCamera,
    TrackerTrack, from_image_motion, from_rotations,
};
use super::step::{
    CalibrationProvenance, CameraRole, Finished, PictureInput, Progress, Step, StepInput,
    StepInputs,
};
use colour::Comparison;
use penumbra_camera::EnvironmentView;
use penumbra_fiducials::{Detector, Registrar, RegistrationMethod, TagMap, TagObservation};
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_rig_model::RigDocument;
use penumbra_scene::RayCaster;
use penumbra_sync::{HistoryConfig, PoseHistory};
use penumbra_white_balance::WhiteBalanceMatch;

/// Intended duration of the check, seconds.
const LENGTH: f64 = 60.0;
/// Maximum clock offset of the search, seconds.
const RANGE: f64 = 0.25;
/// Half width of the window in which the tracker's rotations are smoothed, seconds.
const SMOOTHING: f64 = 0.03;

/// The calibrated rig that is checked.
#[derive(Clone, Debug)]
pub struct Known {
    /// The rig's calibration.
    pub rig: RigDocument,
    /// The rig's markers.
    pub map: TagMap,
    /// Ray caster of the phantoms (proxies of real objects), for surfaces that both cameras see.
    pub caster: Option<RayCaster>,
    /// The tracker's station that carries the camera.
    pub station: u8,
}

/// The observations of one picture.
struct Moment {
    /// Middle of the exposure, corrected for latency.
    at: MonotonicTime,
    seconds: f64,
    tags: Vec<TagObservation>,
    /// `world_from_camera` from the markers.
    by_markers: Option<RigidTransform>,
}

/// The step `verify`.
pub struct Verify {
    known: Known,
    detector: Detector,
    registrar: Registrar,
    motion: ImageMotion,
    /// Camera motions from one picture to the next; times in seconds.
    motions: Vec<CameraMotion>,
    moments: Vec<Moment>,
    readings: Vec<(MonotonicTime, RigidTransform)>,
    history: PoseHistory,
    colours: Comparison,
    first: Option<MonotonicTime>,
    seconds: f64,
    progress: Progress,
}

impl Verify {
    /// Creates a check; `photometry` is the known white balance match between the cameras.
    #[must_use]
    pub fn new(known: Known, photometry: WhiteBalanceMatch) -> Self {
        let families = known.map.families();
        Self {
            detector: Detector::new(&families, &known.rig.calibration.scene_camera.response),
            registrar: Registrar::new(known.map.clone()),
            known,
            motion: ImageMotion::default(),
            motions: Vec::new(),
            moments: Vec::new(),
            readings: Vec::new(),
            history: PoseHistory::new(HistoryConfig::default()),
            colours: Comparison::new(photometry),
            first: None,
            seconds: 0.0,
            progress: Progress::default(),
        }
    }

    fn pose(&mut self, sample: &PoseSample) {
        let Some(tracker) = &self.known.rig.calibration.tracker else {
            return;
        };
        if sample.station == self.known.station {
            let at = tracker.measured_at(sample.arrived_at);
            self.readings.push((at, sample.transmitter_from_sensor));
            self.history.push(at, sample.transmitter_from_sensor);
        }
    }

    fn scene(&mut self, shown: &PictureInput) {
        let scene = &self.known.rig.calibration.scene_camera;
        let at = shown.captured_at.offset_nanos(-scene.latency_nanos);
        let first = *self.first.get_or_insert(at);
        let seconds = at.seconds_since(first);
        let tags = self
            .detector
            .detect(shown.picture, Some(&scene.camera))
            .to_vec();
        let found = self.registrar.register(&scene.camera, &tags, at);
        let by_markers = found
            .filter(|f| f.method != RegistrationMethod::TagGuessed)
            .map(|f| f.map_from_camera);
        let tracker = self.known.rig.calibration.tracker.as_ref();
        let tracked = tracker.and_then(|tracker| {
            let pose = self.history.at(at)?.transmitter_from_sensor;
            Some(tracker.world_from_scene_camera(pose))
        });
        if let Some(pose) = tracked.or(by_markers) {
            self.colours.scene(&self.known, shown, pose);
        }
        if let Some(flow) = self.motion.next(&Grey::from_picture(shown.picture))
            && let Some(last) = self.moments.last()
        {
            self.motions.push(CameraMotion {
                from: last.seconds,
                to: seconds,
                flow,
            });
        }
        self.progress.overlay_points = tags.iter().flat_map(|t| t.corners).collect();
        self.progress.camera = Some(CameraRole::Scene);
        self.moments.push(Moment {
            at,
            seconds,
            tags,
            by_markers,
        });
    }

    fn tell(&mut self) {
        let seen = self.moments.iter().filter(|m| !m.tags.is_empty()).count();
        self.progress.share = (self.seconds / LENGTH).clamp(0.0, 1.0);
        self.progress.message = format!("{} pictures, {seen} with markers", self.moments.len());
        let hint = match self.moments.last() {
            Some(last) if last.tags.is_empty() => "show the scene camera a marker",
            _ if self.progress.share < 1.0 => "turn the rig briskly to and fro, markers in view",
            _ => "",
        };
        hint.clone_into(&mut self.progress.hint);
    }

    /// Returns the errors of all corners, by the tracker's pose and by the other markers' pose.
    fn corners(&self) -> (Vec<Off>, Vec<Off>) {
        let (mut tracked, mut among) = (Vec::new(), Vec::new());
        let calibration = &self.known.rig.calibration;
        let (camera, map) = (&calibration.scene_camera.camera, &self.known.map);
        let mut history = PoseHistory::new(HistoryConfig {
            capacity: self.readings.len().max(1),
            ..HistoryConfig::default()
        });
        for (at, pose) in &self.readings {
            history.push(*at, *pose);
        }
        for moment in &self.moments {
            reprojection::by_the_others(
                camera,
                map,
                &moment.tags,
                moment.at,
                moment.seconds,
                &mut among,
            );
            if let (Some(tracker), Some(pose)) = (&calibration.tracker, history.at(moment.at)) {
                let pose = tracker.world_from_scene_camera(pose.transmitter_from_sensor);
                reprojection::by_pose(
                    camera,
                    map,
                    &moment.tags,
                    pose,
                    moment.seconds,
                    &mut tracked,
                );
            }
        }
        (tracked, among)
    }

    /// Returns the tracker's clock offset to the pictures, both corrected by the calibration.
    fn offset(&self) -> Option<Result<ClockOffset, LatencyError>> {
        let first = self.first?;
        if self.readings.is_empty() {
            return None;
        }
        let readings = self.readings.iter();
        let readings = readings.map(|(at, pose)| (at.seconds_since(first), *pose));
        let track = TrackerTrack::from_poses(readings, SMOOTHING);
        let turns: Vec<CameraRotation> = self
            .moments
            .windows(2)
            .filter_map(|w| {
                let (a, b) = (w[0].by_markers?, w[1].by_markers?);
                Some(CameraRotation {
                    from: w[0].seconds,
                    to: w[1].seconds,
                    rotation: a.rotation.inverse() * b.rotation,
                })
            })
            .collect();
        let by_turns = from_rotations(&track, &turns, RANGE);
        let mounted = MountedCamera::scene_camera(&self.known.rig.calibration);
        let by_motion = || from_image_motion(&track, &self.motions, mounted.as_ref(), RANGE);
        Some(by_turns.or_else(|error| by_motion().map(|(found, _)| found).map_err(|_| error)))
    }

    fn measured(&self, tracked: &[Off], among: &[Off]) -> Measured {
        let calibration = &self.known.rig.calibration;
        let own_camera =
            |view: &EnvironmentView| !matches!(view, EnvironmentView::SphereInScene { .. });
        let environment = calibration.environment.as_ref();
        let tracker = calibration.tracker.as_ref();
        let scene_latency = calibration.scene_camera.latency_nanos;
        let calibrated = tracker.map_or(0, |t| t.latency_nanos - scene_latency);
        let calibrated_offset = 1e-9 * calibrated as f64;
        Measured {
            tracked: reprojection::sum_up(tracked),
            among: reprojection::sum_up(among),
            has_tracker: tracker.is_some(),
            has_environment: environment.is_some_and(|e| own_camera(&e.view)),
            colours: self.colours.colours(),
            latency: self.offset().map(|found| {
                found.map(|f| ClockOffset {
                    seconds: f.seconds + calibrated_offset,
                    ..f
                })
            }),
            calibrated_offset,
        }
    }
}

impl Step for Verify {
    fn name(&self) -> &'static str {
        "verify"
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: self.known.rig.calibration.environment.is_some(),
            brackets: false,
            poses: true,
            spacing: 0.0,
        }
    }

    fn observe(&mut self, shown: &StepInput) {
        match shown {
            StepInput::Pose(sample) => return self.pose(sample),
            StepInput::Picture(shown) => {
                self.seconds = shown.seconds;
                match shown.camera {
                    CameraRole::Scene => self.scene(shown),
                    CameraRole::Environment => self.colours.environment(shown),
                }
            }
        }
        self.tell();
    }

    fn progress(&self) -> Progress {
        self.progress.clone()
    }

    fn finish(&mut self, made: &CalibrationProvenance) -> Finished {
        let (tracked, among) = self.corners();
        let measured = self.measured(&tracked, &among);
        let judgement = Judgement::of(&measured);
        let mut found = Finished {
            grade: judgement.grade(),
            lines: judgement.lines,
            findings: judgement.findings,
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        let corners = if measured.has_tracker {
            &tracked
        } else {
            &among
        };
        found.report = written::page(made, &found, corners);
        // A check writes its file whatever its grade.
        found.file = written::file(made, &found, &measured);
        found
    }
}

#[cfg(test)]
mod tests;
