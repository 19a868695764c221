//! The bytes of trackers.

use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_tracker_serial::vrpn::{Client, POS_QUAT_LEN};
use penumbra_tracker_serial::{AnyDecoder, Counters};

/// All formats of a FASTRAK's records.
pub fn fastrak(data: &[u8]) {
    let protocols = [
        "fastrak",
        "fastrak-ascii-quaternion",
        "fastrak-ascii-extended-euler",
        "fastrak-ascii-extended-quaternion",
        "fastrak-binary-euler",
        "fastrak-binary-quaternion",
    ];
    check(&protocols, data);
}

/// Liberty and Patriot records.
pub fn liberty(data: &[u8]) {
    check(&["liberty", "liberty-euler"], data);
}

/// All formats of a Flock of Birds' records.
pub fn flock(data: &[u8]) {
    let protocols = ["flock", "flock-angles", "flock-group", "flock-angles-group"];
    check(&protocols, data);
}

/// FreeD D1.
pub fn freed(data: &[u8]) {
    check(&["freed", "freed:-tilt,pan,roll,z,y,x"], data);
}

/// The line protocol of home-made trackers.
pub fn csv(data: &[u8]) {
    check(&["csv"], data);
}

/// A VRPN server that sends arbitrary bytes: only complete messages may be passed on, and they
/// must not depend on how the stream is split.
pub fn vrpn(data: &[u8]) {
    check(&["vrpn"], data);
    let (whole, failed) = relay(data, data.len().max(1));
    assert_eq!(whole.len() % POS_QUAT_LEN, 0);
    let pieces = relay(data, 1 + data.len() % 7);
    assert_eq!((whole, failed), pieces);
}

fn relay(data: &[u8], piece: usize) -> (Vec<u8>, bool) {
    let (mut client, mut wanted) = (Client::new("Tracker0"), Vec::new());
    let mut pieces = data.chunks(piece);
    let failed = pieces.any(|piece| client.push(piece, &mut wanted).is_err());
    (wanted, failed)
}

/// Decodes `data` by each of the protocols, at once and in pieces: the results must be equal,
/// every pose must be valid, and no byte may be counted twice.
fn check(protocols: &[&str], data: &[u8]) {
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
