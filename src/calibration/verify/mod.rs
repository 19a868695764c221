//! The one-minute check of a calibrated rig: reprojection error of the markers, colour difference
//! between the cameras, remaining clock offset between tracker and camera.
//!
//! `reprojection` compares corners, `colour` surfaces that both cameras see, [`super::latency`]
//! measures the offset, `assessment` grades the figures, `output` creates file and report.

mod assessment;
pub mod colour;
mod output;
mod reprojection;

pub use assessment::{Assessment, Measurements};
pub use reprojection::{CornerError, Reprojection};

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
const DURATION: f64 = 60.0;
/// Maximum clock offset that is searched, seconds.
const MAX_OFFSET: f64 = 0.25;
/// Half width of the smoothing window of the tracker's rotations, seconds.
const SMOOTHING: f64 = 0.03;

/// The calibrated rig that is checked.
#[derive(Clone, Debug)]
pub struct CheckedRig {
    /// The rig's calibration.
    pub rig: RigDocument,
    /// The rig's markers.
    pub map: TagMap,
    /// Ray caster of the phantoms (proxies of real objects), for surfaces that both cameras see.
    pub caster: Option<RayCaster>,
    /// The tracker's station that carries the camera.
    pub station: u8,
}

/// The observations in one picture of the scene camera.
struct Frame {
    /// Middle of the exposure, corrected for latency.
    at: MonotonicTime,
    /// Seconds since the first picture.
    seconds: f64,
    tags: Vec<TagObservation>,
    /// `world_from_camera` from the markers.
    by_markers: Option<RigidTransform>,
}

/// The step `verify`.
pub struct Verify {
    known: CheckedRig,
    detector: Detector,
    registrar: Registrar,
    image_motion: ImageMotion,
    /// Camera motions from one picture to the next; times in seconds.
    motions: Vec<CameraMotion>,
    frames: Vec<Frame>,
    readings: Vec<(MonotonicTime, RigidTransform)>,
    history: PoseHistory,
    colours: Comparison,
    first: Option<MonotonicTime>,
    seconds: f64,
    progress: Progress,
}

impl Verify {
    /// Creates a check; `white_balance` is the known white balance match between the cameras.
    #[must_use]
    pub fn new(known: CheckedRig, white_balance: WhiteBalanceMatch) -> Self {
        let families = known.map.families();
        Self {
            detector: Detector::new(&families, &known.rig.calibration.scene_camera.response),
            registrar: Registrar::new(known.map.clone()),
            known,
            image_motion: ImageMotion::default(),
            motions: Vec::new(),
            frames: Vec::new(),
            readings: Vec::new(),
            history: PoseHistory::new(HistoryConfig::default()),
            colours: Comparison::new(white_balance),
            first: None,
            seconds: 0.0,
            progress: Progress::default(),
        }
    }

    fn observe_pose(&mut self, sample: &PoseSample) {
        let Some(tracker) = &self.known.rig.calibration.tracker else {
            return;
        };
        if sample.station == self.known.station {
            let at = tracker.measured_at(sample.arrived_at);
            self.readings.push((at, sample.transmitter_from_sensor));
            self.history.push(at, sample.transmitter_from_sensor);
        }
    }

    fn observe_scene(&mut self, input: &PictureInput) {
        let scene = &self.known.rig.calibration.scene_camera;
        let at = input.captured_at.offset_nanos(-scene.latency_nanos);
        let first = *self.first.get_or_insert(at);
        let seconds = at.seconds_since(first);
        let tags = self
            .detector
            .detect(input.picture, Some(&scene.camera))
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
            self.colours.observe_scene(&self.known, input, pose);
        }
        if let Some(flow) = self.image_motion.next(&Grey::from_picture(input.picture))
            && let Some(last) = self.frames.last()
        {
            self.motions.push(CameraMotion {
                from: last.seconds,
                to: seconds,
                flow,
            });
        }
        self.progress.overlay_points = tags.iter().flat_map(|t| t.corners).collect();
        self.progress.camera = Some(CameraRole::Scene);
        self.frames.push(Frame {
            at,
            seconds,
            tags,
            by_markers,
        });
    }

    fn update_progress(&mut self) {
        let seen = self.frames.iter().filter(|f| !f.tags.is_empty()).count();
        self.progress.share = (self.seconds / DURATION).clamp(0.0, 1.0);
        self.progress.message = format!("{} pictures, {seen} with markers", self.frames.len());
        let hint = match self.frames.last() {
            Some(last) if last.tags.is_empty() => "show the scene camera a marker",
            _ if self.progress.share < 1.0 => {
                "rotate the rig briskly to and fro, with markers in view"
            }
            _ => "",
        };
        hint.clone_into(&mut self.progress.hint);
    }

    /// Returns the errors of all corners, under the tracker's pose and under the pose from the other
    /// markers.
    fn corner_errors(&self) -> (Vec<CornerError>, Vec<CornerError>) {
        let (mut by_tracker, mut leave_one_out) = (Vec::new(), Vec::new());
        let calibration = &self.known.rig.calibration;
        let (camera, map) = (&calibration.scene_camera.camera, &self.known.map);
        let mut history = PoseHistory::new(HistoryConfig {
            capacity: self.readings.len().max(1),
            ..HistoryConfig::default()
        });
        for (at, pose) in &self.readings {
            history.push(*at, *pose);
        }
        for frame in &self.frames {
            reprojection::add_leave_one_out_errors(
                camera,
                map,
                &frame.tags,
                frame.at,
                frame.seconds,
                &mut leave_one_out,
            );
            if let (Some(tracker), Some(pose)) = (&calibration.tracker, history.at(frame.at)) {
                let pose = tracker.world_from_scene_camera(pose.transmitter_from_sensor);
                reprojection::add_pose_errors(
                    camera,
                    map,
                    &frame.tags,
                    pose,
                    frame.seconds,
                    &mut by_tracker,
                );
            }
        }
        (by_tracker, leave_one_out)
    }

    /// Returns the remaining clock offset of the tracker to the pictures, both corrected by the
    /// calibration; by rotations of the markers' poses, else by image motion. `None` without
    /// tracker data.
    fn clock_offset(&self) -> Option<Result<ClockOffset, LatencyError>> {
        let first = self.first?;
        if self.readings.is_empty() {
            return None;
        }
        let readings = self.readings.iter();
        let readings = readings.map(|(at, pose)| (at.seconds_since(first), *pose));
        let track = TrackerTrack::from_poses(readings, SMOOTHING);
        let rotations: Vec<CameraRotation> = self
            .frames
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
        let by_rotations = from_rotations(&track, &rotations, MAX_OFFSET);
        let mounted = MountedCamera::scene_camera(&self.known.rig.calibration);
        let by_motion = || from_image_motion(&track, &self.motions, mounted.as_ref(), MAX_OFFSET);
        Some(by_rotations.or_else(|error| by_motion().map(|(found, _)| found).map_err(|_| error)))
    }

    fn measurements(
        &self,
        by_tracker: &[CornerError],
        leave_one_out: &[CornerError],
    ) -> Measurements {
        let calibration = &self.known.rig.calibration;
        let is_own_camera =
            |view: &EnvironmentView| !matches!(view, EnvironmentView::SphereInScene { .. });
        let environment = calibration.environment.as_ref();
        let tracker = calibration.tracker.as_ref();
        let scene_latency = calibration.scene_camera.latency_nanos;
        let calibrated = tracker.map_or(0, |t| t.latency_nanos - scene_latency);
        let calibrated_offset = 1e-9 * calibrated as f64;
        Measurements {
            by_tracker: reprojection::summarise(by_tracker),
            leave_one_out: reprojection::summarise(leave_one_out),
            has_tracker: tracker.is_some(),
            has_environment: environment.is_some_and(|e| is_own_camera(&e.view)),
            colours: self.colours.colours(),
            latency: self.clock_offset().map(|found| {
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

    fn observe(&mut self, input: &StepInput) {
        match input {
            StepInput::Pose(sample) => return self.observe_pose(sample),
            StepInput::Picture(input) => {
                self.seconds = input.seconds;
                match input.camera {
                    CameraRole::Scene => self.observe_scene(input),
                    CameraRole::Environment => self.colours.observe_environment(input),
                }
            }
        }
        self.update_progress();
    }

    fn progress(&self) -> Progress {
        self.progress.clone()
    }

    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished {
        let (by_tracker, leave_one_out) = self.corner_errors();
        let measured = self.measurements(&by_tracker, &leave_one_out);
        let assessment = Assessment::from_measurements(&measured);
        let mut found = Finished {
            grade: assessment.grade(),
            lines: assessment.lines,
            findings: assessment.findings,
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        let corners = if measured.has_tracker {
            &by_tracker
        } else {
            &leave_one_out
        };
        found.report = output::report(provenance, &found, corners);
        // A check always writes its file, even if refused.
        found.file = output::result_file(provenance, &found, &measured);
        found
    }
}

#[cfg(test)]
mod tests;
