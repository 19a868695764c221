//! A VRPN server that sends arbitrary bytes: only complete messages may be passed on, and they
//! must not depend on how the stream is split.
#![no_main]

use libfuzzer_sys::fuzz_target;
use penumbra_tracker_serial::vrpn::{Client, POS_QUAT_LEN};

fn run(data: &[u8], piece: usize) -> (Vec<u8>, bool) {
    let (mut client, mut wanted) = (Client::new("Tracker0"), Vec::new());
    let failed = data
        .chunks(piece)
        .any(|piece| client.push(piece, &mut wanted).is_err());
    (wanted, failed)
}

fuzz_target!(|data: &[u8]| {
    penumbra_fuzz::check(&["vrpn"], data);
    let (whole, failed) = run(data, data.len().max(1));
    assert_eq!(whole.len() % POS_QUAT_LEN, 0);
    let pieces = run(data, 1 + data.len() % 7);
    assert_eq!((whole, failed), pieces);
});
