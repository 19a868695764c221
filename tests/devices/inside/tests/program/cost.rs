//! Processor time of capturing.

use crate::record::monotonic_nanos;
use crate::setup::{Recorder, start};
use penumbra_guest::recording::{Entry, read, stream};
use penumbra_guest::rig::{ready, vivid, wait_until};
use std::path::Path;
use std::time::Duration;

const WINDOW: Duration = Duration::from_secs(3);

/// Two of vivid's cameras, raw pictures of 640×480.
fn two_cameras() -> Recorder {
    ready();
    let folder = Path::new("/tmp/cost");
    std::fs::create_dir_all(folder).unwrap();
    let nodes = vivid();
    let camera = |i: usize| {
        format!(
            "device = \"{}\"\nformats = [\"yuyv\"]\nwidth = 640\nheight = 480\n",
            nodes[i].display()
        )
    };
    let text = format!(
        "[scene_camera]\n{}[environment_camera]\n{}[recording]\nreserve_mb = 10\n",
        camera(0),
        camera(1)
    );
    let config = folder.join("rig.toml");
    std::fs::write(&config, text).unwrap();
    start("cost", &config, &[])
}

/// Number of arrivals between two instants.
fn between(entries: &[Entry], from: u64, to: u64) -> usize {
    let within = |entry: &&Entry| (from..to).contains(&entry.arrived);
    entries.iter().filter(within).count()
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn capturing_two_cameras_uses_little_processor_time() {
    let recorder = two_cameras();
    wait_until("both cameras stream", || {
        let both = ["scene-camera", "env-camera"];
        let times = recorder.program.thread_times();
        let size = std::fs::metadata(&recorder.file).map_or(0, |file| file.len());
        size > 10_000_000 && both.iter().all(|name| times.contains_key(*name))
    });
    let (from, before) = (monotonic_nanos(), recorder.program.thread_times());
    std::thread::sleep(WINDOW);
    let (to, after) = (monotonic_nanos(), recorder.program.thread_times());
    recorder.program.stop();

    let streams = read(&recorder.file);
    for (thread, topic) in [
        ("scene-camera", "/scene_camera/image_raw"),
        ("env-camera", "/environment_camera/image_raw"),
    ] {
        let frames = between(stream(&streams, topic), from, to);
        let spent = (after[thread] - before[thread]) as f64;
        let (each, share) = (spent * 1e-6 / frames as f64, spent / (to - from) as f64);
        // The suite prints this line.
        println!(
            "measured: {thread} (V4L2, vivid, 640x480 YUYV): {each:.2} ms a frame, {:.1} % of a core, \
             {frames} frames in {:.1} s, under software emulation",
            share * 100.0,
            (to - from) as f64 * 1e-9
        );
        assert!(frames >= 5, "{topic}: {frames} frames");
        assert!(spent > 0.0 && share < 0.5, "{thread}: {share}");
    }
    std::fs::remove_file(&recorder.file).unwrap();
}
