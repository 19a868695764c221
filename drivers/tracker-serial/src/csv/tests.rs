use super::*;

fn parse(line: &str) -> Result<Reading, Fault> {
    Format::default().parse(line.as_bytes())
}

#[test]
fn seconds_and_checksum_are_optional() {
    for line in [
        "7,0.5,-1,2e-1,1,0,0,0",
        "7, 0.5, -1 ,0.2,1,0,0,0",
        "7,+0.5,-1.0,.2,1,0,0,0,12.5",
        "7,0.5,-1,0.2,1,0,0,0*4A",
        "7,0.5,-1,0.2,1,0,0,0*4a",
    ] {
        let sum = checksum(b"7,0.5,-1,0.2,1,0,0,0");
        let line = line
            .replace("4A", &format!("{sum:02X}"))
            .replace("4a", &format!("{sum:02x}"));
        let reading = parse(&line).unwrap_or_else(|fault| panic!("{line}: {fault}"));
        let metres = reading.transmitter_from_sensor.translation;
        assert!((metres - DVec3::new(0.5, -1.0, 0.2)).length() < 1e-12);
        assert_eq!(reading.station, 7);
    }
}

#[test]
fn malformed_lines_are_refused() {
    for line in [
        "",
        "1",
        "0,0,0,0,1,0,0,0",
        "256,0,0,0,1,0,0,0",
        "1,0,0,0,1,0,0",
        "1,0,0,0,1,0,0,0,1,2",
        "1,0,0,0,1,0,0,0,soon",
        "1,nan,0,0,1,0,0,0",
        "1,inf,0,0,1,0,0,0",
        "1,0,0,0,1,0,0,0*00",
        "1,0,0,0,1,0,0,0*",
        "1,0,0,0,1,0,0,0*1",
        "1,,0,0,1,0,0,0",
    ] {
        assert_eq!(parse(line), Err(Fault::Layout), "{line}");
    }
    for line in ["1,0,0,0,1,1,0,0", "1,0,0,0,0,0,0,0", "1,1e9,0,0,1,0,0,0"] {
        assert_eq!(parse(line), Err(Fault::Implausible), "{line}");
    }
    assert_eq!(
        Format::default().parse(b"1,\xff,0,0,1,0,0,0"),
        Err(Fault::Layout)
    );
}

#[test]
fn the_rest_of_a_line_is_discarded() {
    let format = Format::default();
    let line = b"2,0,0,0,1,0,0,0\n";
    let skip = |skip| Verdict::Noise {
        skip,
        fault: Fault::Layout,
    };
    assert_eq!(format.classify(None, line), skip(16));
    assert_eq!(format.classify(Some(b'1'), line), skip(16));
    assert!(matches!(
        format.classify(Some(b'\n'), line),
        Verdict::Reading { len: 16, .. }
    ));
    assert_eq!(
        format.classify(Some(b'\n'), b"# hello\r\n"),
        Verdict::NoPose { len: 9 }
    );
    assert_eq!(
        format.classify(Some(b'\n'), b"\r\n"),
        Verdict::NoPose { len: 2 }
    );
    assert_eq!(format.classify(Some(b'\n'), b"2,0"), Verdict::Incomplete);
    assert_eq!(format.classify(Some(b'\n'), &[b'1'; 300]), skip(LINE_LIMIT));
}
