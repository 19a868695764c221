//! Tests of the driver with the kernel's video devices.
//!
//! `PENUMBRA_TEST_CAMERA` names the camera, in any way that the settings allow; without it all
//! tests print SKIPPED. Tests that need a certain driver or control are skipped with
//! other cameras. `vivid` is the kernel's simulated camera, which can produce faults.
#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, clippy::panic)]

use penumbra_camera_v4l2::{BracketSettings, CameraInfo, CameraSettings, OnChange};
use penumbra_camera_v4l2::{list_cameras, open};
use penumbra_interface::{
    Camera, ControlStanding, DeviceError, Frame, PixelFormat, Recovery, SystemClock,
};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use v4l::control::{Control, Value};

/// Long, because a virtual machine under software emulation is slow.
const TIME_LIMIT: Duration = Duration::from_secs(20);
const WAIT: Duration = Duration::from_millis(500);

const BRIGHTNESS: u32 = 0x0098_0900;
// Controls by which `vivid` produces faults (drivers/media/test-drivers/vivid/vivid-ctrls.c).
/// Percentage of frames to lose.
const DROPPED_BUFFERS: u32 = 0x00f0_f040;
/// Until the last program has closed the device.
const DISCONNECT: u32 = 0x00f0_f041;
/// On the next frame.
const ERROR_FLAG: u32 = 0x00f0_f042;

/// A camera serves one test at a time.
static ALONE: Mutex<()> = Mutex::new(());

/// The camera under test and the right to use it. `None`, after printing the reason, if the
/// test cannot run with it; `needs` is a driver or a control, or empty.
fn camera(test: &str, needs: &str) -> Option<(CameraInfo, MutexGuard<'static, ()>)> {
    let Ok(device) = std::env::var("PENUMBRA_TEST_CAMERA") else {
        println!("SKIPPED {test}: PENUMBRA_TEST_CAMERA names no camera");
        return None;
    };
    let lock = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let names = |c: &CameraInfo| {
        [
            Some(&c.identity),
            Some(&c.node),
            c.by_id.as_ref(),
            c.by_path.as_ref(),
        ]
        .into_iter()
        .flatten()
        .any(|name| *name == device)
    };
    let found = list_cameras().into_iter().find(names);
    let info = found.unwrap_or_else(|| panic!("{device} is not among the cameras"));
    let offers = |name: &str| info.controls.iter().any(|c| c.name == name);
    if !needs.is_empty() && info.driver != needs && !offers(needs) {
        println!("SKIPPED {test}: {device} ({}) has no {needs}", info.driver);
        return None;
    }
    Some((info, lock))
}

/// Settings for the smallest size, which is fast enough under emulation.
fn settings(info: &CameraInfo) -> CameraSettings {
    let readable = info
        .formats
        .iter()
        .find(|f| f.usable && !f.sizes.is_empty())
        .unwrap();
    let smallest = readable
        .sizes
        .iter()
        .min_by_key(|s| s.width * s.height)
        .unwrap();
    CameraSettings {
        device: info.identity.clone(),
        width: smallest.width,
        height: smallest.height,
        silence: Duration::from_secs(4),
        ..CameraSettings::default()
    }
}

fn start(settings: &CameraSettings) -> Box<dyn Camera> {
    open(settings, Arc::new(SystemClock)).unwrap()
}

fn frame(camera: &mut dyn Camera) -> Frame {
    let began = Instant::now();
    while began.elapsed() < TIME_LIMIT {
        if let Some(frame) = camera.next_frame(WAIT).unwrap() {
            return frame;
        }
    }
    panic!("no frame in {TIME_LIMIT:?}");
}

/// Reads until the camera fails.
fn failure(camera: &mut dyn Camera) -> DeviceError {
    let began = Instant::now();
    while began.elapsed() < TIME_LIMIT {
        if let Err(error) = camera.next_frame(WAIT) {
            return error;
        }
    }
    panic!("no failure in {TIME_LIMIT:?}");
}

/// Sets a control as another program would, through a separate file descriptor.
fn set_externally(info: &CameraInfo, id: u32, value: i64) {
    let value = Value::Integer(value);
    let device = v4l::Device::with_path(&info.node).unwrap();
    device.set_control(Control { id, value }).unwrap();
}

#[test]
fn describes_a_camera() {
    let Some((info, _lock)) = camera("describes_a_camera", "") else {
        return;
    };
    assert!(!info.identity.is_empty() && !info.driver.is_empty());
    let sized = |f: &&penumbra_interface::CameraFormat| f.usable && !f.sizes.is_empty();
    let format = info.formats.iter().find(sized).expect("a readable format");
    assert!(
        format
            .sizes
            .iter()
            .any(|s| s.frames_per_second.iter().any(|r| *r > 1.0))
    );
    let brightness = info
        .controls
        .iter()
        .find(|c| c.name == "brightness")
        .unwrap();
    assert!(brightness.min < brightness.max && brightness.current.is_some());
    assert_eq!(info.trouble, None);
}

#[test]
fn frames_arrive_in_order_with_plausible_time_stamps() {
    let Some((info, _lock)) = camera("frames_arrive_in_order_with_plausible_time_stamps", "")
    else {
        return;
    };
    let mut camera = start(&settings(&info));
    let mut last: Option<Frame> = None;
    for _ in 0..60 {
        let frame = frame(&mut *camera);
        let age = frame.arrived_at.seconds_since(frame.captured_at);
        assert!(
            (-0.1..5.0).contains(&age),
            "captured {age} s before it arrived"
        );
        if let Some(last) = last {
            assert!(frame.sequence > last.sequence);
            assert!(frame.captured_at > last.captured_at);
        }
        if frame.format != PixelFormat::Jpeg {
            assert!(frame.data.len() >= (frame.width * frame.height) as usize);
        }
        last = Some(frame);
    }
    let report = camera.report();
    assert_eq!(report.counters.frames, 60);
    assert_eq!(report.counters.damaged, 0);
    assert_eq!(report.identity, info.identity);
    println!(
        "{:?} {:?} {:?}",
        report.mode, report.stamps, report.counters
    );
}

#[test]
fn controls_are_held_adjusted_or_missing_and_restored() {
    let name = "controls_are_held_adjusted_or_missing_and_restored";
    let Some((info, _lock)) = camera(name, "brightness") else {
        return;
    };
    let brightness = info
        .controls
        .iter()
        .find(|c| c.name == "brightness")
        .unwrap();
    let wanted = brightness.min + (brightness.max - brightness.min) / 4;
    // Another control with a range; not all cameras have the same ones.
    let other = ["contrast", "saturation", "gain"];
    let other = *other
        .iter()
        .find(|n| info.controls.iter().any(|c| c.name == **n))
        .unwrap();
    let mut settings = settings(&info);
    settings.controls = vec![
        ("brightness".into(), wanted),
        (other.into(), 1_000_000),
        ("no_such_control".into(), 1),
    ];
    settings.on_change = OnChange::Restore;
    let mut camera = start(&settings);
    let standing = |camera: &dyn Camera| {
        let report = camera.report();
        let named = |name: &str| report.controls.iter().find(|c| &*c.name == name).cloned();
        ["brightness", other, "no_such_control"].map(|name| named(name).unwrap())
    };
    let [held, adjusted, missing] = standing(&*camera);
    assert_eq!(
        (held.in_force, &held.standing),
        (Some(wanted), &ControlStanding::Held)
    );
    assert_eq!(adjusted.standing, ControlStanding::Adjusted);
    assert_eq!(missing.standing, ControlStanding::Missing);
    frame(&mut *camera);
    set_externally(&info, BRIGHTNESS, brightness.max);
    let began = Instant::now();
    while camera.report().counters.controls_changed == 0 {
        frame(&mut *camera);
        assert!(began.elapsed() < TIME_LIMIT, "the change was not noticed");
    }
    assert_eq!(standing(&*camera)[0].in_force, Some(wanted));
    let frame = frame(&mut *camera);
    let in_force = frame.controls.unwrap();
    assert!(
        in_force
            .iter()
            .any(|(name, v)| &**name == "brightness" && *v == wanted)
    );
    set_externally(&info, BRIGHTNESS, brightness.default);
}

#[test]
fn distinguishes_camera_in_use_missing_camera_and_other_device() {
    let name = "distinguishes_camera_in_use_missing_camera_and_other_device";
    let Some((info, _lock)) = camera(name, "") else {
        return;
    };
    let settings = settings(&info);
    let _camera = start(&settings);
    let refused = |settings: &CameraSettings| open(settings, Arc::new(SystemClock)).err().unwrap();
    assert!(matches!(refused(&settings), DeviceError::Busy { .. }));
    let on = |device: &str| CameraSettings {
        device: device.into(),
        ..settings.clone()
    };
    assert!(matches!(
        refused(&on("/dev/video99")),
        DeviceError::NotFound { .. }
    ));
    assert!(matches!(
        refused(&on("usb:dead:beef")),
        DeviceError::NotFound { .. }
    ));
    let no_camera = refused(&on("/dev/null"));
    assert!(
        no_camera.to_string().contains("`penumbra devices` lists"),
        "{no_camera}"
    );
    let wide = CameraSettings {
        width: 12_345,
        ..settings
    };
    let not_offered = refused(&wide).to_string();
    assert!(not_offered.contains("it offers"), "{not_offered}");
}

#[test]
fn skips_frames_with_the_error_flag() {
    let Some((info, _lock)) = camera("skips_frames_with_the_error_flag", "vivid") else {
        return;
    };
    let mut camera = start(&settings(&info));
    frame(&mut *camera);
    let began = Instant::now();
    while camera.report().counters.damaged == 0 {
        set_externally(&info, ERROR_FLAG, 1);
        frame(&mut *camera);
        assert!(began.elapsed() < TIME_LIMIT, "no damaged frame was counted");
    }
}

#[test]
fn silent_camera_is_reported_and_continues() {
    let Some((info, _lock)) = camera("silent_camera_is_reported_and_continues", "vivid") else {
        return;
    };
    let mut camera = start(&settings(&info));
    frame(&mut *camera);
    set_externally(&info, DROPPED_BUFFERS, 100);
    let error = failure(&mut *camera);
    set_externally(&info, DROPPED_BUFFERS, 0);
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
    assert!(error.to_string().starts_with(&info.node), "{error}");
    // The same stream continues: the time-outs have lost no buffer.
    let began = Instant::now();
    while !matches!(camera.next_frame(WAIT), Ok(Some(_))) {
        assert!(began.elapsed() < TIME_LIMIT, "the stream did not continue");
    }
}

#[test]
fn unplugged_camera_is_reopened() {
    let Some((info, _lock)) = camera("unplugged_camera_is_reopened", "vivid") else {
        return;
    };
    let settings = settings(&info);
    let mut camera = start(&settings);
    frame(&mut *camera);
    set_externally(&info, DISCONNECT, 1);
    let error = failure(&mut *camera);
    assert!(matches!(error, DeviceError::Unplugged { .. }), "{error}");
    assert_eq!(error.recovery(), Recovery::Reopen);
    drop(camera);
    let began = Instant::now();
    let mut again = loop {
        match open(&settings, Arc::new(SystemClock)) {
            Ok(camera) => break camera,
            Err(error) => assert!(began.elapsed() < TIME_LIMIT, "{error}"),
        }
        std::thread::sleep(Duration::from_millis(100));
    };
    frame(&mut *again);
}

#[test]
fn exposures_are_cycled_and_labelled() {
    let Some((info, _lock)) = camera(
        "exposures_are_cycled_and_labelled",
        "exposure_time_absolute",
    ) else {
        return;
    };
    let exposure = info
        .controls
        .iter()
        .find(|c| c.name == "exposure_time_absolute")
        .unwrap();
    let base = exposure.max.min(exposure.min.max(1) * 64);
    let mut settings = settings(&info);
    settings.controls = vec![
        ("exposure_time_absolute".into(), base),
        ("auto_exposure".into(), 1),
    ];
    // The lag is configured, because an emulated camera's frames may not show their exposure.
    settings.bracket = Some(BracketSettings {
        lag: Some(1),
        ..BracketSettings::default()
    });
    let mut camera = start(&settings);
    let mut seen = BTreeSet::new();
    for _ in 0..30 {
        let frame = frame(&mut *camera);
        let micros = frame.exposure.unwrap().exposure_micros;
        let ev = (micros / (base as f64 * 100.0)).log2();
        assert!((frame.bracket_ev - ev).abs() < 1e-9);
        seen.insert(micros as i64);
    }
    assert!(seen.len() >= 2, "{seen:?}");
    println!("{seen:?} {:?}", camera.report().counters);
}
