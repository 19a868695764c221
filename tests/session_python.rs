//! Other software can read a session: the Python `mcap` package decodes it by the schemas in the
//! file alone.
#![expect(clippy::unwrap_used)]

use glam::{DQuat, DVec3};
use penumbra_config::{CameraSource, Config, RecordingConfig, TrackerSource};
use penumbra_interface::{Exposure, Frame, MonotonicTime, PixelFormat, PoseSample, RigidTransform};
use penumbra_rig::{Live, Recorder, live_settings};
use penumbra_session::{Camera, SessionWriter};
use penumbra_status::SharedStatus;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn at(nanos: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(nanos)
}

fn record(path: &Path) {
    let mut frame = Frame {
        data: b"a picture".to_vec().into(),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence: 41,
        captured_at: at(1_000_000_900),
        arrived_at: at(1_000_001_000),
        exposure: Some(Exposure {
            exposure_micros: 8000.0,
            gain: 1.5,
        }),
        bracket_ev: 0.0,
        controls: None,
    };
    let mut writer = SessionWriter::create(path).unwrap();
    writer.attach("rig.json", b"{}").unwrap();
    writer.attach("object/textures/wood.png", b"png").unwrap();
    writer.frame(Camera::Scene, &frame).unwrap();
    frame.exposure = None;
    (frame.bracket_ev, frame.arrived_at) = (-4.0, at(1_000_002_000));
    writer.frame(Camera::Environment, &frame).unwrap();
    frame.bracket_ev = 0.0;
    (frame.format, frame.data, frame.width, frame.height) =
        (PixelFormat::Yuyv, vec![0; 16].into(), 4, 2);
    writer.frame(Camera::Environment, &frame).unwrap();
    writer
        .tracker_bytes("fastrak", b"01 bytes", at(1_000_003_000))
        .unwrap();
    let sample = PoseSample {
        station: 1,
        transmitter_from_sensor: RigidTransform::new(DQuat::IDENTITY, DVec3::new(0.5, -1.0, 2.0)),
        arrived_at: at(1_000_004_000),
        error: None,
    };
    writer.pose(&sample).unwrap();
    let (captured_at, composed_at) = (at(1_000_000_900), at(1_000_005_000));
    let jpeg = b"a composite".to_vec().into();
    writer.composite(jpeg, captured_at, composed_at).unwrap();
    writer.finish().unwrap();
}

const EXPECTED: &str = "\
messages 7
1000001000 /scene_camera/exposure penumbra.Exposure 41 8000.0 1.5
1000001000 /scene_camera/image foxglove.CompressedImage 41 1000000900 jpeg a picture
1000002000 /environment_camera/image_ev-4 foxglove.CompressedImage 41 1000000900 jpeg a picture
1000002000 /environment_camera/image_raw foxglove.RawImage yuyv 4x2/8 16
1000003000 /tracker/bytes penumbra.TrackerBytes fastrak 01 bytes
1000004000 /tracker/pose foxglove.FrameTransform tracker sensor_1 0.5 -1.0 2.0 0.0 0.0 0.0 1.0
1000005000 /composite/image foxglove.CompressedImage 0 1000000900 jpeg a composite
attachment rig.json application/json {}
attachment object/textures/wood.png image/png png
";

#[test]
fn python_reads_recorded_messages() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    record(&path);
    let python = std::env::var("PENUMBRA_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/session_python.py");
    let output = match Command::new(&python).arg(script).arg(&path).output() {
        Ok(output) if output.status.code() != Some(77) => output,
        _ => {
            eprintln!(
                "SKIPPED python_reads_recorded_messages: {python} lacks mcap or protobuf; \
                 name another one in PENUMBRA_PYTHON"
            );
            return;
        }
    };
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert_eq!(String::from_utf8_lossy(&output.stdout), EXPECTED);
}

/// Number of messages by topic.
fn topics(path: &Path) -> BTreeMap<String, usize> {
    let bytes = std::fs::read(path).unwrap();
    let mut counts = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        *counts
            .entry(message.unwrap().channel.topic.clone())
            .or_default() += 1;
    }
    counts
}

/// Records a live rig whose devices replay the bundled session.
fn record_live_rig(path: &Path) {
    let session = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/sessions/desk.mcap");
    let mut config = Config::default();
    config.scene_camera.source = CameraSource::Replay(session.clone());
    config.environment_camera = Some(CameraSource::Replay(session.clone()));
    config.tracker = Some(TrackerSource::Replay(session.clone()));
    config.calibration = Some(session);
    let status = SharedStatus::new(live_settings(&config));
    let live = Live::new(&config, false).unwrap();
    let recording = RecordingConfig {
        reserve_bytes: 0,
        ..RecordingConfig::default()
    };
    let (hub, contents) = (live.hub.clone(), live.contents.clone());
    let recorder = Recorder::new(hub, contents, recording, status.clone());
    recorder.start(path, None, false).unwrap();
    live.open().unwrap();
    let begun = Instant::now();
    // The environment camera is the slowest of them.
    let is_enough = || {
        let events = status.snapshot().recording.events;
        let supervised = live.supervised().iter();
        events >= 200
            && supervised
                .clone()
                .all(|device| device.status().received >= 3)
    };
    while !is_enough() {
        assert!(begun.elapsed() < Duration::from_secs(60), "nothing arrives");
        std::thread::sleep(Duration::from_millis(20));
    }
    recorder.stop().unwrap();
}

#[test]
fn recording_of_a_live_rig_has_calibrations_and_frame_tree_as_a_simulated_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.mcap");
    record_live_rig(&path);
    let counts = topics(&path);
    let count = |topic: &str| counts.get(topic).copied().unwrap_or_default();
    assert_eq!(count("/scene_camera/calibration"), 1, "{counts:?}");
    assert_eq!(count("/environment_camera/calibration"), 1, "{counts:?}");
    // Three constant transforms, then a pose for each record of the tracker.
    let poses = count("/tf");
    assert!(
        poses > 10 && poses + 3 >= count("/tracker/bytes"),
        "{counts:?}"
    );
    let python = std::env::var("PENUMBRA_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has_packages = Command::new(&python)
        .args(["-c", "import mcap, mcap_protobuf, lz4, zstandard"])
        .output()
        .is_ok_and(|out| out.status.success());
    if !has_packages {
        eprintln!(
            "SKIPPED recording of a live rig: the Python packages of `.ci/test mcap` are missing"
        );
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/judge/mcap_opens.py");
    let judged = Command::new(&python)
        .arg(script)
        .arg(&path)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&judged.stdout);
    assert!(judged.status.success(), "{judged:?}");
    assert!(
        said.contains("messages on") && !said.contains("SKIPPED"),
        "{said}"
    );
}
