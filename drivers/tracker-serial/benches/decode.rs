//! Records decoded a second on one core, for every protocol: `cargo bench -p
//! penumbra-tracker-serial`. The bytes come from the simulated devices, in reads of 64 bytes,
//! the typical size for a serial port.
#![expect(clippy::unwrap_used)]
#![allow(missing_docs)]

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use penumbra_interface::MonotonicTime;
use penumbra_synthetic::{SimulatedTracker, Source, Trajectory};
use penumbra_tracker_serial::AnyDecoder;
use std::hint::black_box;

const RECORDS: usize = 2000;
const READ: usize = 64;

/// Protocols, and the commands that make a simulated device stream them.
const PROTOCOLS: [(&str, &[u8]); 10] = [
    ("fastrak", b"C"),
    ("fastrak-ascii-quaternion", b"O1,2,11,1\rC"),
    ("fastrak-ascii-extended-quaternion", b"O1,52,61,1\rC"),
    ("fastrak-binary-euler", b"fO1,2,4,0\rC"),
    ("fastrak-binary-quaternion", b"fO1,2,11,0\rC"),
    ("liberty", b"O*,2,7\rF1\rC\r"),
    ("flock", b"]@"),
    ("flock-angles", b"Y@"),
    ("freed", &[0xd0, 0xff, 0x01, 0x70]),
    ("csv", b""),
];

fn stream(protocol: &str, start: &[u8]) -> Vec<u8> {
    let source = Source::Trajectory(Trajectory::default());
    let mut device = SimulatedTracker::new(protocol, source, Some(1000.0), false).unwrap();
    let at = |millis: usize| MonotonicTime::from_nanos(millis as i64 * 1_000_000);
    let mut bytes = Vec::new();
    device.receive(start, at(0), &mut bytes);
    for millis in 0..RECORDS {
        device.advance(at(millis), &mut bytes);
    }
    bytes
}

fn decode(decoder: &mut AnyDecoder, bytes: &[u8]) -> usize {
    let mut found = 0;
    for piece in bytes.chunks(READ) {
        decoder.push(piece, MonotonicTime::from_nanos(0), |sample| {
            black_box(&sample);
            found += 1;
        });
    }
    found
}

fn decoding(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("decode");
    group.throughput(Throughput::Elements(RECORDS as u64));
    for (protocol, start) in PROTOCOLS {
        let bytes = stream(protocol, start);
        let decoder = AnyDecoder::for_protocol(protocol)
            .unwrap()
            .with_baud(115_200);
        let found = decode(&mut decoder.clone(), &bytes);
        assert!(found >= RECORDS - 1, "{protocol}: {found} of {RECORDS}");
        group.bench_function(protocol, |bench| {
            bench.iter_batched_ref(
                || decoder.clone(),
                |decoder| decode(decoder, black_box(&bytes)),
                BatchSize::SmallInput,
            );
        });
    }
    group.finish();
}

criterion_group!(benches, decoding);
criterion_main!(benches);
