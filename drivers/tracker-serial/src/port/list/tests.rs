#![expect(clippy::unwrap_used)]
use super::*;

fn usb_port(path: &str, (vid, pid): (u16, u16), product: &str) -> SerialPortInfo {
    SerialPortInfo {
        port_name: path.to_owned(),
        port_type: SerialPortType::UsbPort(UsbPortInfo {
            vid,
            pid,
            serial_number: Some("A50285BI".to_owned()),
            manufacturer: Some(String::new()),
            product: Some(product.to_owned()),
        }),
    }
}

#[test]
fn usb_ports_are_described_with_their_identity() {
    let names = BTreeMap::from([(PathBuf::from("/dev/ttyUSB0"), "usb-FTDI_X-if00".to_owned())]);
    let adapter = usb_port("/dev/ttyUSB0", (0x0403, 0x6001), "FT232R USB UART");
    let adapter = describe(adapter, &names);
    assert!(adapter.likely.unwrap().contains("FASTRAK"));
    assert_eq!(adapter.by_id.as_deref(), Some("usb-FTDI_X-if00"));
    let usb = adapter.usb.unwrap();
    assert_eq!((usb.vendor, usb.product), (0x0403, 0x6001));
    assert_eq!(usb.serial.as_deref(), Some("A50285BI"));
    // A device may send an empty text.
    assert_eq!(
        (usb.maker, usb.name.as_deref()),
        (None, Some("FT232R USB UART"))
    );

    let board = usb_port("/dev/ttyACM0", (0x2341, 0x0043), "Arduino Uno");
    let board = describe(board, &names);
    assert_eq!(
        (board.likely, board.by_id),
        (Some("home-made tracker (csv)"), None)
    );
}

#[test]
fn a_port_on_no_bus_has_a_path_alone() {
    let port = SerialPortInfo {
        port_name: "/dev/ttyS0".to_owned(),
        port_type: SerialPortType::Unknown,
    };
    let expected = PortInfo {
        path: "/dev/ttyS0".to_owned(),
        ..PortInfo::default()
    };
    assert_eq!(describe(port, &BTreeMap::new()), expected);
}

/// A class folder with a USB port, a board's built-in port, one without a chip and a console.
fn class_folder() -> PathBuf {
    let root = std::env::temp_dir().join(format!("penumbra-ports-{}", std::process::id()));
    for folder in ["ttyUSB0/device", "ttyTHS1/device", "ttyS7/device", "tty0"] {
        fs::create_dir_all(root.join(folder)).unwrap();
    }
    fs::write(root.join("ttyTHS1/type"), "20\n").unwrap();
    fs::write(root.join("ttyS7/type"), "0\n").unwrap();
    root
}

#[test]
fn built_in_ports_are_found_unless_they_have_no_chip() {
    let class = class_folder();
    let known = [PortInfo {
        path: "/dev/ttyUSB0".to_owned(),
        ..PortInfo::default()
    }];
    let mut others = other_ports(&class, &known);
    others.sort();
    let present =
        ["/dev/ttyUSB0", "/dev/ttyTHS1", "/dev/ttyS7"].map(|path| has_hardware(&class, path));
    fs::remove_dir_all(class).unwrap();
    assert_eq!(others, ["/dev/ttyS7", "/dev/ttyTHS1"]);
    assert_eq!(present, [true, true, false]);
}

#[test]
fn a_machine_without_sysfs_has_no_ports_and_no_error() {
    assert!(other_ports(Path::new("/nowhere"), &[]).is_empty());
    let _ = list_ports();
}
