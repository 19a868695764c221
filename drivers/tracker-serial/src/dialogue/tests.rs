use super::*;
use crate::fastrak;
use crate::format::PROTOCOLS;
use crate::settings::{PortName, Units};
use penumbra_synthetic::{SimulatedTracker, Source, Trajectory};

fn settings(protocol: &str) -> TrackerSettings {
    TrackerSettings::new(protocol, PortName::Serial("/dev/none".to_owned()))
}

/// Runs the dialogue with a device in simulated time; returns written bytes and last action.
fn converse(settings: &TrackerSettings, mut device: Option<SimulatedTracker>) -> (Vec<u8>, Action) {
    let mut dialogue = Dialogue::new(settings).unwrap();
    let (mut written, mut now) = (Vec::new(), MonotonicTime::from_nanos(0));
    for _ in 0..10_000 {
        let mut received = Vec::new();
        match dialogue.next(now) {
            Action::Write(bytes) => {
                written.extend_from_slice(&bytes);
                if let Some(device) = &mut device {
                    device.receive(&bytes, now, &mut received);
                }
            }
            Action::Read { until, .. } => {
                now = until.min(now.offset_nanos(2_000_000));
                if let Some(device) = &mut device {
                    device.advance(now, &mut received);
                }
            }
            end => return (written, end),
        }
        if !received.is_empty() {
            dialogue.receive(&received, now);
        }
    }
    panic!("the dialogue does not end")
}

fn simulated(protocol: &str) -> Option<SimulatedTracker> {
    let path = Source::Trajectory(Trajectory::default());
    SimulatedTracker::new(protocol, path, None, false).ok()
}

#[test]
fn a_fastrak_is_stopped_identified_configured_checked_and_started() {
    let (written, end) = converse(&settings("fastrak-binary-quaternion"), simulated("fastrak"));
    let expected = "cSufl1,1\rO1,2,11,0\rH1,1,0,0\rl2,0\rl3,0\rl4,0\rSC";
    assert_eq!(String::from_utf8_lossy(&written), expected);
    let Action::Done(answer) = end else {
        panic!("{end:?}")
    };
    assert_eq!(
        answer.description.unwrap(),
        "FASTRAK, software 3.18, simulated FASTRAK"
    );
    assert_eq!(answer.warning, None);
}

#[test]
fn mode_that_the_device_ignores_is_a_warning() {
    let status = b"21S3F0103  01  3.18  Rig                             \r\n";
    let binary = settings("fastrak-binary-quaternion");
    let Format::Fastrak(format) = Format::for_protocol(&binary.protocol).unwrap() else {
        panic!()
    };
    let steps = fastrak::commands::start_sequence(&binary, &format);
    let confirm = steps.iter().rev().find_map(|step| match step {
        Step::Ask { parse, .. } => Some(parse),
        _ => None,
    });
    let warning = confirm.unwrap()(status).unwrap().warning.unwrap();
    assert!(
        warning.contains("set to send binary in centimetres"),
        "{warning}"
    );
    assert!(warning.contains("sends text in inches"), "{warning}");
    let inches = TrackerSettings {
        units: Units::Inches,
        ..settings("fastrak")
    };
    let Format::Fastrak(format) = Format::for_protocol("fastrak").unwrap() else {
        panic!()
    };
    let first = fastrak::commands::start_sequence(&inches, &format);
    let Some(Step::Ask { parse, .. }) = first.get(2) else {
        panic!()
    };
    let warning = parse(status).unwrap().warning.unwrap();
    assert!(warning.contains("built-in test found 103"), "{warning}");
}

#[test]
fn the_other_devices_are_configured() {
    let receivers: String = (2..=16).map(|n| format!("\x15{n},0\r")).collect();
    let polhemus = format!("P\rF0\r\x16\r\x150\r\x151,1\r{receivers}O*,2,7\rU1\rH*,1,0,0\rF1\rC\r");
    for (protocol, expected) in [
        ("liberty", polhemus.as_str()),
        ("patriot", &polhemus),
        ("flock", "BO\x01L\0\0]@"),
        ("csv", ""),
    ] {
        let (written, end) = converse(&settings(protocol), simulated(protocol));
        assert_eq!(written, expected.as_bytes(), "{protocol}");
        assert!(matches!(end, Action::Done(_)), "{protocol}: {end:?}");
    }
    let (written, end) = converse(&settings("freed"), simulated("freed"));
    assert_eq!(written, [0xd0, 0xff, 0x01, 0x70]);
    assert!(matches!(end, Action::Done(_)), "{end:?}");
}

#[test]
fn every_bird_up_to_the_highest_station_is_configured() {
    let third = TrackerSettings {
        stations: vec![3],
        ..settings("flock-group")
    };
    let (written, end) = converse(&third, simulated("flock-group"));
    let mode = |bird: u8| [&[0xf0 | bird, b'L', 0, 0, 0xf0 | bird, b']'][..]].concat();
    let expected = [
        b"BO\x01P\x32\x03P\x23\x01".to_vec(),
        mode(1),
        mode(2),
        mode(3),
        b"@".to_vec(),
    ];
    assert_eq!(written, expected.concat());
    assert!(matches!(end, Action::Done(_)), "{end:?}");
}

#[test]
fn an_absent_device_is_reported_as_silent_within_seconds() {
    for protocol in PROTOCOLS.iter().filter(|name| **name != "vrpn") {
        let (_, end) = converse(&settings(protocol), None);
        let Action::Failed(Trouble::Silent { millis }) = end else {
            panic!("{protocol}: {end:?}")
        };
        assert!((500..6000).contains(&millis), "{protocol}: {millis} ms");
    }
}

#[test]
fn every_device_executes_its_stop_command() {
    for protocol in ["fastrak", "liberty", "flock", "freed"] {
        let mut device = simulated(protocol).unwrap();
        let settings = settings(protocol);
        let (_, end) = converse(&settings, Some(device.clone()));
        assert!(matches!(end, Action::Done(_)));
        let now = MonotonicTime::default();
        let start: &[u8] = match protocol {
            "fastrak" => b"C",
            "liberty" => b"C\r",
            "flock" => b"@",
            _ => &[0xd0, 0xff, 0x01, 0x70],
        };
        device.receive(start, now, &mut Vec::new());
        assert!(device.is_streaming(), "{protocol}");
        device.receive(&stop_command(&settings), now, &mut Vec::new());
        assert!(!device.is_streaming(), "{protocol}");
    }
}
