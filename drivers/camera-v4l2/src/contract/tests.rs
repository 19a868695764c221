#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use super::*;
use crate::testing::FakeVideo;
use crate::video::ControlKind;
use penumbra_interface::ControlStanding;
use rustix::io::Errno;
use v4l::control::Flags;

const AUTO: u32 = 1;
const TIME: u32 = 2;
const WB_AUTO: u32 = 3;
const WB: u32 = 4;
const GAIN: u32 = 5;
const FOCUS: u32 = 6;

/// A webcam as uvcvideo shows it, everything automatic.
fn webcam() -> FakeVideo {
    let fake = FakeVideo::streaming(b"YUYV", 4, 2);
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
    fake.edit(TIME, |c| c.owner = Some((AUTO, 1)));
    fake.edit(WB, |c| c.owner = Some((WB_AUTO, 0)));
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

fn applied(fake: &FakeVideo, settings: &CameraSettings) -> Contract {
    let mut contract = Contract::new(fake, settings);
    contract.apply(&mut fake.clone()).unwrap();
    contract.watch(&mut fake.clone());
    contract
}

fn standing(contract: &Contract, name: &str) -> (Option<i64>, ControlStanding) {
    let report = contract.report();
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
    let contract = applied(&fake, &settings(&wanted, OnChange::Report));
    for (name, value) in wanted {
        assert_eq!(
            standing(&contract, name),
            (Some(value), ControlStanding::Held),
            "{name}"
        );
    }
    let exposure = contract.exposure().unwrap();
    assert_eq!((exposure.exposure_micros, exposure.gain), (10_000.0, 1.0));
    assert_eq!(contract.value("white_balance_temperature"), Some(4600));
}

#[test]
fn a_value_that_an_automatic_mode_owns_names_it() {
    let fake = webcam();
    let contract = applied(
        &fake,
        &settings(&[("exposure_time_absolute", 100)], OnChange::Report),
    );
    let (in_force, standing) = standing(&contract, "exposure_time_absolute");
    assert_eq!(in_force, Some(3));
    let ControlStanding::Refused(reason) = standing else {
        panic!("{standing:?}");
    };
    assert_eq!(
        reason,
        "auto_exposure = 3 owns it; lock auto_exposure = 1, too"
    );
    assert_eq!(
        contract.exposure(),
        None,
        "nobody knows what automatic exposure does"
    );
}

#[test]
fn a_driver_that_takes_and_ignores_is_found_out() {
    let fake = webcam();
    fake.edit(TIME, |c| {
        c.owner = None;
        c.deaf = true;
        c.description.flags = Flags::INACTIVE;
    });
    let contract = applied(
        &fake,
        &settings(&[("exposure_time_absolute", 3)], OnChange::Report),
    );
    let (_, standing) = standing(&contract, "exposure_time_absolute");
    assert!(
        matches!(standing, ControlStanding::Refused(_)),
        "{standing:?}"
    );
}

#[test]
fn out_of_range_and_missing_controls_are_reported() {
    let fake = webcam();
    fake.edit(FOCUS, |c| c.strict = true);
    let wanted = [("gain", 999), ("focus_absolute", -5), ("pan_absolute", 0)];
    let contract = applied(&fake, &settings(&wanted, OnChange::Report));
    assert_eq!(
        standing(&contract, "gain"),
        (Some(255), ControlStanding::Adjusted)
    );
    assert_eq!(
        standing(&contract, "focus_absolute"),
        (Some(0), ControlStanding::Adjusted)
    );
    assert_eq!(
        standing(&contract, "pan_absolute"),
        (None, ControlStanding::Missing)
    );
}

#[test]
fn another_programs_change_is_reported_or_restored() {
    let wanted = [("gain", 7)];
    let fake = webcam();
    let mut contract = applied(&fake, &settings(&wanted, OnChange::Report));
    fake.meddle(GAIN, 90);
    contract.on_events(&mut fake.clone(), at(0)).unwrap();
    assert_eq!(
        standing(&contract, "gain"),
        (Some(90), ControlStanding::Changed)
    );
    assert_eq!((contract.changed, fake.value(GAIN)), (1, 90));
    let said = contract.tampering().unwrap();
    assert!(said.contains("gain") && said.contains("left so"), "{said}");
    fake.meddle(GAIN, 7);
    contract.on_events(&mut fake.clone(), at(1)).unwrap();
    assert_eq!(
        standing(&contract, "gain"),
        (Some(7), ControlStanding::Held)
    );
    assert_eq!(contract.changed, 1);

    let fake = webcam();
    let mut contract = applied(&fake, &settings(&wanted, OnChange::Restore));
    fake.meddle(GAIN, 90);
    contract.on_events(&mut fake.clone(), at(0)).unwrap();
    assert_eq!(
        standing(&contract, "gain"),
        (Some(7), ControlStanding::Held)
    );
    assert_eq!((contract.changed, fake.value(GAIN)), (1, 7));
}

#[test]
fn two_programs_that_restore_do_not_chase_each_other() {
    let fake = webcam();
    let mut contract = applied(&fake, &settings(&[("gain", 7)], OnChange::Restore));
    let before = fake.lock().sets.len();
    for millis in 0..500 {
        fake.meddle(GAIN, 90);
        contract.on_events(&mut fake.clone(), at(millis)).unwrap();
    }
    assert_eq!(fake.lock().sets.len() - before, 1);
    assert_eq!(standing(&contract, "gain").1, ControlStanding::Changed);
    contract.tick(&mut fake.clone(), at(1001)).unwrap();
    assert_eq!(fake.value(GAIN), 7, "the last word is ours");
}

#[test]
fn switching_an_automatic_mode_on_is_undone_with_what_it_owns() {
    let fake = webcam();
    let wanted = [("auto_exposure", 1), ("exposure_time_absolute", 100)];
    let mut contract = applied(&fake, &settings(&wanted, OnChange::Restore));
    fake.edit(TIME, |c| c.value = 333);
    fake.meddle(AUTO, 3);
    contract.on_events(&mut fake.clone(), at(0)).unwrap();
    assert_eq!((fake.value(AUTO), fake.value(TIME)), (1, 100));
}

#[test]
fn what_is_in_force_is_shared_until_it_changes() {
    let fake = webcam();
    let mut contract = applied(&fake, &settings(&[("gain", 7)], OnChange::Report));
    let (before, report) = (contract.in_force(), contract.report());
    contract.on_events(&mut fake.clone(), at(0)).unwrap();
    contract.tick(&mut fake.clone(), at(5000)).unwrap();
    assert!(Arc::ptr_eq(&before, &contract.in_force()));
    assert!(Arc::ptr_eq(&report, &contract.report()));
    fake.meddle(GAIN, 8);
    contract.on_events(&mut fake.clone(), at(0)).unwrap();
    assert!(!Arc::ptr_eq(&before, &contract.in_force()));
    assert!(
        contract
            .in_force()
            .iter()
            .any(|(name, value)| &**name == "gain" && *value == 8)
    );
}

#[test]
fn controls_without_events_are_read_back_now_and_then() {
    let fake = webcam();
    let mut contract = Contract::new(&fake, &settings(&[("gain", 7)], OnChange::Report));
    contract.apply(&mut fake.clone()).unwrap();
    fake.edit(GAIN, |c| c.value = 8);
    contract.tick(&mut fake.clone(), at(3000)).unwrap();
    assert_eq!(
        standing(&contract, "gain"),
        (Some(8), ControlStanding::Changed)
    );
}

#[test]
fn only_a_device_that_is_gone_is_an_error() {
    let fake = webcam();
    fake.lock().control_fault = Some(Errno::IO);
    let contract = applied(&fake, &settings(&[("gain", 7)], OnChange::Report));
    assert!(matches!(
        standing(&contract, "gain").1,
        ControlStanding::Refused(_)
    ));
    fake.lock().control_fault = Some(Errno::NODEV);
    let mut contract = Contract::new(&fake, &settings(&[("gain", 7)], OnChange::Report));
    assert_eq!(contract.apply(&mut fake.clone()), Err(Errno::NODEV));
}
