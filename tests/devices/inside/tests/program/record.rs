//! `penumbra record`

use crate::setup::{LOCKED, Light, SimulatedTracker, keep, record};
use penumbra_guest::program::succeeds;
use penumbra_guest::recording::{assert_in_order, read, read_image, seconds, stream};
use std::time::{Duration, Instant};

#[test]
#[ignore = "needs the guest: make test-devices"]
fn writes_every_stream_of_a_rig() {
    let tracker = SimulatedTracker::start();
    let recorder = record("whole", &Light::Vivid, true, &["--duration", "6"]);
    let output = recorder.program.output();
    let status = recorder.program.end(Duration::from_secs(30));
    assert!(status.success(), "{status}\n{output}");
    tracker.stop();

    let streams = read(&recorder.file);
    let images = stream(&streams, "/scene_camera/image");
    assert!(images.len() > 60, "{} pictures", images.len());
    for (topic, entries) in &streams {
        assert_in_order(topic, entries);
    }
    let raw = stream(&streams, "/environment_camera/image_raw");
    let bytes = stream(&streams, "/tracker/bytes");
    for entries in [images, raw, bytes] {
        assert!(seconds(entries) > 4.0, "{} s", seconds(entries));
    }
    let received: usize = bytes.iter().map(|entry| entry.data.len()).sum();
    assert!(received > 4 * 60 * 20, "{received} bytes of the tracker");

    let controls = &stream(&streams, "/scene_camera/controls")
        .last()
        .unwrap()
        .data;
    let controls: serde_json::Value = serde_json::from_slice(controls).unwrap();
    for (name, value) in LOCKED {
        assert_eq!(controls["controls"][name], value, "{controls:#}");
    }
    locked_pictures(images);

    let path = recorder.file.to_str().unwrap();
    let info = succeeds(&["info", path]);
    for topic in [
        "/scene_camera/image",
        "/environment_camera/image_raw",
        "/tracker/bytes",
        "fastrak",
    ] {
        assert!(info.contains(topic), "no {topic} in\n{info}");
    }
    keep(&recorder.file, "rig.mcap");
}

/// Checks from the pictures that no automatic mode was active.
fn locked_pictures(images: &[penumbra_guest::recording::Entry]) {
    let settled = images.iter().skip(10).map(read_image);
    for reading in settled {
        assert!(
            (reading.light - 1.0).abs() < 0.05 && reading.tint.abs() < 4.0,
            "{reading:?}"
        );
    }
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn killed_recorder_leaves_a_readable_session() {
    let recorder = record("killed", &Light::Usb, false, &[]);
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(5) {
        std::thread::sleep(Duration::from_millis(50));
    }
    let recorded_to = monotonic_nanos();
    recorder.program.kill();
    succeeds(&["info", recorder.file.to_str().unwrap()]);
    let streams = read(&recorder.file);
    for topic in ["/scene_camera/image", "/environment_camera/image"] {
        let last = stream(&streams, topic).last().unwrap().arrived;
        let lost = (recorded_to.saturating_sub(last)) as f64 * 1e-9;
        assert!(lost < 1.2, "{topic}: the last {lost:.2} s are missing");
    }
    keep(&recorder.file, "killed.mcap");
}

/// The recording's clock.
pub fn monotonic_nanos() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}
