use super::*;

fn record(station: u8, command: u8, values: &[f32]) -> Vec<u8> {
    let mut bytes = vec![b'L', b'Y', station, command, b' ', 0];
    bytes.extend((4 * values.len() as u16).to_le_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

const AHEAD: [f32; 7] = [10.0, -20.0, 5.0, 1.0, 0.0, 0.0, 0.0];

fn classify(bytes: &[u8]) -> Verdict {
    Format::default().classify(None, bytes)
}

#[test]
fn a_record_is_read_by_its_declared_size() {
    let bytes = record(3, b'C', &AHEAD);
    let Verdict::Reading { len: 36, reading } = classify(&bytes) else {
        panic!("{:?}", classify(&bytes))
    };
    assert_eq!((reading.station, reading.error), (3, None));
    let metres = reading.transmitter_from_sensor.translation;
    assert!((metres - DVec3::new(0.254, -0.508, 0.127)).length() < 1e-9);
    // A clock and a switch after the pose change nothing but the length.
    let longer = record(3, b'P', &[&AHEAD[..], &[0.0, 0.0]].concat());
    assert!(matches!(
        classify(&longer),
        Verdict::Reading { len: 44, .. }
    ));
}

#[test]
fn distinguishes_models_answers_and_error_letters() {
    for (model, good) in [(b"LY", true), (b"LU", true), (b"PA", true), (b"PY", false)] {
        let mut bytes = record(1, b'C', &AHEAD);
        bytes[..2].copy_from_slice(model);
        assert_eq!(matches!(classify(&bytes), Verdict::Reading { .. }), good);
    }
    assert_eq!(
        classify(&record(1, 0x76, &[0.0])),
        Verdict::NoPose { len: 12 }
    );
    let mut bytes = record(1, b'C', &AHEAD);
    bytes[4] = b'I';
    let Verdict::Reading { reading, .. } = classify(&bytes) else {
        panic!()
    };
    assert_eq!(reading.error, Some(b'I'));
}

#[test]
fn a_partial_record_is_incomplete_and_a_wrong_one_is_noise() {
    let good = record(1, b'C', &AHEAD);
    for len in 1..good.len() {
        assert_eq!(classify(&good[..len]), Verdict::Incomplete, "{len}");
    }
    let layout = Verdict::noise(Fault::Layout);
    let implausible = Verdict::noise(Fault::Implausible);
    for (place, byte, verdict) in [
        (0, b'X', layout),
        (1, b'X', layout),
        (2, 0, layout),
        (2, 17, layout),
        (3, 0, layout),
        (7, 1, layout),
        (6, 24, layout),
        (11, 0xff, implausible),
    ] {
        let mut bytes = good.clone();
        bytes[place] = byte;
        assert_eq!(classify(&bytes), verdict, "{place} {byte}");
    }
    let nan = record(1, b'C', &[f32::NAN, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    assert_eq!(classify(&nan), implausible);
}

#[test]
fn angles_instead_of_a_quaternion() {
    let format = Format {
        euler: true,
        metres_per_unit: 0.01,
        ..Format::default()
    };
    let bytes = record(1, b'C', &[100.0, 0.0, 0.0, 90.0, 0.0, 0.0]);
    let Verdict::Reading { reading, .. } = format.classify(None, &bytes) else {
        panic!()
    };
    let pose = reading.transmitter_from_sensor;
    assert!((pose.translation.x - 1.0).abs() < 1e-9);
    assert!((pose.rotation * DVec3::X - DVec3::Y).length() < 1e-9);
}
