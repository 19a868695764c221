//! The driver of every serial protocol with its simulated device, through a pseudo-terminal,
//! which behaves like a serial port in most respects.
#![cfg(unix)]
#![expect(clippy::unwrap_used, clippy::panic)]
#![allow(clippy::disallowed_methods, reason = "tests start their own threads")]

mod common;

use common::{Device, poses, settings};
use penumbra_interface::{Clock, DeviceError, Recovery, SystemClock};
use penumbra_synthetic::{Faults, Trajectory};
use penumbra_tracker_serial::{
    AnyDecoder, Hemisphere, PortName, TrackerSettings, Units, open, probe,
};
use std::time::{Duration, Instant};

/// Largest distance of a decoded pose from the path, metres (with 0.1 m for a radian). It is
/// not zero, because text in inches and 14-bit words have a limited resolution.
fn furthest_from_path(found: &[penumbra_interface::PoseSample]) -> f64 {
    let path = Trajectory::default();
    let times = || (0..12_000).map(|i| f64::from(i) * 1e-3);
    let nearest = |sample: &penumbra_interface::PoseSample| {
        let pose = sample.transmitter_from_sensor;
        times()
            .map(|t| path.pose_at(t))
            .map(|p| {
                let angle = p.rotation.angle_between(pose.rotation);
                (p.translation - pose.translation).length() + 0.1 * angle
            })
            .fold(f64::INFINITY, f64::min)
    };
    found.iter().map(nearest).fold(0.0, f64::max)
}

#[test]
fn every_protocol_streams() {
    for protocol in [
        "fastrak",
        "fastrak-ascii-quaternion",
        "fastrak-ascii-extended-euler",
        "fastrak-ascii-extended-quaternion",
        "fastrak-binary-euler",
        "fastrak-binary-quaternion",
        "liberty",
        "liberty-euler",
        "patriot",
        "flock",
        "flock-angles",
        "flock-group",
        "freed",
        "csv",
    ] {
        let device = Device::start(protocol, Faults::default());
        let mut tracker =
            open(&settings(protocol, &device)).unwrap_or_else(|e| panic!("{protocol}: {e}"));
        let (found, counters) = poses(&mut *tracker, protocol, 20);
        let furthest = furthest_from_path(&found);
        assert!(furthest < 1e-3, "{protocol}: {furthest} m from the path");
        assert!(found.windows(2).all(|w| w[0].arrived_at <= w[1].arrived_at));
        assert_eq!(
            (counters.resyncs, counters.implausible),
            (0, 0),
            "{protocol}"
        );
        let report = tracker.report();
        // The baud rate goes into the recording, for its decoder.
        assert!(report.protocol.starts_with(&format!("{protocol}@")));
        assert_eq!(report.warning, None);
    }
}

#[test]
fn inches_and_centimetres_give_the_same_metres() {
    for units in [Units::Inches, Units::Centimetres] {
        let device = Device::start("fastrak", Faults::default());
        let settings = TrackerSettings {
            units,
            ..settings("fastrak-binary-quaternion", &device)
        };
        let mut tracker = open(&settings).unwrap();
        let mut decoder = AnyDecoder::for_protocol(&settings.protocol)
            .unwrap()
            .with_metres_per_unit(units.metres());
        let found = common::decode(&mut *tracker, &mut decoder, 10);
        assert!(furthest_from_path(&found) < 1e-3, "{units:?}");
        assert!(
            tracker
                .report()
                .description
                .unwrap()
                .contains("software 3.18")
        );
    }
}

#[test]
fn the_hemisphere_is_set() {
    let device = Device::start("fastrak", Faults::default());
    let back = TrackerSettings {
        hemisphere: Hemisphere::Back,
        ..settings("fastrak", &device)
    };
    let mut tracker = open(&back).unwrap();
    let (found, _) = poses(&mut *tracker, "fastrak", 5);
    // The path is in front: with the wrong hemisphere, the device reports its mirror image.
    assert!(
        found
            .iter()
            .all(|s| s.transmitter_from_sensor.translation.x < 0.0)
    );
}

#[test]
fn the_configured_stations_are_switched_on_and_the_others_off() {
    let device = Device::start("fastrak", Faults::default());
    let two = TrackerSettings {
        stations: vec![2, 4],
        ..settings("fastrak-binary-quaternion", &device)
    };
    let mut tracker = open(&two).unwrap();
    let (found, _) = poses(&mut *tracker, "fastrak-binary-quaternion", 8);
    let stations: Vec<_> = found.iter().map(|sample| sample.station).collect();
    assert_eq!(stations[..4], [2, 4, 2, 4]);
}

/// The stations of the first records, whose poses are checked: the receivers are mounted 10 cm
/// apart on one body, so a record with the wrong station or the wrong length is noticed.
fn stations_received(protocol: &str, stations: Vec<u8>) -> Vec<u8> {
    let device = Device::start(protocol, Faults::default());
    let settings = TrackerSettings {
        stations,
        ..settings(protocol, &device)
    };
    let mut tracker = open(&settings).unwrap_or_else(|e| panic!("{protocol}: {e}"));
    let (found, counters) = poses(&mut *tracker, protocol, 24);
    assert_eq!((counters.resyncs, counters.implausible), (0, 0));
    for sample in &found {
        let body = penumbra_interface::RigidTransform::new(
            glam::DQuat::IDENTITY,
            glam::DVec3::Y * -0.1 * f64::from(sample.station - 1),
        );
        let mut body_sample = *sample;
        body_sample.transmitter_from_sensor = sample.transmitter_from_sensor * body;
        let furthest = furthest_from_path(&[body_sample]);
        assert!(furthest < 1e-3, "{protocol}: {furthest} m, {sample:?}");
    }
    let mut stations: Vec<u8> = found.iter().map(|sample| sample.station).collect();
    stations.truncate(6);
    stations
}

#[test]
fn a_flock_in_group_mode_sends_all_birds_up_to_the_highest_station() {
    for protocol in ["flock-group", "flock-angles-group"] {
        assert_eq!(stations_received(protocol, vec![2]), [1, 2, 1, 2, 1, 2]);
        assert_eq!(stations_received(protocol, vec![1, 3]), [1, 2, 3, 1, 2, 3]);
    }
}

#[test]
fn a_libertys_receivers_are_switched_on_and_off() {
    for protocol in ["liberty", "patriot", "liberty-euler"] {
        assert_eq!(stations_received(protocol, vec![2]), [2; 6]);
        assert_eq!(stations_received(protocol, vec![1]), [1; 6]);
        assert_eq!(stations_received(protocol, vec![2, 1]), [1, 2, 1, 2, 1, 2]);
    }
}

#[test]
fn a_libertys_missing_receiver_is_named_with_those_that_are_there() {
    for protocol in ["liberty", "patriot"] {
        let device = Device::start(protocol, Faults::default());
        let mut settings = settings(protocol, &device);
        settings.stations = vec![3];
        let error = open(&settings).map(|_| ()).unwrap_err().to_string();
        let expected = "no receiver is plugged in at station 3; stations with one: 1, 2; set";
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn a_hang_up_is_noticed_at_once() {
    let mut device = Device::start("fastrak", Faults::default());
    let mut tracker = open(&settings("fastrak", &device)).unwrap();
    poses(&mut *tracker, "fastrak", 3);
    device.hang_up();
    let began = Instant::now();
    let error = loop {
        if let Err(error) = tracker.next_bytes(Duration::from_secs(5)) {
            break error;
        }
    };
    assert!(
        // At once would be less, but a busy machine may delay the thread.
        began.elapsed() < Duration::from_millis(2500),
        "{:?}",
        began.elapsed()
    );
    assert!(matches!(error, DeviceError::Unplugged { .. }), "{error}");
    // Every further call fails, too, without waiting.
    assert!(tracker.next_bytes(Duration::from_secs(5)).is_err());
}

#[test]
fn silence_is_reported_after_its_limit_without_spinning() {
    let faults = Faults::parse("silent-after=1.5").unwrap();
    let device = Device::start("fastrak", faults);
    let mut tracker = open(&settings("fastrak", &device)).unwrap();
    let mut calls = 0;
    let error = loop {
        calls += 1;
        match tracker.next_bytes(Duration::from_millis(100)) {
            Err(error) => break error,
            Ok(_) => assert!(calls < 2000, "next_bytes returns without waiting"),
        }
    };
    assert!(
        matches!(
            error,
            DeviceError::Silent {
                millis: 1000..1500,
                ..
            }
        ),
        "{error}"
    );
    assert_eq!(error.recovery(), Recovery::Reopen);
}

#[test]
fn a_device_that_never_answers_is_silent() {
    let device = Device::start("fastrak", Faults::parse("silent-after=0").unwrap());
    let error = open(&settings("fastrak", &device)).err().unwrap();
    assert!(matches!(error, DeviceError::Silent { .. }), "{error}");
}

#[test]
fn another_protocol_is_recognised() {
    for (sent, expected) in [("csv", "fastrak"), ("csv", "liberty"), ("csv", "freed")] {
        let device = Device::start(sent, Faults::default());
        let error = open(&settings(expected, &device))
            .err()
            .unwrap()
            .to_string();
        assert!(
            error.contains(&format!("sends records of protocol {sent:?}")),
            "{sent} for {expected}: {error}"
        );
    }
}

#[test]
fn a_line_with_faults_recovers() {
    for protocol in [
        "fastrak-binary-quaternion",
        "liberty",
        "flock",
        "freed",
        "csv",
    ] {
        let device = Device::start(protocol, Faults::parse("split").unwrap());
        let mut tracker = open(&settings(protocol, &device)).unwrap();
        let (found, counters) = poses(&mut *tracker, protocol, 20);
        assert!(furthest_from_path(&found) < 1e-3, "{protocol}");
        assert_eq!(counters.resyncs, 0, "{protocol}");
        drop((tracker, device));

        let device = Device::start(
            protocol,
            Faults::parse("split,drop=0.002,insert=0.002").unwrap(),
        );
        let tracker = (0..5).find_map(|_| open(&settings(protocol, &device)).ok());
        let (found, _) = poses(&mut *tracker.expect(protocol), protocol, 60);
        let far = found.iter().filter(|s| furthest_from_path(&[**s]) > 1e-3);
        assert!(far.count() <= 6, "{protocol}");
    }
}

#[test]
fn closing_stops_the_stream_and_frees_the_port() {
    let device = Device::start("fastrak", Faults::default());
    for _ in 0..3 {
        let mut tracker = open(&settings("fastrak", &device)).unwrap();
        let busy = open(&settings("fastrak", &device)).err().unwrap();
        assert!(busy.to_string().contains("busy"), "{busy}");
        poses(&mut *tracker, "fastrak", 3);
        drop(tracker);
        std::thread::sleep(Duration::from_millis(120));
        assert!(!device.is_streaming());
    }
}

#[test]
fn arrival_is_on_the_monotonic_clock() {
    let device = Device::start("fastrak", Faults::default());
    let before = SystemClock.now();
    let mut tracker = open(&settings("fastrak", &device)).unwrap();
    let (found, _) = poses(&mut *tracker, "fastrak", 10);
    let after = SystemClock.now();
    assert!(
        found
            .iter()
            .all(|s| before < s.arrived_at && s.arrived_at < after)
    );
    // 120 records a second: 9 gaps of 8.3 ms, and a tolerance for a busy machine.
    let spread = found[9].arrived_at.seconds_since(found[0].arrived_at);
    assert!((0.03..0.5).contains(&spread), "{spread}");
}

#[test]
fn errors_name_ports_that_cannot_be_opened() {
    let open_at = |path: &str| {
        let settings = TrackerSettings::new("fastrak", PortName::Serial(path.to_owned()));
        open(&settings).err().unwrap()
    };
    assert!(matches!(
        open_at("/dev/no-such-port"),
        DeviceError::NotFound { .. }
    ));
    assert!(matches!(
        open_at("usb-no_such_name"),
        DeviceError::NotFound { .. }
    ));
    let error = open_at("/dev/null");
    assert!(error.to_string().contains("is no serial port"), "{error}");
    let settings = TrackerSettings::new("polaris", PortName::Serial("/dev/null".to_owned()));
    let error = open(&settings).err().unwrap().to_string();
    assert!(error.contains("the protocols are fastrak"), "{error}");
}

#[test]
fn probing_finds_the_protocol() {
    for (sent, found, said) in [
        ("fastrak", "fastrak", "FASTRAK"),
        ("liberty", "liberty", "Liberty"),
        ("flock", "flock", "3.60"),
        ("csv", "csv", ""),
    ] {
        let device = Device::start(sent, Faults::default());
        let port = PortName::Serial(device.path());
        let answer = probe(&port).unwrap().unwrap_or_else(|| panic!("{sent}"));
        assert_eq!(answer.protocol, found);
        assert!(
            answer.description.unwrap_or_default().contains(said),
            "{sent}"
        );
    }
}
