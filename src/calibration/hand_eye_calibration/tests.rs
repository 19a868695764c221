//! Tests with simulated rigs: poses as found in pictures, and tracker readings.

use super::mounting::MountingOptions;
use super::pose_finder::CameraPose;
use super::*;
use crate::simulation::{Motion, SimulatedRig, SimulationOptions};
use crate::step::{CalibrationProvenance, Finished, Step, StepInput};
use glam::DQuat;
use penumbra_fiducials::TagMap;
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_numerics::Random;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::latency_file::{LATENCY, apply_latency_file};
use penumbra_rig_model::tracker_file::{TRACKER, apply_tracker_file};

fn rig(simulated: &SimulatedRig) -> RigDocument {
    RigDocument::parse(simulated.rig_json().to_string().as_bytes()).unwrap()
}

fn instant(seconds: f64) -> MonotonicTime {
    MonotonicTime::from_nanos(1_000_000_000_000 + (1e9 * seconds) as i64)
}

fn noisy(
    pose: RigidTransform,
    rotation: f64,
    translation: f64,
    random: &mut Random,
) -> RigidTransform {
    RigidTransform::new(
        (DQuat::from_scaled_axis(random.normal3() * rotation) * pose.rotation).normalize(),
        pose.translation + random.normal3() * translation,
    )
}

/// Returns the pose of every picture with the noise of tags, 0.05° and 0.6 mm; some poses are flipped.
fn camera_poses(simulated: &SimulatedRig, random: &mut Random) -> Vec<CameraPose> {
    let options = &simulated.options;
    let count = (30.0 * options.seconds) as i32;
    let one = |i: i32| {
        let at = 0.5 + f64::from(i) / 30.0 + 0.001 * random.normal();
        let mut pose = noisy(simulated.world_from_camera(at), 0.0009, 0.0006, random);
        if random.uniform() < 0.02 {
            pose = noisy(pose, 0.3, 0.05, random);
        }
        CameraPose {
            stamp: instant(at + options.camera_latency),
            world_from_camera: pose,
            rms: 0.2,
            points: Vec::new(),
        }
    };
    (0..count).map(one).collect()
}

fn readings(simulated: &SimulatedRig, random: &mut Random) -> Vec<PoseSample> {
    let options = &simulated.options;
    let count = (120.0 * (options.seconds + 1.0)) as i32;
    let one = |i: i32| {
        let at = f64::from(i) / 120.0;
        PoseSample {
            station: 1,
            transmitter_from_sensor: simulated.measured(at, random),
            arrived_at: instant(at + options.tracker_latency + 0.0003 * random.normal()),
            error: None,
        }
    };
    (0..count).map(one).collect()
}

fn calibrate_mounting(
    options: SimulationOptions,
    mounting: MountingOptions,
) -> (SimulatedRig, Finished) {
    let simulated = SimulatedRig::new(options);
    let mut random = Random::new(simulated.options.seed + 77);
    let tags = TagMap::new(simulated.tags.clone()).unwrap();
    let mut step = MountingStep::new(
        &rig(&simulated).calibration,
        Landmarks::Tags(tags),
        mounting,
    );
    for sample in readings(&simulated, &mut random) {
        step.observe(&StepInput::Pose(&sample));
    }
    step.camera_poses = camera_poses(&simulated, &mut random);
    let found = step.finish(&CalibrationProvenance::default());
    (simulated, found)
}

/// Returns the rig's calibration with the result applied.
fn apply(simulated: &SimulatedRig, found: &Finished) -> RigDocument {
    let file = found.file.clone().expect("a file");
    let mut rig = rig(simulated);
    let get = |name: &str| match name {
        TRACKER | LATENCY => Some(file.as_bytes()),
        _ => None,
    };
    if file.contains("\"step\": \"tracker\"") {
        apply_tracker_file(&mut rig, &get).unwrap();
    } else {
        apply_latency_file(&mut rig, &get).unwrap();
    }
    rig
}

/// Returns the error of the camera's mounting, metres and degrees.
fn mounting_error(simulated: &SimulatedRig, rig: &RigDocument) -> (f64, f64) {
    let found = rig.calibration.tracker.as_ref().unwrap();
    let (a, b) = (found.sensor_from_scene_camera, simulated.sensor_from_camera);
    (
        a.translation.distance(b.translation),
        a.rotation.angle_between(b.rotation).to_degrees(),
    )
}

/// Returns the RMS position error of the composed pose on another path through the same room, metres.
fn registration_rms(simulated: &SimulatedRig, rig: &RigDocument) -> f64 {
    let tracker = rig.calibration.tracker.as_ref().unwrap();
    let mut random = Random::new(9);
    let mut sum = 0.0;
    for i in 0..300 {
        let at = 0.5 + simulated.options.seconds * f64::from(i) / 300.0;
        let composed = tracker.world_from_scene_camera(simulated.measured(at, &mut random));
        let truth = simulated.world_from_camera(at);
        sum += composed.translation.distance_squared(truth.translation);
    }
    (sum / 300.0).sqrt()
}

#[test]
fn recovers_mounting_within_a_millimetre_and_a_tenth_of_a_degree() {
    for seed in 1..7 {
        let options = SimulationOptions {
            seed,
            tracker_noise: (0.6, 0.1),
            camera_latency: 0.006,
            gaps: 0.05,
            jumps: 0.01,
            ..SimulationOptions::default()
        };
        let (simulated, found) = calibrate_mounting(options, MountingOptions::default());
        assert_eq!(found.grade, Grade::Good, "{seed}: {:?}", found.findings);
        let rig = apply(&simulated, &found);
        let (position, rotation) = mounting_error(&simulated, &rig);
        assert!(
            position < 0.001 && rotation < 0.1,
            "{seed}: {position} m, {rotation}°"
        );
        let tracker = rig.calibration.tracker.as_ref().unwrap();
        let transmitter = tracker.world_from_transmitter;
        let truth = simulated.world_from_transmitter;
        assert!(
            transmitter.translation.distance(truth.translation) < 0.003,
            "{seed}"
        );
        let latency = 1e-9 * tracker.latency_nanos as f64;
        assert!((latency - 0.0173).abs() < 0.002, "{seed}: {latency}");
        assert!(found.report.contains("<svg") && !found.report.contains("NaN"));
    }
}

#[test]
fn corrects_distortion_only_where_that_helps() {
    for seed in [3, 11] {
        let distorted = SimulationOptions {
            seed,
            metal: 0.012,
            seconds: 40.0,
            ..SimulationOptions::default()
        };
        let mounting = MountingOptions {
            distortion: true,
            ..MountingOptions::default()
        };
        let (simulated, plain) = calibrate_mounting(distorted.clone(), MountingOptions::default());
        let (_, found) = calibrate_mounting(distorted, mounting.clone());
        let with = apply(&simulated, &found);
        assert!(with.calibration.tracker.as_ref().unwrap().field.is_some());
        let without = plain.file.is_some().then(|| apply(&simulated, &plain));
        let (before, after) = (
            without.map_or(1.0, |w| registration_rms(&simulated, &w)),
            registration_rms(&simulated, &with),
        );
        assert!(
            after < 0.6 * before && after < 0.003,
            "{seed}: {before} {after}"
        );
        let undistorted = SimulationOptions {
            seed,
            ..SimulationOptions::default()
        };
        let (simulated, found) = calibrate_mounting(undistorted, mounting);
        let rig = apply(&simulated, &found);
        assert!(rig.calibration.tracker.as_ref().unwrap().field.is_none());
        assert!(
            found
                .findings
                .iter()
                .any(|f| f.1.contains("would not help")),
            "{:?}",
            found.findings
        );
    }
}

#[test]
fn refuses_degenerate_motion_with_its_reason() {
    for (motion, message) in [
        (Motion::OneAxis, "about nearly one axis"),
        (Motion::Slide, "degrees at most"),
        (Motion::Still, "degrees at most"),
    ] {
        let options = SimulationOptions {
            motion,
            ..SimulationOptions::default()
        };
        let (_, found) = calibrate_mounting(options, MountingOptions::default());
        assert_eq!(found.grade, Grade::Refused, "{motion:?}");
        assert!(found.file.is_none());
        let first = &found.findings[0].1;
        assert!(first.contains(message) && !first.contains('\n'), "{first}");
    }
}

#[test]
fn reports_missing_readings() {
    let simulated = SimulatedRig::new(SimulationOptions::default());
    let tags = TagMap::new(simulated.tags.clone()).unwrap();
    let calibration = rig(&simulated).calibration;
    let mut step = MountingStep::new(
        &calibration,
        Landmarks::Tags(tags),
        MountingOptions::default(),
    );
    let found = step.finish(&CalibrationProvenance::default());
    assert!(found.findings[0].1.contains("no tracker readings"));
    step.observe(&StepInput::Pose(&PoseSample {
        station: 2,
        transmitter_from_sensor: RigidTransform::IDENTITY,
        arrived_at: instant(0.0),
        error: None,
    }));
    let found = step.finish(&CalibrationProvenance::default());
    assert!(
        found.findings[0].1.contains("only of 2"),
        "{:?}",
        found.findings
    );
    let mut step = LatencyStep::new(&calibration, None, LatencyOptions::default());
    let found = step.finish(&CalibrationProvenance::default());
    assert!(found.grade == Grade::Refused && found.file.is_none());
}

/// Runs the step on poses alone: rendered tests cover the pictures.
fn calibrate_latency(options: SimulationOptions) -> (SimulatedRig, Finished) {
    let simulated = SimulatedRig::new(options);
    let mut random = Random::new(simulated.options.seed + 5);
    let mut step = LatencyStep::new(
        &rig(&simulated).calibration,
        None,
        LatencyOptions::default(),
    );
    for sample in readings(&simulated, &mut random) {
        step.observe(&StepInput::Pose(&sample));
    }
    step.camera_poses = camera_poses(&simulated, &mut random);
    step.zero = step.camera_poses.first().map(|s| s.stamp);
    let found = step.finish(&CalibrationProvenance::default());
    (simulated, found)
}

#[test]
fn recovers_latency_within_a_millisecond() {
    for seed in 1..6 {
        let options = SimulationOptions {
            seed,
            tracker_latency: 0.004 * seed as f64,
            camera_latency: 0.01,
            tracker_noise: (0.5, 0.1),
            ..SimulationOptions::default()
        };
        let (simulated, found) = calibrate_latency(options.clone());
        assert_eq!(found.grade, Grade::Good, "{:?}", found.findings);
        let rig = apply(&simulated, &found);
        let tracker = rig.calibration.tracker.as_ref().unwrap();
        let error = 1e-9 * tracker.latency_nanos as f64 - options.tracker_latency;
        assert!(error.abs() < 0.001, "{seed}: {error}");
        // Only the latency changes.
        assert_eq!(tracker.sensor_from_scene_camera, RigidTransform::IDENTITY);
    }
}

#[test]
fn refuses_motion_that_does_not_determine_the_latency() {
    for motion in [Motion::Still, Motion::Slide] {
        let options = SimulationOptions {
            motion,
            tracker_noise: (0.5, 0.1),
            ..SimulationOptions::default()
        };
        let (_, found) = calibrate_latency(options);
        assert_eq!(found.grade, Grade::Refused, "{motion:?} {:?}", found.lines);
        assert!(found.file.is_none());
    }
}

#[test]
fn rejects_refused_or_invalid_files() {
    let (simulated, found) =
        calibrate_mounting(SimulationOptions::default(), MountingOptions::default());
    let file = found.file.unwrap();
    for (from, to, message) in [
        (
            "\"verdict\": \"good\"",
            "\"verdict\": \"refused\"",
            "was refused",
        ),
        (
            "\"step\": \"tracker\"",
            "\"step\": \"map\"",
            "is of the step",
        ),
        (
            "\"penumbra_calibration\": 1",
            "\"penumbra_calibration\": 9",
            "newer",
        ),
        (
            "\"metres_per_unit\": 0.01",
            "\"metres_per_unit\": -1.0",
            "above 0",
        ),
        (
            "\"quaternion_wxyz\": [",
            "\"quaternion_wxyz\": [7.0, 0.0, 0.0, 0.0], \"x\": [",
            "length 1",
        ),
    ] {
        let corrupted = file.replacen(from, to, 1);
        assert_ne!(corrupted, file, "{from}");
        let get = |name: &str| (name == TRACKER).then_some(corrupted.as_bytes());
        let error = apply_tracker_file(&mut rig(&simulated), &get)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(message) && error.starts_with(TRACKER),
            "{error}"
        );
    }
}
