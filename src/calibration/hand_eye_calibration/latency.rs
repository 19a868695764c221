//! The step `latency`: latency of the tracker and of each camera.

use super::pose_finder::{CameraPose, Landmarks, PoseFinder};
use super::readings::Readings;
use crate::intrinsics::Grey;
use crate::latency::{
    CameraMotion, CameraRotation, ClockOffset, Flow, ImageMotion, LatencyError, MountedCamera,
    OffsetMethod, TrackerTrack, from_flow, from_image_motion, from_rotations,
};
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, PictureInput, Progress, Step, StepInput,
    StepInputs,
};
use crate::summary::grade;
use penumbra_interface::MonotonicTime;
use penumbra_numerics::median;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::RigCalibration;
use penumbra_rig_model::latency_file::{LatencyRecord, OffsetRecord};

/// Maximum interval between successive pictures, seconds.
const MAX_GAP: f64 = 0.15;
/// Maximum image motion of a static camera, pixels from picture to picture.
const MAX_STATIC_MOTION: f64 = 0.35;

/// Maximum deviation of a pose's rotation from its neighbours: multiple of the median deviation,
/// radians. A pose that exceeds both is wrong.
const MAX_DEVIATION: (f64, f64) = (8.0, 0.02);

/// Options of the step.
#[derive(Clone, Debug)]
pub struct LatencyOptions {
    /// Maximum offset that is searched, seconds.
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

/// Image motion of one camera.
#[derive(Default)]
pub(super) struct CameraFlow {
    flow: ImageMotion,
    last: Option<MonotonicTime>,
    /// Motions between successive pictures: time stamps and flow.
    pub motions: Vec<(MonotonicTime, MonotonicTime, Flow)>,
    pub pictures: usize,
}

impl CameraFlow {
    fn add(&mut self, input: &PictureInput) {
        self.pictures += 1;
        let flow = self.flow.next(&Grey::from_picture(input.picture));
        let before = self.last.replace(input.captured_at);
        if let (Some(flow), Some(before)) = (flow, before)
            && are_successive(before, input.captured_at)
        {
            self.motions.push((before, input.captured_at, flow));
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

    fn is_static(&self) -> bool {
        let lengths = self.motions.iter().map(|m| m.2.length);
        let moved = lengths.filter(|length| *length > MAX_STATIC_MOTION);
        10 * moved.count() < self.motions.len()
    }
}

fn are_successive(before: MonotonicTime, after: MonotonicTime) -> bool {
    let gap = after.seconds_since(before);
    gap > 0.0 && gap < MAX_GAP
}

/// Returns the camera's rotations between successive poses, without wrong poses.
pub(super) fn camera_rotations(
    camera_poses: &[CameraPose],
    zero: MonotonicTime,
) -> Vec<CameraRotation> {
    let kept = without_wrong_poses(camera_poses);
    let successive = kept
        .windows(2)
        .filter(|w| are_successive(w[0].stamp, w[1].stamp));
    successive
        .map(|w| CameraRotation {
            from: w[0].stamp.seconds_since(zero),
            to: w[1].stamp.seconds_since(zero),
            rotation: w[0].world_from_camera.rotation.inverse() * w[1].world_from_camera.rotation,
        })
        .collect()
}

/// Drops poses whose rotation deviates from both neighbours, as that of a tag with ambiguous pose
/// does.
fn without_wrong_poses(camera_poses: &[CameraPose]) -> Vec<&CameraPose> {
    let rotation = |s: &CameraPose| s.world_from_camera.rotation;
    let deviations: Vec<f64> = (0..camera_poses.len())
        .map(|i| match (i.checked_sub(1), camera_poses.get(i + 1)) {
            (Some(before), Some(after)) => {
                let between = rotation(&camera_poses[before]).slerp(rotation(after), 0.5);
                between.angle_between(rotation(&camera_poses[i]))
            }
            _ => 0.0,
        })
        .collect();
    let typical = median(deviations.iter().copied()).unwrap_or(0.0);
    let limit = (MAX_DEVIATION.0 * typical).max(MAX_DEVIATION.1);
    let max_of_neighbours = |i: usize| {
        let before = i.checked_sub(1).map_or(0.0, |b| deviations[b]);
        before.max(deviations.get(i + 1).copied().unwrap_or(0.0))
    };
    let kept = |i: &usize| deviations[*i] <= limit || deviations[*i] < max_of_neighbours(*i);
    (0..camera_poses.len())
        .filter(kept)
        .map(|i| &camera_poses[i])
        .collect()
}

/// The calibration step `latency`.
pub struct LatencyStep {
    pub(super) options: LatencyOptions,
    rig: RigCalibration,
    pose_finder: Option<PoseFinder>,
    pub(super) readings: Readings,
    pub(super) camera_poses: Vec<CameraPose>,
    pub(super) scene: CameraFlow,
    pub(super) environment: CameraFlow,
    pub(super) zero: Option<MonotonicTime>,
    overlay_points: Vec<glam::DVec2>,
}

/// Offsets of both cameras.
pub(super) struct Offsets {
    pub scene: Result<(ClockOffset, OffsetMethod), LatencyError>,
    /// Result of the other method, where both have one.
    pub check: Option<(ClockOffset, OffsetMethod)>,
    pub environment: Option<Result<ClockOffset, LatencyError>>,
}

impl LatencyStep {
    /// Creates the step; poses are found from `landmarks`, if there are any.
    #[must_use]
    pub fn new(
        rig: &RigCalibration,
        landmarks: Option<Landmarks>,
        options: LatencyOptions,
    ) -> Self {
        Self {
            pose_finder: landmarks.map(|l| PoseFinder::new(rig, l)),
            rig: rig.clone(),
            readings: Readings::new(options.station),
            options,
            camera_poses: Vec::new(),
            scene: CameraFlow::default(),
            environment: CameraFlow::default(),
            zero: None,
            overlay_points: Vec::new(),
        }
    }

    pub(super) fn track(&self) -> Option<TrackerTrack> {
        Some(self.readings.track(self.zero?))
    }

    pub(super) fn offsets(&self) -> Option<Offsets> {
        let (zero, track) = (self.zero?, self.track()?);
        let range = self.options.range;
        let poses = from_rotations(&track, &camera_rotations(&self.camera_poses, zero), range);
        let mounted = MountedCamera::scene_camera(&self.rig);
        let flow = from_image_motion(&track, &self.scene.motions(zero), mounted.as_ref(), range);
        let (scene, check) = match (poses, flow) {
            (Ok(poses), flow) => (Ok((poses, OffsetMethod::Poses)), flow.ok()),
            (Err(_), Ok(flow)) => (Ok(flow), None),
            // The error of the poses is more useful, where there are enough of them.
            (Err(poses), Err(flow)) => {
                let enough_poses = !matches!(poses, LatencyError::TooShort { .. });
                (Err(if enough_poses { poses } else { flow }), None)
            }
        };
        let is_moving = self.environment.pictures > 0 && !self.environment.is_static();
        let environment =
            is_moving.then(|| from_flow(&track, &self.environment.motions(zero), range));
        Some(Offsets {
            scene,
            check,
            environment,
        })
    }

    /// Returns the calibrated latency of the scene camera, seconds.
    pub(super) fn scene_latency(&self) -> f64 {
        1e-9 * self.rig.scene_camera.latency_nanos as f64
    }

    fn record(&self, offsets: &Offsets, header: Header) -> Option<LatencyRecord> {
        let (scene, method) = offsets.scene.as_ref().ok()?;
        let offset = |found: &ClockOffset, method: OffsetMethod| OffsetRecord {
            seconds: found.seconds,
            sigma: found.sigma,
            correlation: found.correlation,
            pictures: found.samples,
            by: method.name().to_owned(),
        };
        let environment = offsets.environment.as_ref().and_then(|e| e.as_ref().ok());
        Some(LatencyRecord {
            header,
            tracker_minus_scene: offset(scene, *method),
            tracker_minus_environment: environment.map(|e| offset(e, OffsetMethod::Flow)),
        })
    }
}

impl Step for LatencyStep {
    fn name(&self) -> &'static str {
        "latency"
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: true,
            brackets: false,
            poses: true,
            spacing: 0.0,
        }
    }

    fn observe(&mut self, input: &StepInput) {
        match input {
            StepInput::Pose(sample) => self.readings.push(sample),
            StepInput::Picture(picture) if picture.camera == CameraRole::Environment => {
                self.environment.add(picture);
            }
            StepInput::Picture(picture) => {
                self.zero.get_or_insert(picture.captured_at);
                self.scene.add(picture);
                let finder = self.pose_finder.as_mut();
                let found = finder.and_then(|f| f.find(picture.picture, picture.captured_at));
                self.overlay_points = found.as_ref().map_or_else(Vec::new, |f| f.points.clone());
                self.camera_poses.extend(found);
            }
        }
    }

    fn progress(&self) -> Progress {
        let pictures = self.scene.pictures;
        Progress {
            share: (pictures as f64 / 600.0).min(1.0),
            message: format!(
                "{pictures} pictures, {} with poses, {} readings",
                self.camera_poses.len(),
                self.readings.len()
            ),
            hint: if pictures < 600 {
                "rotate the rig briskly and irregularly".to_owned()
            } else {
                String::new()
            },
            overlay_points: self.overlay_points.clone(),
            camera: Some(CameraRole::Scene),
        }
    }

    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished {
        let offsets = self.offsets();
        let mut findings = self.assess(offsets.as_ref());
        let grade = grade(&mut findings);
        let mut found = Finished {
            grade,
            lines: offsets.as_ref().map_or_else(Vec::new, |o| self.lines(o)),
            findings,
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        found.report = self.report(provenance, &found, offsets.as_ref());
        if grade != Grade::Refused {
            let header = found.header("latency", provenance);
            let record = offsets.and_then(|o| self.record(&o, header));
            found.file = record.and_then(|r| serde_json::to_string_pretty(&r).ok());
        }
        found
    }
}
