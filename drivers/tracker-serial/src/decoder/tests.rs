use crate::fastrak::{Decoder, Encoding, Ending, Format, Orientation};
use glam::DVec3;
use penumbra_interface::MonotonicTime;
use proptest::prelude::*;

/// Records whose positions increase in steps, so that all are different.
fn ascii(count: usize) -> Vec<u8> {
    (0..count).flat_map(ascii_record).collect()
}

fn ascii_record(i: usize) -> Vec<u8> {
    let x = i as f64 * 0.25 - 20.0;
    format!(
        "01 {x:7.2}{:7.2}{:7.2}{:7.2}{:7.2}{:7.2}\r\n",
        -x, -100.0, -90.5, 12.25, 0.0
    )
    .into_bytes()
}

fn binary_format() -> Format {
    Format {
        encoding: Encoding::Binary,
        orientation: Orientation::Quaternion,
        ending: Ending::Space,
        ..Format::default()
    }
}

fn binary(count: usize) -> Vec<u8> {
    (0..count).flat_map(binary_record).collect()
}

fn binary_record(i: usize) -> Vec<u8> {
    let x = i as f32 * 0.25 - 20.0;
    let mut bytes = vec![b'0', b'1' + (i % 4) as u8, b' '];
    let values = [x, -x, 3.5, 0.5, -0.5, 0.5, -0.5];
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes.push(b' ');
    bytes
}

fn at(nanos: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(nanos)
}

/// X of every record found, inches.
fn decode(format: Format, pieces: &[&[u8]]) -> (Vec<f64>, Decoder) {
    let mut decoder = Decoder::new(format);
    let mut found = Vec::new();
    for piece in pieces {
        decoder.push(piece, at(7), |sample| {
            found.push(sample.transmitter_from_sensor.translation.x / 0.0254);
        });
    }
    (found, decoder)
}

fn steps(range: std::ops::Range<usize>) -> Vec<f64> {
    range.map(|i| i as f64 * 0.25 - 20.0).collect()
}

fn assert_close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "{found:?} for {expected:?}");
    let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    assert!(
        worst.fold(0.0, f64::max) < 1e-6,
        "{found:?} for {expected:?}"
    );
}

#[test]
fn single_record_does_not_synchronise() {
    let (found, decoder) = decode(Format::default(), &[&ascii(1)]);
    assert!(found.is_empty() && !decoder.locked());
    let (found, decoder) = decode(Format::default(), &[&ascii(2)]);
    assert_close(&found, &steps(0..2));
    assert!(decoder.locked());
}

#[test]
fn an_error_letter_is_reported_and_the_record_kept() {
    let mut bytes = ascii(2);
    bytes[47 + 2] = b'C';
    let mut errors = Vec::new();
    let mut decoder = Decoder::new(Format::default());
    decoder.push(&bytes, at(0), |sample| errors.push(sample.error));
    assert_eq!(errors, [None, Some(b'C')]);
    assert_eq!(decoder.counters().error, Some(b'C'));
}

#[test]
fn a_record_has_the_arrival_time_of_its_last_byte() {
    let mut arrivals = Vec::new();
    let mut decoder = Decoder::new(Format::default());
    let bytes = ascii(3);
    for (i, piece) in bytes.chunks(47).enumerate() {
        decoder.push(piece, at(1000 * i as i64), |s| arrivals.push(s.arrived_at));
    }
    assert_eq!(arrivals, [at(0), at(1000), at(2000)]);
}

#[test]
fn the_baud_rate_separates_records_of_one_read() {
    let mut arrivals = Vec::new();
    let mut decoder = Decoder::new(Format::default()).with_baud(9_600);
    decoder.push(&ascii(3), at(1_000_000_000), |s| {
        arrivals.push(s.arrived_at)
    });
    let record_nanos = 47 * 10 * 1_000_000_000_i64 / 9_600;
    let expected: Vec<_> = (0..3)
        .map(|i| 1_000_000_000 - (2 - i) * record_nanos)
        .collect();
    for (arrival, expected) in arrivals.iter().zip(expected) {
        assert!((arrival.as_nanos() - expected).abs() <= 1);
    }
    assert_eq!(arrivals.len(), 3);
}

#[test]
fn station_numbers_are_kept() {
    let mut stations = Vec::new();
    let mut decoder = Decoder::new(binary_format());
    decoder.push(&binary(5), at(0), |sample| {
        stations.push(sample.station);
        assert!((sample.transmitter_from_sensor.translation.z - 3.5 * 0.0254).abs() < 1e-9);
        let axis = sample.transmitter_from_sensor.rotation * DVec3::X;
        assert!((axis.length() - 1.0).abs() < 1e-9);
    });
    assert_eq!(stations, [1, 2, 3, 4, 1]);
}

#[test]
fn garbage_longer_than_the_buffer_is_skipped() {
    let garbage = vec![b'0'; 1000];
    let stream = [garbage, ascii(4)].concat();
    let (found, decoder) = decode(Format::default(), &[&stream]);
    assert_close(&found, &steps(0..4));
    assert_eq!(decoder.counters().skipped_bytes, 1000);
    assert_eq!(decoder.counters().resyncs, 0);
}

#[test]
fn status_record_between_readings_loses_no_reading() {
    let mut status = b"21S3F0000  00xxxxxx".to_vec();
    status.resize(53, b'F');
    status.extend_from_slice(b"\r\n");
    let stream = [ascii(3), status, (3..6).flat_map(ascii_record).collect()].concat();
    let (found, decoder) = decode(Format::default(), &[&stream]);
    assert_close(&found, &steps(0..6));
    let counters = decoder.counters();
    assert_eq!((counters.resyncs, counters.without_pose), (0, 1));
}

proptest! {
    #[test]
    fn result_does_not_depend_on_split_reads(cuts in prop::collection::vec(0usize..47 * 12, 0..20), text in any::<bool>()) {
        let (format, stream) = if text {
            (Format::default(), ascii(12))
        } else {
            (binary_format(), binary(12))
        };
        let mut cuts: Vec<_> = cuts.into_iter().map(|cut| cut.min(stream.len())).collect();
        cuts.extend([0, stream.len()]);
        cuts.sort_unstable();
        let pieces: Vec<&[u8]> = cuts.windows(2).map(|w| &stream[w[0]..w[1]]).collect();
        let (found, _) = decode(format, &pieces);
        assert_close(&found, &steps(0..12));
    }

    #[test]
    fn garbage_before_and_between_loses_no_text_record(
        before in prop::collection::vec(any::<u8>(), 0..200),
        between in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let stream = [before, ascii(3), between, (3..6).flat_map(ascii_record).collect()].concat();
        let (found, decoder) = decode(Format::default(), &[&stream]);
        assert_close(&found, &steps(0..6));
        prop_assert_eq!(decoder.counters().records, 6);
    }

    #[test]
    fn arbitrary_bytes_give_only_plausible_poses(bytes in prop::collection::vec(any::<u8>(), 0..2000), text in any::<bool>()) {
        let format = if text { Format::default() } else { binary_format() };
        let (found, decoder) = decode(format, &[&bytes]);
        prop_assert!(found.iter().all(|x| x.abs() * 0.0254 <= format.envelope_metres));
        let used = found.len() * format.record_len();
        prop_assert!(used as u64 + decoder.counters().skipped_bytes <= bytes.len() as u64);
    }

    #[test]
    fn dropped_inserted_or_flipped_byte_loses_only_neighbouring_records(
        place in 47usize * 3..47 * 9, kind in 0..3, byte in any::<u8>(), bit in 0u8..8,
    ) {
        let mut stream = ascii(14);
        match kind {
            0 => { stream.remove(place); }
            1 => stream.insert(place, byte),
            _ => stream[place] ^= 1 << bit,
        }
        let (found, _) = decode(Format::default(), &[&stream]);
        let damaged = place / 47;
        let is_step = |i: usize| found.iter().any(|x| (x - steps(i..i + 1)[0]).abs() < 1e-6);
        for i in (0..damaged.saturating_sub(1)).chain(damaged + 2..14) {
            prop_assert!(is_step(i), "record {} lost by damage in {}", i, damaged);
        }
        // At most the damaged record itself may be misread, where one digit became another.
        let wrong = found.iter().filter(|x| !steps(0..14).iter().any(|s| (s - **x).abs() < 1e-6));
        prop_assert!(wrong.count() <= 1);
    }

    #[test]
    fn dropped_byte_in_binary_loses_at_most_two_neighbours(place in 32usize * 3..32 * 9) {
        let mut stream = binary(14);
        stream.remove(place);
        let (found, _) = decode(binary_format(), &[&stream]);
        let damaged = place / 32;
        for i in (0..damaged).chain(damaged + 2..14) {
            prop_assert!(found.iter().any(|x| (x - steps(i..i + 1)[0]).abs() < 1e-6), "record {}", i);
        }
    }
}
