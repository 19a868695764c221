use super::*;
use crate::units::METRES_PER_CENTIMETRE;
use glam::DQuat;
use std::f64::consts::FRAC_1_SQRT_2;

fn format(encoding: Encoding, orientation: Orientation, ending: Ending) -> Format {
    Format {
        encoding,
        orientation,
        ending,
        ..Format::default()
    }
}

fn binary(station: u8, error: u8, values: &[f32], ending: &[u8]) -> Vec<u8> {
    let mut bytes = vec![b'0', station, error];
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend_from_slice(ending);
    bytes
}

#[test]
fn record_lengths_are_as_in_the_manual() {
    use {Encoding::*, Ending::*, Orientation::*};
    assert_eq!(format(Ascii, Euler, CrLf).record_len(), 47);
    assert_eq!(format(Ascii, Quaternion, CrLf).record_len(), 54);
    assert_eq!(format(Binary, Quaternion, Space).record_len(), 32);
    assert_eq!(format(Binary, Euler, CrLf).record_len(), 29);
}

#[test]
fn protocols_have_names() {
    assert_eq!(Format::for_protocol("fastrak"), Some(Format::default()));
    let binary = Format::for_protocol("fastrak-binary-quaternion").unwrap();
    assert_eq!(binary.record_len(), 32);
    assert_eq!(Format::for_protocol("liberty"), None);
}

#[test]
fn adjacent_numbers_are_split_by_columns() {
    let record = Format::default()
        .parse(b"01 -100.00-200.00  -0.50 -90.00   0.00   0.00\r\n")
        .unwrap();
    let pose = record.transmitter_from_sensor;
    let expected = DVec3::new(-100.0, -200.0, -0.5) * METRES_PER_INCH;
    assert!((pose.translation - expected).length() < 1e-12);
    // An azimuth of -90 degrees about Z (down) turns the sensor's X axis to -Y.
    assert!((pose.rotation * DVec3::X + DVec3::Y).length() < 1e-12);
    assert_eq!((record.station, record.error), (1, None));
}

#[test]
fn columns_may_be_padded_with_zeros_or_blanks() {
    for column in ["+012.50", " 012.50", "  12.50", " +12.50"] {
        assert_eq!(fixed_point(column.as_bytes(), 2), Some(12.5), "{column}");
    }
    for column in [
        "  12.5 ", "  1 .50", " --1.50", "   .50", "12-1.50", "       ",
    ] {
        assert_eq!(fixed_point(column.as_bytes(), 2), None, "{column}");
    }
}

#[test]
fn elevation_and_roll_turn_about_y_and_x() {
    let parse = |text: &[u8]| {
        Format::default()
            .parse(text)
            .unwrap()
            .transmitter_from_sensor
    };
    let raised = parse(b"02    1.00   2.00   3.00   0.00  90.00   0.00\r\n");
    assert!((raised.rotation * DVec3::X - DVec3::NEG_Z).length() < 1e-12);
    let rolled = parse(b"02    1.00   2.00   3.00   0.00   0.00  90.00\r\n");
    assert!((rolled.rotation * DVec3::Y - DVec3::Z).length() < 1e-12);
}

#[test]
fn quaternion_text_is_w_first() {
    let format = format(Encoding::Ascii, Orientation::Quaternion, Ending::CrLf);
    let record = format
        .parse(b"03A   1.00   2.00   3.00 0.7071 0.0000 0.0000 0.7071\r\n")
        .unwrap();
    let expected = DQuat::from_xyzw(0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2);
    assert!(
        record
            .transmitter_from_sensor
            .rotation
            .angle_between(expected)
            < 1e-6
    );
    assert_eq!((record.station, record.error), (3, Some(b'A')));
}

#[test]
fn binary_centimetres() {
    let mut format = format(Encoding::Binary, Orientation::Quaternion, Ending::Space);
    format.metres_per_unit = METRES_PER_CENTIMETRE;
    let bytes = binary(b'4', b' ', &[10.0, -20.0, 30.0, 1.0, 0.0, 0.0, 0.0], b" ");
    let pose = format.parse(&bytes).unwrap().transmitter_from_sensor;
    assert!((pose.translation - DVec3::new(0.1, -0.2, 0.3)).length() < 1e-9);
    assert_eq!(pose.rotation, DQuat::IDENTITY);
}

#[test]
fn impossible_numbers_are_refused() {
    let format = format(Encoding::Binary, Orientation::Quaternion, Ending::Space);
    let quaternion = [1.0, 0.0, 0.0, 0.0];
    let refused = |position: [f32; 3], quaternion: [f32; 4]| {
        let values: Vec<f32> = position.into_iter().chain(quaternion).collect();
        format.parse(&binary(b'1', b' ', &values, b" ")) == Err(Fault::Implausible)
    };
    assert!(refused([f32::NAN, 0.0, 0.0], quaternion));
    assert!(refused([f32::INFINITY, 0.0, 0.0], quaternion));
    assert!(refused([1e6, 0.0, 0.0], quaternion));
    assert!(refused([1.0, 0.0, 0.0], [0.9, 0.0, 0.0, 0.0]));
    assert!(!refused([1.0, 0.0, 0.0], quaternion));
    let angles = b"01    1.00   2.00   3.00 181.00   0.00   0.00\r\n";
    assert_eq!(Format::default().parse(angles), Err(Fault::Implausible));
}

#[test]
fn impossible_headers_are_refused() {
    for header in ["05 ", "00 ", "11 ", "01*", "01 "] {
        let text = format!("{header}   1.00   2.00   3.00   0.00   0.00   0.00\r\n");
        let parsed = Format::default().parse(text.as_bytes());
        assert_eq!(parsed.is_ok(), header == "01 ", "{header}");
    }
    assert_eq!(Format::default().parse(b""), Err(Fault::Layout));
}
