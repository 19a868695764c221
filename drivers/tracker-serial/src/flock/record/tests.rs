use super::*;

/// A record of a real device (IGSTK, see tests/fixtures/tracker/ORIGIN.md).
const REAL: [u8; 14] = *b"\x96\x13=\x05^\x02S\x06,9H\x1BG\x01";

fn reading(format: Format, bytes: &[u8]) -> Reading {
    match format.classify(None, bytes) {
        Verdict::Reading { len, reading } if len == bytes.len() => reading,
        verdict => panic!("{verdict:?}"),
    }
}

#[test]
fn words_are_fractions_of_full_scale() {
    assert!((fraction([0x80, 0x40]) + 1.0).abs() < 1e-12);
    assert!((fraction([0x7f, 0x3f]) - (1.0 - 4.0 / 32768.0)).abs() < 1e-12);
    assert!(fraction([0x80, 0]).abs() < 1e-12);
    assert!((fraction([0x81, 0]) - 4.0 / 32768.0).abs() < 1e-12);
}

#[test]
fn a_real_record_is_a_pose_with_a_unit_quaternion() {
    let read = reading(Format::default(), &REAL);
    let pose = read.transmitter_from_sensor;
    let expected = DVec3::new(0.273_918, 0.078_246, 0.039_067);
    assert!((pose.translation - expected).length() < 1e-6);
    assert!(
        (pose.rotation.w - 0.103_899).abs() < 1e-6 && (pose.rotation.x - 0.896_148).abs() < 1e-6
    );
    assert_eq!((read.station, read.error), (1, None));
    let inverted = Format {
        inverted: true,
        ..Format::default()
    };
    let turned = reading(inverted, &REAL).transmitter_from_sensor.rotation;
    assert!((turned * pose.rotation).angle_between(glam::DQuat::IDENTITY) < 1e-9);
}

#[test]
fn the_phasing_bit_finds_the_next_record() {
    let format = Format::default();
    let stream = [&REAL[5..], &REAL[..]].concat();
    assert_eq!(
        format.classify(None, &stream),
        Verdict::noise(Fault::Layout)
    );
    let mut cut = [&REAL[..9], &REAL[..]].concat();
    let skip = |skip| Verdict::Noise {
        skip,
        fault: Fault::Layout,
    };
    assert_eq!(format.classify(None, &cut), skip(9));
    cut.truncate(9);
    assert_eq!(format.classify(None, &cut), Verdict::Incomplete);
    assert_eq!(format.classify(None, &REAL[..1]), Verdict::Incomplete);
}

#[test]
fn group_mode_adds_an_address_and_angles_are_half_turns() {
    let group = Format {
        group: true,
        angles: true,
        ..Format::default()
    };
    // An azimuth of 90°: half of full scale.
    let mut bytes = vec![0x80, 0, 0, 0, 0, 0, 0, 0x20, 0, 0, 0, 0, 3];
    let read = reading(group, &bytes);
    assert_eq!(read.station, 3);
    let ahead = read.transmitter_from_sensor.rotation * DVec3::X;
    assert!((ahead - DVec3::Y).length() < 1e-9);
    bytes[12] = 0;
    assert_eq!(group.classify(None, &bytes), Verdict::noise(Fault::Layout));
}

#[test]
fn a_quaternion_that_is_not_a_unit_is_refused() {
    let mut bytes = REAL;
    bytes[9] = 0x10;
    let verdict = Format::default().classify(None, &bytes);
    assert_eq!(verdict, Verdict::noise(Fault::Implausible));
}
