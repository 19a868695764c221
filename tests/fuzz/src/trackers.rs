//! Properties of every decoder for arbitrary bytes.

use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_tracker_serial::{AnyDecoder, Counters};

/// Decodes `data` by each of the protocols, at once and in pieces: the results must be equal,
/// every pose must be valid, and no byte may be counted twice.
pub fn check(protocols: &[&str], data: &[u8]) {
    let Some((seed, bytes)) = data.split_first() else {
        return;
    };
    for protocol in protocols {
        let (whole, counters) = decode(protocol, bytes, bytes.len().max(1));
        let (pieces, in_pieces) = decode(protocol, bytes, 1 + usize::from(*seed) % 64);
        assert_eq!(whole, pieces, "{protocol}: pieces change the result");
        assert_eq!(counters, in_pieces, "{protocol}: pieces change the result");
        assert!(counters.skipped_bytes <= bytes.len() as u64, "{protocol}");
        for sample in whole {
            let pose = sample.transmitter_from_sensor;
            assert!(pose.rotation.is_normalized(), "{protocol}: {pose:?}");
            assert!(pose.translation.length() <= 250.0, "{protocol}: {pose:?}");
        }
    }
}

fn decode(protocol: &str, bytes: &[u8], piece: usize) -> (Vec<PoseSample>, Counters) {
    let Some(decoder) = AnyDecoder::for_protocol(protocol) else {
        panic!("{protocol} is no protocol");
    };
    let (mut decoder, mut found) = (decoder, Vec::new());
    for piece in bytes.chunks(piece) {
        decoder.push(piece, MonotonicTime::from_nanos(1), |sample| {
            found.push(sample)
        });
    }
    (found, decoder.counters())
}
