//! Recorded bytes are decoded, and the poses compared with those that the recordings are known
//! to hold (`tests/fixtures/tracker/ORIGIN.md`): in one piece, byte by byte, and through a
//! pseudo-terminal.
#![expect(clippy::unwrap_used, clippy::panic)]
#![allow(clippy::disallowed_methods, reason = "tests start their own threads")]

#[cfg(unix)]
mod common;

use glam::{DQuat, DVec3};
use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_tracker_serial::AnyDecoder;
use proptest::prelude::*;
use std::path::PathBuf;

const RECORDINGS: [&str; 7] = [
    "flock",
    "fastrak-text",
    "fastrak-binary",
    "fastrak-noisy",
    "liberty",
    "freed",
    "csv",
];

struct Recording {
    name: &'static str,
    bytes: Vec<u8>,
    protocol: String,
    metres_per_unit: Option<f64>,
    /// Metres, radians.
    tolerance: (f64, f64),
    skipped: u64,
    poses: Vec<(u8, DVec3, DQuat)>,
}

impl Recording {
    fn load(name: &'static str) -> Self {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/fixtures/tracker");
        let check = std::fs::read_to_string(folder.join(format!("{name}.chk"))).unwrap();
        let mut recording = Self {
            name,
            bytes: std::fs::read(folder.join(format!("{name}.log"))).unwrap(),
            protocol: String::new(),
            metres_per_unit: None,
            tolerance: (0.0, 0.0),
            skipped: 0,
            poses: Vec::new(),
        };
        for line in check.lines() {
            let (key, rest) = line.split_once(' ').unwrap();
            let numbers: Vec<f64> = rest.split(' ').filter_map(|n| n.parse().ok()).collect();
            match (key, numbers.as_slice()) {
                ("protocol", _) => recording.protocol = rest.to_owned(),
                ("tolerance", [metres, radians]) => recording.tolerance = (*metres, *radians),
                ("skipped", [bytes]) => recording.skipped = *bytes as u64,
                ("metres_per_unit", [metres]) => recording.metres_per_unit = Some(*metres),
                ("pose", [station, x, y, z, qw, qx, qy, qz]) => recording.poses.push((
                    *station as u8,
                    DVec3::new(*x, *y, *z),
                    DQuat::from_xyzw(*qx, *qy, *qz, *qw).normalize(),
                )),
                _ => panic!("{name}.chk: {line}"),
            }
        }
        recording
    }

    fn decoder(&self) -> AnyDecoder {
        let decoder = AnyDecoder::for_protocol(&self.protocol).unwrap();
        match self.metres_per_unit {
            Some(metres) => decoder.with_metres_per_unit(metres),
            None => decoder,
        }
    }

    fn is(&self, found: &PoseSample, expected: &(u8, DVec3, DQuat)) -> bool {
        let (station, position, rotation) = expected;
        let pose = found.transmitter_from_sensor;
        found.station == *station
            && (pose.translation - position).length() <= self.tolerance.0
            && pose.rotation.angle_between(*rotation) <= self.tolerance.1
    }

    #[track_caller]
    fn check(&self, found: &[PoseSample]) {
        assert_eq!(found.len(), self.poses.len(), "{}", self.name);
        for (i, (found, expected)) in found.iter().zip(&self.poses).enumerate() {
            assert!(
                self.is(found, expected),
                "{} {i}: {found:?} for {expected:?}",
                self.name
            );
        }
    }
}

#[test]
fn recordings_decode_to_their_known_poses() {
    for name in RECORDINGS {
        let recording = Recording::load(name);
        for size in [1, 7, recording.bytes.len()] {
            let mut decoder = recording.decoder();
            let mut found = Vec::new();
            for piece in recording.bytes.chunks(size) {
                decoder.push(piece, MonotonicTime::default(), |sample| found.push(sample));
            }
            recording.check(&found);
            assert_eq!(
                decoder.counters().skipped_bytes,
                recording.skipped,
                "{name}"
            );
        }
    }
}

/// Every byte in turn is lost, doubled, or has one bit flipped: the decoder recovers within two
/// records, and where the protocol has a checksum, it passes no wrong pose on.
#[test]
fn damage_loses_at_most_the_neighbouring_records() {
    for name in RECORDINGS {
        let mut recording = Recording::load(name);
        let record = recording.bytes.len() / recording.poses.len();
        recording.bytes.truncate(record * 16);
        let mut whole = recording.decoder();
        let mut count = 0;
        whole.push(&recording.bytes, MonotonicTime::default(), |_| count += 1);
        // The last records stay undamaged: after damage, two valid ones are needed.
        for place in 0..recording.bytes.len().saturating_sub(4 * record) {
            for fault in 0..10_u32 {
                let mut bytes = recording.bytes.clone();
                match fault {
                    0..8 => bytes[place] ^= 1 << fault,
                    8 => drop(bytes.remove(place)),
                    _ => bytes.insert(place, bytes[place]),
                }
                let mut decoder = recording.decoder();
                let mut found = Vec::new();
                decoder.push(&bytes, MonotonicTime::default(), |s| found.push(s));
                let known = |s: &&PoseSample| recording.poses.iter().any(|p| recording.is(s, p));
                let wrong = found.len() - found.iter().filter(known).count();
                // A lost or doubled byte leaves FreeD's checksum right once in 256 times.
                let detected = name == "csv" || (name == "freed" && fault < 8);
                assert!(
                    wrong <= usize::from(!detected),
                    "{name} {place} {fault}: {wrong} wrong"
                );
                // The decoder locks on two valid records: near the beginning, the one before the
                // damage is lost, too.
                let lost = if place < 4 * record { 3 } else { 2 };
                assert!(
                    found.len() + lost >= count,
                    "{name} {place} {fault}: {} of {count}",
                    found.len()
                );
            }
        }
    }
}

impl Recording {
    /// The offsets at which records end.
    fn ends(&self) -> Vec<usize> {
        if self.name == "csv" {
            let lines = self
                .bytes
                .iter()
                .enumerate()
                .filter(|(_, byte)| **byte == b'\n');
            return lines.map(|(i, _)| i + 1).collect();
        }
        let record = self.bytes.len() / self.poses.len();
        (1..=self.poses.len()).map(|i| i * record).collect()
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn garbage_loses_at_most_the_neighbouring_records(
        before in prop::collection::vec(any::<u8>(), 0..300),
        between in prop::collection::vec(any::<u8>(), 0..300),
        place in 2usize..6,
        cuts in prop::collection::vec(1usize..90, 1..8),
    ) {
        for name in RECORDINGS.iter().filter(|name| **name != "fastrak-noisy") {
            let mut recording = Recording::load(name);
            let ends = recording.ends();
            recording.bytes.truncate(ends[9]);
            let (head, tail) = recording.bytes.split_at(ends[place]);
            let stream = [&before, head, &between, tail].concat();
            let (mut decoder, mut found, mut rest) = (recording.decoder(), Vec::new(), &stream[..]);
            for cut in cuts.iter().cycle() {
                let (piece, later) = rest.split_at((*cut).min(rest.len()));
                decoder.push(piece, MonotonicTime::default(), |sample| found.push(sample));
                rest = later;
                if rest.is_empty() {
                    break;
                }
            }
            let known = |s: &PoseSample| recording.poses.iter().any(|p| recording.is(s, p));
            prop_assert!(found.iter().all(known), "{}: {:?}", name, found);
            // Garbage that ends like the beginning of a record may cost the next one, no more.
            prop_assert!(found.len() >= 7, "{}: {} of 10", name, found.len());
        }
    }

    #[test]
    fn arbitrary_bytes_give_only_plausible_poses_in_order(
        bytes in prop::collection::vec(any::<u8>(), 0..3000), cut in 1usize..200,
    ) {
        for protocol in penumbra_tracker_serial::PROTOCOLS {
            let mut decoder = AnyDecoder::for_protocol(protocol).unwrap().with_baud(9600);
            let (mut found, mut now) = (Vec::new(), 0);
            for piece in bytes.chunks(cut) {
                now += 1_000_000;
                decoder.push(piece, MonotonicTime::from_nanos(now), |sample| found.push(sample));
            }
            prop_assert!(decoder.counters().skipped_bytes <= bytes.len() as u64);
            prop_assert!(found.windows(2).all(|w| w[0].arrived_at <= w[1].arrived_at));
            prop_assert!(found.iter().all(|s| s.transmitter_from_sensor.rotation.is_normalized()));
        }
    }
}

#[cfg(unix)]
#[test]
fn recordings_decode_through_a_pseudo_terminal() {
    use common::{Device, settings};
    use penumbra_synthetic::{Faults, Recording as Bytes, SimulatedTracker, Source};
    for name in [
        "flock",
        "fastrak-text",
        "fastrak-binary",
        "liberty",
        "freed",
        "csv",
    ] {
        let recording = Recording::load(name);
        let pieces = recording.bytes.chunks(23).enumerate();
        let chunks = pieces.map(|(i, piece)| {
            (
                MonotonicTime::from_nanos(i as i64 * 2_000_000),
                piece.to_vec(),
            )
        });
        let source = Source::Recording(Bytes::new(chunks.collect()));
        let device = SimulatedTracker::new(&recording.protocol, source, None, false).unwrap();
        let device = Device::with(device, Faults::parse("split").unwrap());
        let mut tracker = penumbra_tracker_serial::open(&settings(&recording.protocol, &device))
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut decoder = recording.decoder();
        let found = common::decode(&mut *tracker, &mut decoder, 30);
        for sample in &found {
            let known = recording
                .poses
                .iter()
                .any(|pose| recording.is(sample, pose));
            assert!(known, "{name}: {sample:?}");
        }
        assert!(tracker.report().bytes > 0);
    }
}
