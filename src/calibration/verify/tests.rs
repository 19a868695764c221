//! A synthetic rig: three tags on a table, a hand-held camera on a tracker.

use super::*;
use glam::{DQuat, DVec2, DVec3, EulerRot};
use penumbra_fiducials::synthetic::{render, tag};
use penumbra_picture::Picture;
use penumbra_rig_model::Grade;
use penumbra_rig_model::Marker;
use penumbra_rig_model::TrackerCalibration;
use penumbra_white_balance::WhiteBalanceSettings;

const LATENCY: f64 = 0.02;

fn rig() -> RigDocument {
    let mut rig = RigDocument::uncalibrated(320, 240);
    let camera = &mut rig.calibration.scene_camera.camera;
    camera.focal = DVec2::splat(300.0);
    camera.centre = DVec2::new(159.0, 121.0);
    rig.calibration.environment = None;
    rig.calibration.tracker = Some(TrackerCalibration {
        world_from_transmitter: RigidTransform::new(
            DQuat::from_rotation_z(0.4),
            DVec3::new(0.5, 0.2, 0.1),
        ),
        sensor_from_scene_camera: RigidTransform::new(
            DQuat::from_rotation_x(1.2),
            DVec3::new(0.02, 0.01, -0.03),
        ),
        latency_nanos: (1e9 * LATENCY) as i64,
        metres_per_unit: 1.0,
        field: None,
    });
    let centres = [(-0.09, -0.05), (0.1, 0.0), (0.0, 0.09)];
    rig.markers = centres.iter().zip(1..).map(marker).collect();
    rig
}

fn marker((&(x, y), id): (&(f64, f64), u32)) -> Marker {
    Marker {
        family: "tag36h11".to_owned(),
        id,
        size: 0.08,
        world_from_marker: RigidTransform::new(DQuat::IDENTITY, DVec3::new(x, y, 0.0)),
    }
}

/// Returns a pose in front of the tags (their +Z points into the paper), with irregular rotation.
fn world_from_camera(t: f64) -> RigidTransform {
    let rotation = DQuat::from_euler(
        EulerRot::XYZ,
        0.25 * (3.1 * t).sin() + 0.1 * (7.3 * t).sin(),
        0.2 * (2.3 * t + 1.0).sin(),
        0.3 * (1.7 * t).sin(),
    );
    let centre = DVec3::new(0.02 * (2.0 * t).sin(), 0.01, 0.0);
    RigidTransform::new(rotation, centre + rotation * DVec3::new(0.0, 0.0, -0.55))
}

/// Gives `step` six seconds of the ground-truth rig's data.
fn feed(step: &mut Verify) {
    let truth = rig();
    let tracker = truth.calibration.tracker.clone().unwrap();
    let camera = &truth.calibration.scene_camera.camera;
    let tags: Vec<_> = truth
        .markers
        .iter()
        .map(|m| tag(m.id, m.size, m.world_from_marker.translation))
        .collect();
    let time = |t: f64| MonotonicTime::from_nanos((1e9 * (t + 5.0)) as i64);
    for i in 0..720 {
        let t = f64::from(i) / 120.0;
        let sensor = tracker.world_from_transmitter.inverse()
            * world_from_camera(t)
            * tracker.sensor_from_scene_camera.inverse();
        let sample = PoseSample {
            station: 1,
            transmitter_from_sensor: sensor,
            arrived_at: time(t + LATENCY),
            error: None,
        };
        step.observe(&StepInput::Pose(&sample));
        // The tracker's readings at a picture's time arrive after it.
        if i % 8 == 7 && t > 0.3 {
            let at = t - 0.1;
            let codes = render(camera, world_from_camera(at).inverse(), &tags, 1.0);
            let rgba = codes.iter().flat_map(|&c| [c, c, c, 255]).collect();
            step.observe(&StepInput::Picture(PictureInput {
                camera: CameraRole::Scene,
                picture: &Picture {
                    width: 320,
                    height: 240,
                    rgba,
                },
                captured_at: time(at),
                bracket_ev: 0.0,
                exposure: None,
                seconds: at,
            }));
        }
    }
}

fn check(rig: RigDocument) -> Finished {
    let family = |m: &Marker| m.family.parse().unwrap();
    let tags = rig.markers.iter().map(|m| penumbra_fiducials::Tag {
        family: family(m),
        id: m.id,
        size: m.size,
        map_from_tag: m.world_from_marker,
    });
    let known = CheckedRig {
        map: TagMap::new(tags.collect()).unwrap(),
        rig,
        caster: None,
        station: 1,
    };
    let white_balance = WhiteBalanceMatch::new(WhiteBalanceSettings::default(), false);
    let mut step = Verify::new(known, white_balance);
    feed(&mut step);
    assert!(step.progress().message.contains("with markers"));
    step.finish(&CalibrationProvenance {
        date: "2026-11-22T00:00:00Z".to_owned(),
        source: "synthetic".to_owned(),
        ..CalibrationProvenance::default()
    })
}

#[test]
fn correct_rig_passes_and_reports_its_figures() {
    let found = check(rig());
    assert_eq!(
        found.grade,
        Grade::Good,
        "{:?} {:?}",
        found.lines,
        found.findings
    );
    let file: serde_json::Value = serde_json::from_str(&found.file.unwrap()).unwrap();
    let number = |key: &str| file[key].as_f64().unwrap();
    assert!(number("reprojection_px") < 0.3, "{file}");
    assert!((number("latency_ms") - 1e3 * LATENCY).abs() < 2.0, "{file}");
    assert_eq!(file["verdict"], "good");
    assert!(found.report.contains("Error over time"), "no plots");
}

#[test]
fn rotated_camera_mount_is_refused() {
    let mut slipped = rig();
    let tracker = slipped.calibration.tracker.as_mut().unwrap();
    let mount = &mut tracker.sensor_from_scene_camera;
    mount.rotation *= DQuat::from_rotation_y(1.5f64.to_radians());
    let found = check(slipped);
    assert_eq!(found.grade, Grade::Refused, "{:?}", found.lines);
    let first = &found.findings[0].1;
    assert!(first.contains("calibrate tracker"), "{first}");
    // A refused check still writes its file.
    assert!(found.file.unwrap().contains("refused"));
}

#[test]
fn wrong_latency_is_measured() {
    let mut late = rig();
    late.calibration.tracker.as_mut().unwrap().latency_nanos += 15_000_000;
    let found = check(late);
    assert_ne!(found.grade, Grade::Good, "{:?}", found.lines);
    let is_reported = found
        .findings
        .iter()
        .any(|f| f.1.contains("calibrate latency"));
    assert!(is_reported, "{:?} {:?}", found.findings, found.lines);
}
