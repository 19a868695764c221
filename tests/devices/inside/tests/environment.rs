//! Whether the guest is what the other tests take it for: these use the kernel directly.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

use penumbra_guest::rig::{
    ENVIRONMENT, Reading, SCENE, TRACKER, plug_tracker, read_jpeg, ready, usbcam, vivid, wait_until,
};
use penumbra_guest::serial;
use penumbra_guest::v4l2::{
    AUTO_EXPOSURE, AUTO_WHITE_BALANCE, Camera, EXPOSURE_TIME, FOCUS, GAIN, POWER_LINE_FREQUENCY,
    Stream, VIVID_BUFFER_ERROR, VIVID_DISCONNECT, VIVID_FATAL_ERROR, VIVID_LOST_PERCENT,
    WHITE_BALANCE_TEMPERATURE,
};
use rustix::io::Errno;
use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

fn open(path: impl AsRef<Path>, width: u32, height: u32, fourcc: &[u8; 4]) -> Camera {
    let camera = Camera::open(path.as_ref()).unwrap();
    camera.set_format(width, height, fourcc).unwrap();
    camera
}

/// The scene camera with everything that changes its picture locked.
fn locked() -> Camera {
    let camera = open(SCENE, 640, 480, b"MJPG");
    let values = [
        (AUTO_WHITE_BALANCE, 0),
        (AUTO_EXPOSURE, 1),
        (WHITE_BALANCE_TEMPERATURE, 5000),
        (EXPOSURE_TIME, 157),
        (GAIN, 32),
    ];
    for (id, value) in values {
        camera.set(id, value).unwrap();
    }
    camera
}

fn readings(stream: &mut Stream, count: usize) -> Vec<Reading> {
    stream
        .take(count)
        .iter()
        .map(|frame| read_jpeg(&frame.data))
        .collect()
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn vivid_streams_from_two_cameras_at_once() {
    let nodes = vivid();
    assert_eq!(nodes.len(), 2);
    let stream = |node| {
        open(node, 640, 480, b"YUYV")
            .stream()
            .unwrap()
            .take(15)
            .len()
    };
    let threads: Vec<_> = nodes
        .into_iter()
        .map(|n| std::thread::spawn(move || stream(n)))
        .collect();
    for thread in threads {
        assert_eq!(thread.join().unwrap(), 15);
    }
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn vivid_has_faults_when_told() {
    let node = &vivid()[0];
    let camera = open(node, 320, 180, b"YUYV");
    let mut stream = camera.stream().unwrap();
    stream.take(2);
    camera.set(VIVID_BUFFER_ERROR, 1).unwrap();
    assert!(stream.take(6).iter().any(|frame| frame.damaged));
    camera.set(VIVID_LOST_PERCENT, 50).unwrap();
    let frames = stream.take(20);
    camera.set(VIVID_LOST_PERCENT, 0).unwrap();
    assert!(
        frames[19].sequence - frames[0].sequence > 19,
        "no frame was lost"
    );
    camera.set(VIVID_FATAL_ERROR, 1).unwrap();
    assert_eq!(stream.error_within(6), Some(Errno::IO));
    drop(stream);

    let mut stream = camera.stream().unwrap();
    stream.take(2);
    camera.set(VIVID_DISCONNECT, 1).unwrap();
    assert_eq!(stream.error_within(6), Some(Errno::NODEV));
    drop(stream);
    drop(camera); // the last one to close it connects it again
    open(node, 320, 180, b"YUYV").stream().unwrap().take(3);
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_controls_obey_their_automatic_modes() {
    ready();
    let camera = Camera::open(Path::new(SCENE)).unwrap();
    camera.set(AUTO_WHITE_BALANCE, 1).unwrap();
    camera.set(AUTO_EXPOSURE, 3).unwrap();
    assert_eq!(
        camera.set(WHITE_BALANCE_TEMPERATURE, 4000),
        Err(Errno::ACCESS)
    );
    assert_eq!(camera.set(EXPOSURE_TIME, 321), Err(Errno::ACCESS));
    camera.set(AUTO_WHITE_BALANCE, 0).unwrap();
    camera.set(AUTO_EXPOSURE, 1).unwrap();
    let values = [
        (WHITE_BALANCE_TEMPERATURE, 4000),
        (EXPOSURE_TIME, 321),
        (GAIN, 77),
    ];
    for (id, value) in values.into_iter().chain([(POWER_LINE_FREQUENCY, 1)]) {
        camera.set(id, value).unwrap();
        assert_eq!(camera.get(id), Ok(value));
    }
    camera.set(GAIN, 9999).unwrap();
    assert_eq!(camera.get(GAIN), Ok(255), "clamped without a word");
    let environment = Camera::open(Path::new(ENVIRONMENT)).unwrap();
    assert!(camera.get(FOCUS).is_ok() && environment.get(FOCUS) == Err(Errno::INVAL));
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_tells_one_program_what_another_changed() {
    ready();
    let [watching, other] = [(); 2].map(|()| Camera::open(Path::new(SCENE)).unwrap());
    watching.watch(GAIN).unwrap();
    assert_eq!(watching.next_change(Duration::from_millis(100)), Ok(None));
    other.set(GAIN, 99).unwrap();
    assert_eq!(watching.next_change(Duration::from_secs(2)), Ok(Some(GAIN)));
    assert_eq!(watching.get(GAIN), Ok(99));
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_frames_show_what_they_were_exposed_with() {
    ready();
    let camera = locked();
    let mut stream = camera.stream().unwrap();
    let normal = readings(&mut stream, 5);
    for pair in normal.windows(2) {
        assert!(pair[1].number > pair[0].number, "{normal:?}");
    }
    let settled = normal[4];
    assert!(
        (settled.light - 1.0).abs() < 0.03 && settled.tint.abs() < 2.0,
        "{normal:?}"
    );
    camera.set(EXPOSURE_TIME, 314).unwrap();
    camera.set(WHITE_BALANCE_TEMPERATURE, 6500).unwrap();
    let changed = readings(&mut stream, 8)[7];
    assert!(
        (changed.light - 2.0).abs() < 0.1 && changed.tint < -5.0,
        "{changed:?}"
    );
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_settings_show_late_by_the_lag() {
    ready();
    let camera = locked();
    let mut stream = camera.stream().unwrap();
    usbcam("lag scene 6");
    stream.take(8);
    // A frame that begins after the control was set may be exposed with it.
    let before = usbcam("state scene");
    camera.set(EXPOSURE_TIME, 314).unwrap();
    let set_after: u32 = before
        .split_whitespace()
        .find_map(|w| w.strip_prefix("frame="))
        .unwrap()
        .parse()
        .unwrap();
    let frames = readings(&mut stream, 20);
    let first = frames
        .iter()
        .find(|frame| frame.light > 1.5)
        .expect("the exposure shows");
    let late = first.number - set_after;
    assert!(
        (7..=10).contains(&late),
        "shows {late} frames later: {frames:?}"
    );
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_frames_may_lack_huffman_tables() {
    ready();
    usbcam("tables scene off");
    let camera = locked();
    let frames = camera.stream().unwrap().take(4);
    let has_tables = frames[3].data.windows(2).any(|pair| pair == [0xff, 0xc4]);
    assert!(!has_tables && (read_jpeg(&frames[3].data).light - 1.0).abs() < 0.03);
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_frames_are_damaged_with_a_flag_or_cut_without() {
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
        "the driver cannot know"
    );
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_falls_silent_when_frozen() {
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
fn uvc_comes_back_while_the_other_streams() {
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
    wait_until("its name is gone", || !Path::new(SCENE).exists());
    usbcam("plug scene");
    wait_until("its name is back", || Path::new(SCENE).exists());
    open(SCENE, 1280, 720, b"MJPG").stream().unwrap().take(3);
    others.take(3);
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn uvc_starts_and_stops_many_times() {
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

#[test]
#[ignore = "needs the guest: make test-devices"]
fn serial_port_carries_bytes_and_notices_its_unplugging() {
    ready();
    let mut tracker = serial::open("/dev/ttyGS0");
    let mut port = serial::open(TRACKER);
    let every_byte: Vec<u8> = (0..=255).collect();
    let mut got = [0; 256];
    tracker.write_all(&every_byte).unwrap();
    port.read_exact(&mut got).unwrap();
    assert_eq!(got.as_slice(), every_byte);
    port.write_all(b"C\r").unwrap();
    tracker.read_exact(&mut got[..2]).unwrap();
    assert_eq!(&got[..2], b"C\r");
    drop(tracker);
    plug_tracker(false);
    assert!(
        matches!(port.read(&mut got), Ok(0) | Err(_)),
        "a read ends when the plug is pulled"
    );
    drop(port);
    wait_until("its name is gone", || !Path::new(TRACKER).exists());
    plug_tracker(true);
    wait_until("its name is back", || Path::new(TRACKER).exists());
}
