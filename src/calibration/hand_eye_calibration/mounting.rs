//! The step `tracker`: how the scene camera sits on the sensor, where the transmitter stands,
//! and, if wanted, how the tracker's space is bent.

use super::field_fit::{FieldFit, FieldSample, fit};
use super::graded;
use super::latency::turns;
use super::readings::{Readings, between};
use super::surveyor::{Landmarks, Sighting, Surveyor};
use crate::hand_eye::{HandEye, PosePair, hand_eye};
use crate::latency::{LatencyError, from_rotations};
use crate::step::{Eye, Finished, Made, Progress, Shown, Step, Wants};
use glam::DVec2;
use penumbra_interface::MonotonicTime;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::RigCalibration;
use penumbra_rig_model::latency_file::OffsetRecord;
use penumbra_rig_model::tracker_field::TrackerField;
use penumbra_rig_model::tracker_file::{FieldRecord, PoseRecord, TrackerRecord};

/// Largest offset of the clocks that is looked for, seconds.
const RANGE: f64 = 0.25;
/// Pairs of poses that are looked at.
const MOST_PAIRS: usize = 2400;
/// Rounds of mounting and bent space after each other.
const ROUNDS: usize = 4;
/// Without a latency at all the rig's speed times this is the error, seconds.
const LATENCY_SIGMA: f64 = 0.003;

/// Where the tracker's latency comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LatencyChoice {
    /// From the same pictures and readings.
    #[default]
    Estimate,
    /// From the calibration.
    Calibration,
    /// This many seconds.
    Seconds(f64),
}

/// What the step is told.
#[derive(Clone, Debug, Default)]
pub struct MountingOptions {
    /// The tracker's station on the rig; 0 for 1.
    pub station: u8,
    /// See there.
    pub latency: LatencyChoice,
    /// Learn how the tracker's space is bent.
    pub distortion: bool,
    /// The frame of the poses is the board's: there is no other world.
    pub world_is_board: bool,
}

/// The step.
pub struct MountingStep {
    pub(super) options: MountingOptions,
    rig: RigCalibration,
    surveyor: Surveyor,
    pub(super) readings: Readings,
    pub(super) sightings: Vec<Sighting>,
    pub(super) pictures: usize,
    marks: Vec<DVec2>,
}

/// What was found.
pub(super) struct Mounted {
    pub hand_eye: HandEye,
    pub pairs: Vec<(MonotonicTime, PosePair)>,
    /// Clocks: seconds, 1σ, by estimate.
    pub offset: (f64, f64, bool),
    pub latency_error: Option<LatencyError>,
    /// What was learnt of its space, believed or not.
    pub field: Option<FieldFit>,
    /// Without the field.
    pub straight: HandEye,
}

impl Mounted {
    pub fn believed(&self) -> Option<&TrackerField> {
        self.field.as_ref().filter(|f| f.helps()).map(|f| &f.field)
    }
}

impl MountingStep {
    /// For the scene camera of this rig, by poses from `landmarks`.
    #[must_use]
    pub fn new(rig: &RigCalibration, landmarks: Landmarks, options: MountingOptions) -> Self {
        Self {
            surveyor: Surveyor::new(rig, landmarks),
            rig: rig.clone(),
            readings: Readings::of_station(options.station.max(1)),
            options,
            sightings: Vec::new(),
            pictures: 0,
            marks: Vec::new(),
        }
    }

    /// Seconds by which the tracker's stamps are ahead of the scene camera's, 1σ, estimated.
    fn offset(&self, zero: MonotonicTime) -> (f64, f64, bool, Option<LatencyError>) {
        let scene = 1e-9 * self.rig.scene_camera.latency_nanos as f64;
        let said = self
            .rig
            .tracker
            .as_ref()
            .map_or(0.0, |t| 1e-9 * t.latency_nanos as f64);
        match self.options.latency {
            LatencyChoice::Seconds(seconds) => (seconds - scene, LATENCY_SIGMA, false, None),
            LatencyChoice::Calibration => (said - scene, LATENCY_SIGMA, false, None),
            LatencyChoice::Estimate => {
                let turns = turns(&self.sightings, zero);
                match from_rotations(&self.readings.track(zero), &turns, RANGE) {
                    Ok(found) => (found.seconds, found.sigma, true, None),
                    Err(error) => (said - scene, LATENCY_SIGMA, false, Some(error)),
                }
            }
        }
    }

    fn mounted(&self) -> Result<Mounted, String> {
        if let Some(missing) = self.readings.missing() {
            return Err(missing);
        }
        let Some(first) = self.sightings.first() else {
            return Err(format!(
                "none of {} pictures shows where the camera is; show it the rig's markers (`calibrate map` finds where they are) or name a --board",
                self.pictures
            ));
        };
        let (seconds, sigma, estimated, latency_error) = self.offset(first.stamp);
        let history = self.readings.history();
        let shift = (1e9 * seconds) as i64;
        let every = self.sightings.len().div_ceil(MOST_PAIRS);
        let pairs: Vec<(MonotonicTime, PosePair)> = self
            .sightings
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
        let straight = hand_eye(&plain).map_err(|e| e.to_string())?;
        let mut mounted = Mounted {
            hand_eye: straight.clone(),
            straight,
            pairs,
            offset: (seconds, sigma, estimated),
            latency_error,
            field: None,
        };
        if self.options.distortion {
            bend(&mut mounted, &plain);
        }
        Ok(mounted)
    }

    fn record(&self, mounted: &Mounted, header: Header) -> TrackerRecord {
        let found = &mounted.hand_eye;
        let (seconds, sigma, estimated) = mounted.offset;
        let told = estimated || matches!(self.options.latency, LatencyChoice::Seconds(_));
        let distortion = mounted.believed().map(|field| {
            let mut record = FieldRecord::of(field);
            if let Some(fit) = &mounted.field {
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
            tracker_minus_scene: told.then(|| OffsetRecord {
                seconds,
                sigma,
                correlation: 0.0,
                pictures: self.sightings.len(),
                by: if estimated { "poses" } else { "as told" }.to_owned(),
            }),
            residual: [found.position_rms, found.rotation_rms],
            pairs: [found.used.iter().filter(|u| **u).count(), found.used.len()],
            distortion,
        }
    }
}

/// Mounting and bent space by turns: each is seen better when the other is taken off.
fn bend(mounted: &mut Mounted, plain: &[PosePair]) {
    for _ in 0..ROUNDS {
        let Some(fitted) = fit(&departures(plain, &mounted.hand_eye)) else {
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
        mounted.field = Some(fitted);
        if !helps {
            mounted.hand_eye = mounted.straight.clone();
            return;
        }
        mounted.hand_eye = found;
    }
}

/// By what each reading departs from where the pictures say that the sensor was.
fn departures(pairs: &[PosePair], found: &HandEye) -> Vec<FieldSample> {
    let transmitter_from_world = found.world_from_transmitter.inverse();
    let camera_from_sensor = found.sensor_from_camera.inverse();
    let sample = |pair: &PosePair| {
        let truth = transmitter_from_world * pair.world_from_camera * camera_from_sensor;
        let read = pair.transmitter_from_sensor;
        let turn = truth.rotation * read.rotation.inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        FieldSample {
            place: read.translation,
            shift: truth.translation - read.translation,
            turn: turn.to_scaled_axis(),
        }
    };
    pairs.iter().map(sample).collect()
}

impl Step for MountingStep {
    fn name(&self) -> &'static str {
        "tracker"
    }

    fn wants(&self) -> Wants {
        Wants {
            scene: true,
            environment: false,
            brackets: false,
            poses: true,
            spacing: 0.0,
        }
    }

    fn look(&mut self, shown: &Shown) {
        match shown {
            Shown::Pose(sample) => self.readings.push(sample),
            Shown::Picture(picture) => {
                self.pictures += 1;
                let seen = self.surveyor.look(picture.picture, picture.captured_at);
                self.marks = seen.as_ref().map_or_else(Vec::new, |s| s.marks.clone());
                self.sightings.extend(seen);
            }
        }
    }

    fn progress(&self) -> Progress {
        let poses = self.sightings.len();
        let hint = match poses {
            0 => "show the camera the markers or the board",
            1..600 => "turn the rig about all axes, by 30 degrees and more",
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
            marks: self.marks.clone(),
            eye: Some(Eye::Scene),
        }
    }

    fn finish(&mut self, made: &Made) -> Finished {
        let mounted = self.mounted();
        let mut findings = match &mounted {
            Ok(mounted) => self.judge(mounted),
            Err(reason) => vec![(Grade::Refused, reason.clone())],
        };
        let grade = graded(&mut findings);
        let mut found = Finished {
            grade,
            lines: mounted
                .as_ref()
                .map_or_else(|_| Vec::new(), |m| self.lines(m)),
            findings,
            hints: Vec::new(),
            page: String::new(),
            file: None,
        };
        found.page = self.page(made, &found, mounted.as_ref().ok());
        if let (Ok(mounted), true) = (&mounted, grade != Grade::Refused) {
            let record = self.record(mounted, found.header("tracker", made));
            found.file = serde_json::to_string_pretty(&record).ok();
        }
        found
    }
}
