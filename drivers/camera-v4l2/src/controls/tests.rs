use super::*;
use crate::device::ControlKind;
use crate::testing::FakeDevice;
use penumbra_interface::ControlStanding;
use rustix::io::Errno;
use v4l::control::Flags;

const AUTO: u32 = 1;
const TIME: u32 = 2;
const WB_AUTO: u32 = 3;
const WB: u32 = 4;
const GAIN: u32 = 5;
const FOCUS: u32 = 6;

/// A webcam as `uvcvideo` presents it, with all automatic modes on.
fn webcam() -> FakeDevice {
    let fake = FakeDevice::streaming(b"YUYV", 4, 2);
    fake.add_control(AUTO, "Auto Exposure", ControlKind::Menu, (0, 3));
    fake.add_control(
        TIME,
        "Exposure Time, Absolute",
        ControlKind::Integer,
        (3, 2047),
    );
    fake.add_control(
        WB_AUTO,
        "White Balance, Automatic",
        ControlKind::Boolean,
        (0, 1),
    );
    fake.add_control(
        WB,
        "White Balance Temperature",
        ControlKind::Integer,
        (2800, 6500),
    );
    fake.add_control(GAIN, "Gain", ControlKind::Integer, (0, 255));
    fake.add_control(FOCUS, "Focus, Absolute", ControlKind::Integer, (0, 250));
    fake.edit(AUTO, |c| c.value = 3);
    fake.edit(WB_AUTO, |c| c.value = 1);
    fake.edit(TIME, |c| c.needs = Some((AUTO, 1)));
    fake.edit(WB, |c| c.needs = Some((WB_AUTO, 0)));
    fake
}

fn settings(controls: &[(&str, i64)], on_change: OnChange) -> CameraSettings {
    let controls = controls
        .iter()
        .map(|(name, value)| ((*name).to_owned(), *value));
    CameraSettings {
        controls: controls.collect(),
        on_change,
        gain_per_unit: Some(0.5),
        ..CameraSettings::default()
    }
}

fn applied(fake: &FakeDevice, settings: &CameraSettings) -> CameraControls {
    let mut controls = CameraControls::new(fake, settings);
    controls.apply(&mut fake.clone()).unwrap();
    controls.subscribe(&mut fake.clone());
    controls
}

fn standing(controls: &CameraControls, name: &str) -> (Option<i64>, ControlStanding) {
    let report = controls.report();
    let found = report.iter().find(|r| &*r.name == name).unwrap();
    (found.in_force, found.standing.clone())
}

fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(millis * 1_000_000)
}

#[test]
fn automatic_modes_are_switched_off_before_values_are_set() {
    let fake = webcam();
    let wanted = [
        ("white_balance_temperature", 4600),
        ("exposure_absolute", 100),
        ("gain", 2),
        ("white_balance_temperature_auto", 0),
        ("exposure_auto", 1),
    ];
    let controls = applied(&fake, &settings(&wanted, OnChange::Report));
    for (name, value) in wanted {
        assert_eq!(
            standing(&controls, name),
            (Some(value), ControlStanding::Held),
            "{name}"
        );
    }
    let exposure = controls.exposure().unwrap();
    assert_eq!((exposure.exposure_micros, exposure.gain), (10_000.0, 1.0));
    assert_eq!(controls.value("white_balance_temperature"), Some(4600));
}

#[test]
fn a_refusal_names_the_automatic_mode() {
    let fake = webcam();
    let controls = applied(
        &fake,
        &settings(&[("exposure_time_absolute", 100)], OnChange::Report),
    );
    let (in_force, standing) = standing(&controls, "exposure_time_absolute");
    assert_eq!(in_force, Some(3));
    let ControlStanding::Refused(reason) = standing else {
        panic!("{standing:?}");
    };
    assert_eq!(
        reason,
        "auto_exposure = 3 governs it; lock auto_exposure = 1, too"
    );
    assert_eq!(
        controls.exposure(),
        None,
        "an automatic exposure is not known"
    );
}

#[test]
fn detects_driver_that_accepts_and_ignores_a_value() {
    let fake = webcam();
    fake.edit(TIME, |c| {
        c.needs = None;
        c.ignores_writes = true;
        c.description.flags = Flags::INACTIVE;
    });
    let controls = applied(
        &fake,
        &settings(&[("exposure_time_absolute", 3)], OnChange::Report),
    );
    let (_, standing) = standing(&controls, "exposure_time_absolute");
    assert!(
        matches!(standing, ControlStanding::Refused(_)),
        "{standing:?}"
    );
}

#[test]
fn out_of_range_and_missing_controls_are_reported() {
    let fake = webcam();
    fake.edit(FOCUS, |c| c.refuses_out_of_range = true);
    let wanted = [("gain", 999), ("focus_absolute", -5), ("pan_absolute", 0)];
    let controls = applied(&fake, &settings(&wanted, OnChange::Report));
    assert_eq!(
        standing(&controls, "gain"),
        (Some(255), ControlStanding::Adjusted)
    );
    assert_eq!(
        standing(&controls, "focus_absolute"),
        (Some(0), ControlStanding::Adjusted)
    );
    assert_eq!(
        standing(&controls, "pan_absolute"),
        (None, ControlStanding::Missing)
    );
}

#[test]
fn a_change_by_another_program_is_reported_or_restored() {
    let wanted = [("gain", 7)];
    let fake = webcam();
    let mut controls = applied(&fake, &settings(&wanted, OnChange::Report));
    fake.set_externally(GAIN, 90);
    controls.on_events(&mut fake.clone(), at(0)).unwrap();
    assert_eq!(
        standing(&controls, "gain"),
        (Some(90), ControlStanding::Changed)
    );
    assert_eq!((controls.changes, fake.value(GAIN)), (1, 90));
    let note = controls.changes_note().unwrap();
    assert_eq!(note, "another program changed gain; not restored");
    fake.set_externally(GAIN, 7);
    controls.on_events(&mut fake.clone(), at(1)).unwrap();
    assert_eq!(
        standing(&controls, "gain"),
        (Some(7), ControlStanding::Held)
    );
    assert_eq!(controls.changes, 1);

    let fake = webcam();
    let mut controls = applied(&fake, &settings(&wanted, OnChange::Restore));
    fake.set_externally(GAIN, 90);
    controls.on_events(&mut fake.clone(), at(0)).unwrap();
    assert_eq!(
        standing(&controls, "gain"),
        (Some(7), ControlStanding::Held)
    );
    assert_eq!((controls.changes, fake.value(GAIN)), (1, 7));
}

#[test]
fn values_are_not_restored_all_the_time() {
    let fake = webcam();
    let mut controls = applied(&fake, &settings(&[("gain", 7)], OnChange::Restore));
    let before = fake.lock().written.len();
    for millis in 0..500 {
        fake.set_externally(GAIN, 90);
        controls.on_events(&mut fake.clone(), at(millis)).unwrap();
    }
    assert_eq!(fake.lock().written.len() - before, 1);
    assert_eq!(standing(&controls, "gain").1, ControlStanding::Changed);
    controls.tick(&mut fake.clone(), at(1001)).unwrap();
    assert_eq!(fake.value(GAIN), 7, "restored after the interval");
}

#[test]
fn restoring_a_mode_also_restores_the_controls_that_it_governs() {
    let fake = webcam();
    let wanted = [("auto_exposure", 1), ("exposure_time_absolute", 100)];
    let mut controls = applied(&fake, &settings(&wanted, OnChange::Restore));
    fake.edit(TIME, |c| c.value = 333);
    fake.set_externally(AUTO, 3);
    controls.on_events(&mut fake.clone(), at(0)).unwrap();
    assert_eq!((fake.value(AUTO), fake.value(TIME)), (1, 100));
}

#[test]
fn the_published_state_is_shared_until_it_changes() {
    let fake = webcam();
    let mut controls = applied(&fake, &settings(&[("gain", 7)], OnChange::Report));
    let (before, report) = (controls.in_force(), controls.report());
    controls.on_events(&mut fake.clone(), at(0)).unwrap();
    controls.tick(&mut fake.clone(), at(5000)).unwrap();
    assert!(Arc::ptr_eq(&before, &controls.in_force()));
    assert!(Arc::ptr_eq(&report, &controls.report()));
    fake.set_externally(GAIN, 8);
    controls.on_events(&mut fake.clone(), at(0)).unwrap();
    assert!(!Arc::ptr_eq(&before, &controls.in_force()));
    assert!(
        controls
            .in_force()
            .iter()
            .any(|(name, value)| &**name == "gain" && *value == 8)
    );
}

#[test]
fn controls_without_events_are_read_back_regularly() {
    let fake = webcam();
    let mut controls = CameraControls::new(&fake, &settings(&[("gain", 7)], OnChange::Report));
    controls.apply(&mut fake.clone()).unwrap();
    fake.edit(GAIN, |c| c.value = 8);
    controls.tick(&mut fake.clone(), at(3000)).unwrap();
    assert_eq!(
        standing(&controls, "gain"),
        (Some(8), ControlStanding::Changed)
    );
}

#[test]
fn only_disconnection_is_an_error() {
    let fake = webcam();
    fake.lock().control_error = Some(Errno::IO);
    let controls = applied(&fake, &settings(&[("gain", 7)], OnChange::Report));
    assert!(matches!(
        standing(&controls, "gain").1,
        ControlStanding::Refused(_)
    ));
    fake.lock().control_error = Some(Errno::NODEV);
    let mut controls = CameraControls::new(&fake, &settings(&[("gain", 7)], OnChange::Report));
    assert_eq!(controls.apply(&mut fake.clone()), Err(Errno::NODEV));
}
