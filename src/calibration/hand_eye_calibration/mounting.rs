//! The step `tracker`: the scene camera's pose on the sensor, the transmitter's pose in the world
//! and, as an option, the distortion of the tracker's measurement space.

use super::field_fit::{FieldFit, FieldSample, fit};
use super::latency::camera_rotations;
use super::pose_finder::{CameraPose, Landmarks, PoseFinder};
use super::readings::{Readings, between};
use crate::hand_eye::{HandEye, PosePair, hand_eye};
use crate::latency::{LatencyError, from_rotations};
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, Progress, Step, StepInput, StepInputs,
};
use crate::summary::grade;
use glam::DVec2;
use penumbra_interface::MonotonicTime;
use penumbra_numerics::rotation_vector;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::RigCalibration;
use penumbra_rig_model::latency_file::OffsetRecord;
use penumbra_rig_model::tracker_field::TrackerField;
use penumbra_rig_model::tracker_file::{FieldRecord, PoseRecord, TrackerRecord};

/// Maximum clock offset that is searched, seconds.
const MAX_OFFSET: f64 = 0.25;
/// Maximum number of pairs of poses.
const MAX_PAIRS: usize = 2400;
/// Number of alternations between mounting and distortion.
const ALTERNATIONS: usize = 4;
/// Assumed 1σ of an offset that was not estimated, seconds.
const LATENCY_SIGMA: f64 = 0.003;

/// Source of the tracker's latency.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LatencyChoice {
    /// Estimated from the same pictures and readings.
    #[default]
    Estimate,
    /// The calibrated value.
    Calibration,
    /// A given value, seconds.
    Seconds(f64),
}

/// Options of the step.
#[derive(Clone, Debug, Default)]
pub struct MountingOptions {
    /// The tracker's station on the rig; 0 means 1.
    pub station: u8,
    /// Source of the tracker's latency.
    pub latency: LatencyChoice,
    /// Whether the distortion of the tracker's space is fitted.
    pub distortion: bool,
    /// Whether the board's frame serves as the world.
    pub world_is_board: bool,
}

/// The calibration step `tracker`.
pub struct MountingStep {
    pub(super) options: MountingOptions,
    rig: RigCalibration,
    pose_finder: PoseFinder,
    pub(super) readings: Readings,
    pub(super) camera_poses: Vec<CameraPose>,
    pub(super) pictures: usize,
    overlay_points: Vec<DVec2>,
}

/// Offset of the tracker's time stamps from the scene camera's.
#[derive(Clone, Copy)]
pub(super) struct StampOffset {
    /// Tracker minus scene camera, seconds.
    pub seconds: f64,
    /// 1σ, seconds.
    pub sigma: f64,
    pub is_estimated: bool,
}

/// Result of the step.
pub(super) struct MountingResult {
    pub hand_eye: HandEye,
    pub pairs: Vec<(MonotonicTime, PosePair)>,
    pub offset: StampOffset,
    pub latency_error: Option<LatencyError>,
    /// The fitted distortion, even if it does not reduce the residuals.
    pub field: Option<FieldFit>,
    /// The mounting without correction of the distortion.
    pub uncorrected: HandEye,
}

impl MountingResult {
    /// Returns the distortion field if it improves the held-out residuals.
    pub fn accepted_field(&self) -> Option<&TrackerField> {
        self.field.as_ref().filter(|f| f.helps()).map(|f| &f.field)
    }
}

impl MountingStep {
    /// Creates the step for the scene camera of this rig, with poses from `landmarks`.
    #[must_use]
    pub fn new(rig: &RigCalibration, landmarks: Landmarks, options: MountingOptions) -> Self {
        Self {
            pose_finder: PoseFinder::new(rig, landmarks),
            rig: rig.clone(),
            readings: Readings::new(options.station.max(1)),
            options,
            camera_poses: Vec::new(),
            pictures: 0,
            overlay_points: Vec::new(),
        }
    }

    /// Returns the offset of the tracker's time stamps, and why it could not be estimated if it
    /// should have been.
    fn offset(&self, zero: MonotonicTime) -> (StampOffset, Option<LatencyError>) {
        let scene = 1e-9 * self.rig.scene_camera.latency_nanos as f64;
        let calibrated = self
            .rig
            .tracker
            .as_ref()
            .map_or(0.0, |t| 1e-9 * t.latency_nanos as f64);
        let assumed = |latency: f64| StampOffset {
            seconds: latency - scene,
            sigma: LATENCY_SIGMA,
            is_estimated: false,
        };
        match self.options.latency {
            LatencyChoice::Seconds(seconds) => (assumed(seconds), None),
            LatencyChoice::Calibration => (assumed(calibrated), None),
            LatencyChoice::Estimate => {
                let rotations = camera_rotations(&self.camera_poses, zero);
                match from_rotations(&self.readings.track(zero), &rotations, MAX_OFFSET) {
                    Ok(found) => {
                        let offset = StampOffset {
                            seconds: found.seconds,
                            sigma: found.sigma,
                            is_estimated: true,
                        };
                        (offset, None)
                    }
                    Err(error) => (assumed(calibrated), Some(error)),
                }
            }
        }
    }

    fn solve(&self) -> Result<MountingResult, String> {
        if let Some(missing) = self.readings.missing() {
            return Err(missing);
        }
        let Some(first) = self.camera_poses.first() else {
            return Err(format!(
                "the camera's pose was found in none of {} pictures; show it the rig's markers (`calibrate map` finds their positions) or name a --board",
                self.pictures
            ));
        };
        let (offset, latency_error) = self.offset(first.stamp);
        let history = self.readings.history();
        let shift = (1e9 * offset.seconds) as i64;
        let every = self.camera_poses.len().div_ceil(MAX_PAIRS);
        let pairs: Vec<(MonotonicTime, PosePair)> = self
            .camera_poses
            .iter()
            .step_by(every)
            .filter_map(|s| {
                let pair = PosePair {
                    transmitter_from_sensor: between(&history, s.stamp.offset_nanos(shift))?,
                    world_from_camera: s.world_from_camera,
                };
                Some((s.stamp, pair))
            })
            .collect();
        let plain: Vec<PosePair> = pairs.iter().map(|p| p.1).collect();
        let uncorrected = hand_eye(&plain).map_err(|e| e.to_string())?;
        let mut result = MountingResult {
            hand_eye: uncorrected.clone(),
            uncorrected,
            pairs,
            offset,
            latency_error,
            field: None,
        };
        if self.options.distortion {
            fit_distortion(&mut result, &plain);
        }
        Ok(result)
    }

    fn record(&self, result: &MountingResult, header: Header) -> TrackerRecord {
        let found = &result.hand_eye;
        let offset = result.offset;
        let is_new =
            offset.is_estimated || matches!(self.options.latency, LatencyChoice::Seconds(_));
        let distortion = result.accepted_field().map(|field| {
            let mut record = FieldRecord::from_field(field);
            if let Some(fit) = &result.field {
                record.held_out_position = [fit.before.0, fit.after.0];
                record.held_out_rotation = [fit.before.1, fit.after.1];
            }
            record
        });
        TrackerRecord {
            header,
            world_from_transmitter: PoseRecord::new(
                found.world_from_transmitter,
                found.transmitter_sigma,
            ),
            sensor_from_scene_camera: PoseRecord::new(found.sensor_from_camera, found.sensor_sigma),
            metres_per_unit: self
                .rig
                .tracker
                .as_ref()
                .map_or(0.0254, |t| t.metres_per_unit),
            tracker_minus_scene: is_new.then(|| OffsetRecord {
                seconds: offset.seconds,
                sigma: offset.sigma,
                correlation: 0.0,
                pictures: self.camera_poses.len(),
                by: if offset.is_estimated {
                    "poses"
                } else {
                    "as given"
                }
                .to_owned(),
            }),
            residual: [found.position_rms, found.rotation_rms],
            pairs: [found.used.iter().filter(|u| **u).count(), found.used.len()],
            distortion,
        }
    }
}

/// Fits mounting and distortion alternately: each improves the estimate of the other.
fn fit_distortion(result: &mut MountingResult, plain: &[PosePair]) {
    for _ in 0..ALTERNATIONS {
        let Some(fitted) = fit(&field_samples(plain, &result.hand_eye)) else {
            return;
        };
        let corrected: Vec<PosePair> = plain
            .iter()
            .map(|p| PosePair {
                transmitter_from_sensor: fitted.field.correct(p.transmitter_from_sensor),
                ..*p
            })
            .collect();
        let helps = fitted.helps();
        let Ok(found) = hand_eye(&corrected) else {
            return;
        };
        result.field = Some(fitted);
        if !helps {
            result.hand_eye = result.uncorrected.clone();
            return;
        }
        result.hand_eye = found;
    }
}

/// Returns the error of each reading relative to the sensor's pose from the pictures.
fn field_samples(pairs: &[PosePair], found: &HandEye) -> Vec<FieldSample> {
    let transmitter_from_world = found.world_from_transmitter.inverse();
    let camera_from_sensor = found.sensor_from_camera.inverse();
    let sample = |pair: &PosePair| {
        let by_picture = transmitter_from_world * pair.world_from_camera * camera_from_sensor;
        let read = pair.transmitter_from_sensor;
        FieldSample {
            position: read.translation,
            translation: by_picture.translation - read.translation,
            rotation: rotation_vector(by_picture.rotation * read.rotation.inverse()),
        }
    };
    pairs.iter().map(sample).collect()
}

impl Step for MountingStep {
    fn name(&self) -> &'static str {
        "tracker"
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: false,
            brackets: false,
            poses: true,
            spacing: 0.0,
        }
    }

    fn observe(&mut self, input: &StepInput) {
        match input {
            StepInput::Pose(sample) => self.readings.push(sample),
            StepInput::Picture(picture) => {
                self.pictures += 1;
                let found = self.pose_finder.find(picture.picture, picture.captured_at);
                self.overlay_points = found.as_ref().map_or_else(Vec::new, |f| f.points.clone());
                self.camera_poses.extend(found);
            }
        }
    }

    fn progress(&self) -> Progress {
        let poses = self.camera_poses.len();
        let hint = match poses {
            0 => "point the camera at the markers or the board",
            1..600 => "rotate the rig about all axes, by 30 degrees or more",
            _ => "",
        };
        Progress {
            share: (poses as f64 / 600.0).min(1.0),
            message: format!(
                "{poses} poses from {} pictures, {} readings",
                self.pictures,
                self.readings.len()
            ),
            hint: hint.to_owned(),
            overlay_points: self.overlay_points.clone(),
            camera: Some(CameraRole::Scene),
        }
    }

    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished {
        let result = self.solve();
        let mut findings = match &result {
            Ok(result) => self.assess(result),
            Err(reason) => vec![(Grade::Refused, reason.clone())],
        };
        let grade = grade(&mut findings);
        let mut found = Finished {
            grade,
            lines: result
                .as_ref()
                .map_or_else(|_| Vec::new(), |r| self.lines(r)),
            findings,
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        found.report = self.report(provenance, &found, result.as_ref().ok());
        if let (Ok(result), true) = (&result, grade != Grade::Refused) {
            let record = self.record(result, found.header("tracker", provenance));
            found.file = serde_json::to_string_pretty(&record).ok();
        }
        found
    }
}
