use super::*;
use crate::device::ControlKind;
use crate::testing::{FakeDevice, FakeFrame, Sensor};
use penumbra_interface::{
    BracketSettings, ControlStanding, MonotonicTime, OnChange, PixelFormat, Recovery, StampSource,
};
use std::collections::{BTreeMap, VecDeque};

const AUTO: u32 = 1;
const TIME: u32 = 2;
const GAIN: u32 = 3;
const WAIT: Duration = Duration::from_millis(100);

fn webcam() -> FakeDevice {
    let fake = FakeDevice::streaming(b"GREY", 16, 16);
    fake.add_control(AUTO, "Auto Exposure", ControlKind::Menu, (0, 3));
    fake.add_control(
        TIME,
        "Exposure Time, Absolute",
        ControlKind::Integer,
        (1, 2047),
    );
    fake.add_control(GAIN, "Gain", ControlKind::Integer, (0, 255));
    fake.edit(AUTO, |c| c.value = 3);
    fake.edit(TIME, |c| c.needs = Some((AUTO, 1)));
    fake
}

fn settings() -> CameraSettings {
    let locked = [
        ("exposure_time_absolute", 160),
        ("auto_exposure", 1),
        ("gain", 4),
    ];
    CameraSettings {
        width: 16,
        height: 16,
        controls: locked
            .map(|(name, value)| (name.to_owned(), value))
            .to_vec(),
        gain_per_unit: Some(0.25),
        on_change: OnChange::Restore,
        ..CameraSettings::default()
    }
}

fn open(
    fake: &FakeDevice,
    settings: &CameraSettings,
) -> Result<V4l2Camera<FakeDevice>, DeviceError> {
    let names = CameraNames {
        identity: "usb-Camera".to_owned(),
        path: "/dev/video7".to_owned(),
        is_numbered: true,
    };
    V4l2Camera::start(fake.clone(), names, settings, fake.clock())
}

fn picture(sequence: u32) -> FakeFrame {
    FakeFrame::new(sequence, vec![sequence as u8; 256])
}

#[test]
fn a_frame_has_the_time_and_the_settings_of_its_exposure() {
    let fake = webcam();
    let mut camera = open(&fake, &settings()).unwrap();
    fake.arrives(40, picture(0));
    let frame = camera.next_frame(WAIT).unwrap().unwrap();
    let exposure = frame.exposure.unwrap();
    assert_eq!((exposure.exposure_micros, exposure.gain), (16_000.0, 1.0));
    // Arrived at 40 ms, time stamp 20 ms before that, exposed for 16 ms from then on.
    assert_eq!(frame.captured_at, MonotonicTime::from_nanos(28_000_000));
    assert_eq!(frame.arrived_at, MonotonicTime::from_nanos(40_000_000));
    assert_eq!(
        (frame.format, frame.width, frame.height),
        (PixelFormat::Grey8, 16, 16)
    );
    let controls = frame.controls.unwrap();
    assert!(
        controls
            .iter()
            .any(|(name, value)| &**name == "gain" && *value == 4)
    );
    let report = camera.report();
    assert_eq!(report.stamps, StampSource::StartOfExposure);
    assert!(
        report
            .controls
            .iter()
            .all(|c| c.standing == ControlStanding::Held)
    );
    assert!(
        report.notes[0].contains("write usb-Camera"),
        "{:?}",
        report.notes
    );
    assert_eq!(camera.next_frame(WAIT).unwrap().map(|f| f.sequence), None);
}

#[test]
fn controls_are_set_before_the_stream_starts_and_again_after() {
    let fake = webcam();
    let _camera = open(&fake, &settings()).unwrap();
    let written = fake.lock().written.clone();
    assert_eq!(
        written,
        [
            (AUTO, 1),
            (TIME, 160),
            (GAIN, 4),
            (AUTO, 1),
            (TIME, 160),
            (GAIN, 4)
        ]
    );
}

#[test]
fn a_change_by_another_program_is_undone_between_frames() {
    let fake = webcam();
    let mut camera = open(&fake, &settings()).unwrap();
    fake.arrives(10, picture(0));
    camera.next_frame(WAIT).unwrap().unwrap();
    fake.set_externally(GAIN, 200);
    fake.arrives(20, picture(1));
    let frame = camera.next_frame(WAIT).unwrap().unwrap();
    assert_eq!(frame.exposure.unwrap().gain, 1.0);
    assert_eq!(
        (fake.value(GAIN), camera.report().counters.controls_changed),
        (4, 1)
    );
}

#[test]
fn unplugging_during_the_stream_is_reported() {
    let fake = webcam();
    let mut camera = open(&fake, &settings()).unwrap();
    fake.arrives(10, picture(0));
    camera.next_frame(WAIT).unwrap().unwrap();
    fake.lock().dequeue_errors.push_back(Errno::NODEV);
    fake.lock().stop_error = Some(Errno::NODEV);
    fake.arrives(20, picture(1));
    let error = camera.next_frame(WAIT).unwrap_err();
    assert_eq!(
        error.to_string(),
        "/dev/video7: disconnected; plug it in again"
    );
    assert_eq!(error.recovery(), Recovery::Reopen);
}

#[test]
fn a_format_that_is_not_offered_is_a_fatal_error() {
    let fake = webcam();
    let wanted = CameraSettings {
        formats: vec![PixelFormat::Jpeg],
        ..settings()
    };
    let error = open(&fake, &wanted).err().unwrap();
    assert_eq!(
        error.to_string(),
        "/dev/video7: no Jpeg at 16×16; it offers GREY 16×16"
    );
    assert_eq!(error.recovery(), Recovery::Fatal);
}

/// A camera that applies exposures `lag` frames late, and whose frames are as bright as their
/// exposure, with some noise.
fn sensor(lag: u32) -> Sensor {
    Sensor {
        period: 33_000_000,
        lag,
        next: 0,
        exposures: VecDeque::from([(0, 160)]),
        image: Box::new(|sequence, exposure| {
            let noise = i64::from(sequence.wrapping_mul(2_654_435_761) >> 30);
            vec![(exposure + 4 + noise).clamp(0, 255) as u8; 256]
        }),
    }
}

#[test]
fn bracketed_frames_are_labelled_with_their_true_exposure() {
    for lag in 0..=4 {
        let fake = webcam();
        let wanted = CameraSettings {
            bracket: Some(BracketSettings::default()),
            ..settings()
        };
        let mut camera = open(&fake, &wanted).unwrap();
        fake.lock().sensor = Some(sensor(lag));
        let mut seen = BTreeMap::new();
        for _ in 0..60 {
            let frame = camera.next_frame(Duration::from_secs(5)).unwrap().unwrap();
            let exposure = frame.exposure.unwrap().exposure_micros / 100.0;
            let shown = f64::from(frame.data[0]) - 4.0;
            assert!(
                (shown - exposure).abs() <= 3.0,
                "shows {shown}, labelled {exposure}"
            );
            assert_eq!(frame.bracket_ev, (exposure / 160.0).log2());
            let controls = frame.controls.unwrap();
            let control = controls
                .iter()
                .find(|c| &*c.0 == "exposure_time_absolute")
                .unwrap()
                .1;
            assert_eq!(control as f64, exposure);
            *seen.entry(control).or_insert(0) += 1;
        }
        assert_eq!(seen.keys().copied().collect::<Vec<_>>(), [10, 40, 160]);
        assert!(seen.values().all(|n| *n >= 15), "{seen:?}");
        let report = camera.report();
        assert!(report.counters.unattributed > 20);
        let note = format!("bracketing: new exposures take effect after {lag} frames");
        assert!(report.notes.contains(&note), "{:?}", report.notes);
    }
}

#[test]
fn bracketing_needs_manual_exposure_and_a_range() {
    let fake = webcam();
    let mut wanted = CameraSettings {
        bracket: Some(BracketSettings::default()),
        ..CameraSettings::default()
    };
    let error = open(&fake, &wanted).err().unwrap().to_string();
    assert!(error.contains("auto_exposure = 1"), "{error}");
    wanted.controls = settings().controls;
    fake.edit(TIME, |c| c.description.min = 160);
    let error = open(&fake, &wanted).err().unwrap().to_string();
    assert!(
        error.contains("makes the exposures [160] (range 160 to 2047)"),
        "{error}"
    );
}
