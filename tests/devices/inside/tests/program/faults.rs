//! Devices that are unplugged, fall silent, send damaged frames, or are tampered with.

use crate::setup::{Light, Recorder, record};
use penumbra_guest::recording::{longest_gap, read, read_image, stream};
use penumbra_guest::rig::{SCENE, usbcam, wait_until};
use penumbra_guest::v4l2::{Camera, EXPOSURE_TIME, GAIN};
use std::path::Path;
use std::time::{Duration, Instant};

/// The number of the newest frame that the scene camera has delivered to somebody.
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
    recorder.program.wait_until("frames are taken", flows);
    recorder
}

fn pause(millis: u64) {
    std::thread::sleep(Duration::from_millis(millis));
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn a_camera_that_is_plugged_in_again_streams_within_two_seconds() {
    let recorder = streaming("replugged");
    usbcam("unplug scene");
    wait_until("its name is gone", || !Path::new(SCENE).exists());
    pause(700);
    usbcam("plug scene");
    wait_until("its name is back", || Path::new(SCENE).exists());
    let back = Instant::now();
    wait_until("it streams again", || {
        delivered().is_some_and(|number| number > 2)
    });
    let seconds = back.elapsed().as_secs_f64();
    assert!(seconds < 2.0, "streams {seconds:.2} s after its return");
    pause(700);
    recorder.program.stop();

    let streams = read(&recorder.file);
    let others = longest_gap(stream(&streams, "/environment_camera/image"));
    assert!(others < 0.5, "the other camera paused for {others:.2} s");
    let images = stream(&streams, "/scene_camera/image");
    assert!(longest_gap(images) > 0.7, "it was never away");
    // Locked again: after its return, too, the picture shows it.
    let last = read_image(images.last().unwrap());
    assert!((last.light - 1.0).abs() < 0.05, "{last:?}");
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn damaged_frames_are_counted_and_left_out() {
    let recorder = streaming("damaged");
    usbcam("errors scene 3");
    pause(1000);
    usbcam("truncate scene 4");
    pause(1500);
    let file = recorder.file.clone();
    recorder.program.stop();
    let said = std::fs::read_to_string("/out/tests/program.damaged.program.log").unwrap();
    assert!(
        said.contains("7 damaged") || said.contains("damaged: 7"),
        "{said}"
    );
    let file = read(&file);
    let images = stream(&file, "/scene_camera/image").iter();
    let numbers: Vec<_> = images.map(|image| read_image(image).number).collect();
    assert!(numbers.len() > 20, "{numbers:?}");
    assert!(numbers.windows(2).all(|w| w[0] < w[1]), "{numbers:?}");
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn a_frozen_camera_is_named_and_comes_back() {
    let recorder = streaming("frozen");
    usbcam("freeze scene");
    let names_it = |said: &str| {
        said.lines()
            .any(|l| l.contains("silent") && l.contains("Scene_Camera"))
    };
    wait_until("the silent camera is named", || {
        names_it(&recorder.program.said())
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
fn a_control_that_another_program_changes_is_set_back() {
    let recorder = streaming("tampered");
    let other = Camera::open(Path::new(SCENE)).unwrap();
    for (id, wrong, right) in [(GAIN, 200, 32), (EXPOSURE_TIME, 900, 157)] {
        other.set(id, wrong).unwrap();
        wait_until("the value is back", || other.get(id) == Ok(right));
    }
    pause(300);
    recorder.program.stop();
    let said = std::fs::read_to_string("/out/tests/program.tampered.program.log").unwrap();
    assert!(said.contains("gain"), "not a word of the change:\n{said}");
}
