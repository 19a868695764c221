//! Devices that are unplugged, fall silent, send damaged frames, or are changed by another program.

use crate::setup::{Light, Recorder, record};
use penumbra_guest::recording::{longest_gap, read, read_image, stream};
use penumbra_guest::rig::{SCENE, usbcam, wait_until};
use penumbra_guest::v4l2::{Camera, EXPOSURE_TIME, GAIN};
use std::path::Path;
use std::time::{Duration, Instant};

/// The number of the newest frame that the scene camera has delivered to a program.
fn delivered() -> Option<u32> {
    let state = usbcam("state scene");
    let number = state
        .split_whitespace()
        .find_map(|word| word.strip_prefix("frame="));
    number.map(|number| number.parse().unwrap())
}

fn streaming(name: &str) -> Recorder {
    let mut recorder = record(name, &Light::Usb, false, &[]);
    let flows = |_: &str| delivered().is_some_and(|number| number > 20);
    recorder.program.wait_until("frames are read", flows);
    recorder
}

fn pause(millis: u64) {
    std::thread::sleep(Duration::from_millis(millis));
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn replugged_camera_streams_within_two_seconds() {
    let recorder = streaming("replugged");
    usbcam("unplug scene");
    wait_until("its link is removed", || !Path::new(SCENE).exists());
    pause(700);
    usbcam("plug scene");
    wait_until("its link is restored", || Path::new(SCENE).exists());
    let back = Instant::now();
    wait_until("it streams again", || {
        delivered().is_some_and(|number| number > 2)
    });
    let seconds = back.elapsed().as_secs_f64();
    assert!(
        seconds < 2.0,
        "streams {seconds:.2} s after it was plugged in"
    );
    pause(700);
    recorder.program.stop();

    let streams = read(&recorder.file);
    let others = longest_gap(stream(&streams, "/environment_camera/image"));
    assert!(others < 0.5, "the other camera paused for {others:.2} s");
    let images = stream(&streams, "/scene_camera/image");
    assert!(longest_gap(images) > 0.7, "it was never unplugged");
    // The controls are locked again: the pictures after reopening show it.
    let last = read_image(images.last().unwrap());
    assert!((last.light - 1.0).abs() < 0.05, "{last:?}");
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn damaged_frames_are_counted_and_not_recorded() {
    let recorder = streaming("damaged");
    usbcam("errors scene 3");
    pause(1000);
    usbcam("truncate scene 4");
    pause(1500);
    let file = recorder.file.clone();
    recorder.program.stop();
    let output = std::fs::read_to_string("/out/tests/program.damaged.program.log").unwrap();
    assert!(
        output.contains("7 damaged") || output.contains("damaged: 7"),
        "{output}"
    );
    let file = read(&file);
    let images = stream(&file, "/scene_camera/image").iter();
    let numbers: Vec<_> = images.map(|image| read_image(image).number).collect();
    assert!(numbers.len() > 20, "{numbers:?}");
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn frozen_camera_is_reported_and_reopened() {
    let recorder = streaming("frozen");
    usbcam("freeze scene");
    let names_it = |output: &str| {
        output
            .lines()
            .any(|l| l.contains("silent") && l.contains("Scene_Camera"))
    };
    wait_until("the silent camera is reported", || {
        names_it(&recorder.program.output())
    });
    usbcam("thaw scene");
    let before = delivered().unwrap();
    wait_until("it streams again", || {
        delivered().is_some_and(|number| number > before + 5)
    });
    recorder.program.stop();
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn control_changed_by_another_program_is_restored() {
    let recorder = streaming("tampered");
    let other = Camera::open(Path::new(SCENE)).unwrap();
    for (id, wrong, right) in [(GAIN, 200, 32), (EXPOSURE_TIME, 900, 157)] {
        other.set(id, wrong).unwrap();
        wait_until("the value is restored", || other.get(id) == Ok(right));
    }
    pause(300);
    recorder.program.stop();
    let output = std::fs::read_to_string("/out/tests/program.tampered.program.log").unwrap();
    assert!(
        output.contains("gain"),
        "the change is not reported:\n{output}"
    );
}
