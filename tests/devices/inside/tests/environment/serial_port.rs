//! A serial port on USB.

use penumbra_guest::rig::{TRACKER, plug_tracker, ready, wait_until};
use penumbra_guest::serial;
use std::io::{Read, Write};
use std::path::Path;

#[test]
#[ignore = "needs the guest: make test-devices"]
fn carries_bytes_and_notices_its_unplugging() {
    ready();
    let mut tracker = serial::open("/dev/ttyGS0");
    let mut port = serial::open(TRACKER);
    let every_byte: Vec<u8> = (0..=255).collect();
    let mut got = [0; 256];
    tracker.write_all(&every_byte).unwrap();
    port.read_exact(&mut got).unwrap();
    assert_eq!(got.as_slice(), every_byte);
    port.write_all(b"C\r").unwrap();
    tracker.read_exact(&mut got[..2]).unwrap();
    assert_eq!(&got[..2], b"C\r");
    drop(tracker);
    plug_tracker(false);
    assert!(
        matches!(port.read(&mut got), Ok(0) | Err(_)),
        "a read ends when the cable is unplugged"
    );
    drop(port);
    wait_until("its link is removed", || !Path::new(TRACKER).exists());
    plug_tracker(true);
    wait_until("its link is restored", || Path::new(TRACKER).exists());
}
