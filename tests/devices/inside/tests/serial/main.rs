//! The tracker driver on the kernel's serial ports.
#![expect(clippy::unwrap_used)]
#![allow(clippy::disallowed_methods)] // a test has no rig to start its threads

mod gadget;

use gadget::Gadget;
use penumbra_guest::rig::{TRACKER, plug_tracker, ready, wait_until};
use penumbra_interface::{DeviceError, Recovery, Tracker};
use penumbra_tracker_serial::port::{Parity, SerialLine};
use penumbra_tracker_serial::{AnyDecoder, PortName, TrackerSettings, list_ports, open};
use std::path::Path;
use std::time::{Duration, Instant};

fn settings() -> TrackerSettings {
    TrackerSettings::new("fastrak", PortName::Serial(TRACKER.to_owned()))
}

/// Reads until `count` poses have been decoded.
fn read_poses(tracker: &mut dyn Tracker, count: usize) {
    let mut decoder = AnyDecoder::for_protocol("fastrak").unwrap();
    let (began, mut arrivals) = (Instant::now(), Vec::new());
    while arrivals.len() < count {
        assert!(
            began.elapsed() < Duration::from_secs(10),
            "{}",
            arrivals.len()
        );
        if let Some(read) = tracker.next_bytes(Duration::from_millis(200)).unwrap() {
            decoder.push(&read.bytes, read.arrived_at, |pose| {
                arrivals.push(pose.arrived_at)
            });
        }
    }
    assert!(arrivals.is_sorted());
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn lists_usb_port_with_its_identity() {
    ready();
    let ports = list_ports();
    let short = TRACKER.rsplit('/').next();
    let port = ports.iter().find(|port| port.by_id.as_deref() == short);
    let port = port.unwrap_or_else(|| panic!("no {short:?} in {ports:#?}"));
    assert_eq!(port.path, "/dev/ttyACM0");
    assert_eq!(port.likely, Some("Polhemus tracker"));
    let usb = port.usb.as_ref().unwrap();
    assert_eq!((usb.vendor, usb.product), (0x0f44, 0x0002));
    assert_eq!(usb.maker.as_deref(), Some("Polhemus"));
    assert_eq!(usb.name.as_deref(), Some("FASTRAK"));
    assert_eq!(usb.serial.as_deref(), Some("FT0001"));
    // The guest has one built-in port; the kernel's table has others without a chip.
    let built_in: Vec<_> = ports.iter().filter(|port| port.usb.is_none()).collect();
    assert!(
        matches!(built_in.as_slice(), [console] if console.path == "/dev/ttyS0"),
        "{built_in:#?}"
    );
}

#[test]
#[ignore = "needs the guest: make test-devices"]
fn unplugged_tracker_is_noticed_at_once() {
    ready();
    let device = Gadget::start();
    let mut tracker = open(&settings()).unwrap();
    read_poses(&mut *tracker, 20);
    assert!(tracker.report().description.unwrap().contains("FASTRAK"));
    let busy = open(&settings()).err().unwrap();
    assert!(busy.to_string().contains("busy"), "{busy}");

    plug_tracker(false);
    let began = Instant::now();
    let error = loop {
        if let Err(error) = tracker.next_bytes(Duration::from_secs(5)) {
            break error;
        }
    };
    let elapsed = began.elapsed();
    assert!(matches!(error, DeviceError::Unplugged { .. }), "{error}");
    assert!(elapsed < Duration::from_millis(2500), "{elapsed:?}");
    println!(
        "measured: unplugging noticed after {} ms",
        elapsed.as_millis()
    );
    drop((tracker, device));
    wait_until("its link is removed", || !Path::new(TRACKER).exists());
    let error = open(&settings()).err().unwrap();
    assert_eq!(error.recovery(), Recovery::Reopen, "{error}");

    plug_tracker(true);
    ready();
    let _device = Gadget::start();
    let mut tracker = open(&settings()).unwrap();
    read_poses(&mut *tracker, 5);
}

/// The device's end of the cable has no serial line: its driver keeps 9600 baud and 8N1 and
/// ignores other settings without an error.
#[test]
#[ignore = "needs the guest: make test-devices"]
fn refuses_settings_that_a_port_ignores() {
    ready();
    let refused = |baud, parity| {
        let error = SerialLine::open("/dev/ttyGS0", baud, parity).err();
        error.expect("the port ignores the setting").to_string()
    };
    let text = refused(115_200, Parity::None);
    assert!(text.contains("115200 baud, 8N1"), "{text}");
    assert!(text.contains("9600 baud, 8N1"), "{text}");
    let text = refused(9_600, Parity::Odd);
    assert!(text.contains("9600 baud, 8O1"), "{text}");
    SerialLine::open("/dev/ttyGS0", 9_600, Parity::None).unwrap();
}
