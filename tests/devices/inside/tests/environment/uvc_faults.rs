//! Emulated USB cameras that misbehave.

use super::{locked, open};
use penumbra_guest::rig::{ENVIRONMENT, SCENE, read_jpeg, ready, usbcam, wait_until};
use penumbra_guest::v4l2::GAIN;
use rustix::io::Errno;
use std::path::Path;

#[test]
#[ignore = "needs the guest: make test-devices"]
fn frames_may_lack_huffman_tables() {
    ready();
    usbcam("tables scene off");
    let camera = locked();
    let frames = camera.stream().unwrap().take(4);
    let has_tables = frames[3].data.windows(2).any(|pair| pair == [0xff, 0xc4]);
    assert!(!has_tables && (read_jpeg(&frames[3].data).light - 1.0).abs() < 0.03);
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn frames_are_damaged_with_a_flag_or_cut_without() {
    ready();
    let camera = locked();
    let mut stream = camera.stream().unwrap();
    stream.take(2);
    usbcam("errors scene 2");
    let flagged = stream.take(10).iter().filter(|frame| frame.damaged).count();
    assert_eq!(flagged, 2);
    usbcam("truncate scene 3");
    let frames = stream.take(12);
    let cut = frames
        .iter()
        .filter(|frame| !frame.data.ends_with(&[0xff, 0xd9]))
        .count();
    assert_eq!(cut, 3);
    assert!(
        frames.iter().all(|frame| !frame.damaged),
        "the driver cannot detect it"
    );
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn falls_silent_when_frozen() {
    ready();
    let camera = locked();
    let mut stream = camera.stream().unwrap();
    stream.take(2);
    usbcam("freeze scene");
    assert_eq!(stream.error_within(10), Some(Errno::TIMEDOUT));
    assert_eq!(camera.get(GAIN), Ok(32), "a frozen camera still answers");
    usbcam("thaw scene");
    stream.take(3);
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn replugged_camera_returns_while_the_other_streams() {
    ready();
    let camera = open(SCENE, 1280, 720, b"MJPG");
    let other = open(ENVIRONMENT, 640, 480, b"YUYV");
    let (mut stream, mut others) = (camera.stream().unwrap(), other.stream().unwrap());
    stream.take(3);
    others.take(3);
    usbcam("unplug scene");
    assert_eq!(stream.error_within(40), Some(Errno::NODEV));
    others.take(3);
    drop(stream);
    drop(camera);
    wait_until("its link is removed", || !Path::new(SCENE).exists());
    usbcam("plug scene");
    wait_until("its link is restored", || Path::new(SCENE).exists());
    open(SCENE, 1280, 720, b"MJPG").stream().unwrap().take(3);
    others.take(3);
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn starts_and_stops_many_times() {
    ready();
    for node in [SCENE, ENVIRONMENT] {
        for round in 0..5 {
            open(node, 640, 480, b"YUYV")
                .stream()
                .unwrap()
                .take(2 + round % 3);
        }
    }
}
