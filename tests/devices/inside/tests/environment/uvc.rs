//! Emulated USB cameras on the kernel's UVC driver: controls and their effects.

use super::locked;
use penumbra_guest::rig::{ENVIRONMENT, Reading, SCENE, read_jpeg, ready, usbcam};
use penumbra_guest::v4l2::{
    AUTO_EXPOSURE, AUTO_WHITE_BALANCE, Camera, EXPOSURE_TIME, FOCUS, GAIN, POWER_LINE_FREQUENCY,
    Stream, WHITE_BALANCE_TEMPERATURE,
};
use rustix::io::Errno;
use std::path::Path;
use std::time::Duration;

fn readings(stream: &mut Stream, count: usize) -> Vec<Reading> {
    stream
        .take(count)
        .iter()
        .map(|frame| read_jpeg(&frame.data))
        .collect()
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn controls_obey_their_automatic_modes() {
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
    assert_eq!(camera.get(GAIN), Ok(255), "clamped without an error");
    let environment = Camera::open(Path::new(ENVIRONMENT)).unwrap();
    assert!(camera.get(FOCUS).is_ok() && environment.get(FOCUS) == Err(Errno::INVAL));
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn reports_changes_of_controls_by_other_programs() {
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
fn frames_encode_their_exposure() {
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
fn settings_take_effect_after_the_lag() {
    ready();
    let camera = locked();
    let mut stream = camera.stream().unwrap();
    usbcam("lag scene 6");
    stream.take(8);
    // A frame that begins after the control was set may be exposed with the new value.
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
        .expect("a frame with the new exposure");
    let late = first.number - set_after;
    assert!(
        (7..=10).contains(&late),
        "takes effect {late} frames later: {frames:?}"
    );
}
