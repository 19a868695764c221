#![allow(clippy::unwrap_used, clippy::expect_used)]
use super::*;

/// `/sys` as a machine with an FTDI adapter, a board and an empty built-in port has it.
fn machine() -> PathBuf {
    let root = std::env::temp_dir().join(format!("penumbra-ports-{}", std::process::id()));
    let put = |path: &str, text: &str| {
        let path = root.join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    };
    for (port, usb, vendor, product, name) in [
        ("ttyUSB0", "usb1", "0403", "6001", "FT232R USB UART"),
        ("ttyACM0", "usb2", "2341", "0043", "Arduino Uno"),
    ] {
        put(&format!("devices/{usb}/idVendor"), &format!("{vendor}\n"));
        put(&format!("devices/{usb}/idProduct"), &format!("{product}\n"));
        put(&format!("devices/{usb}/product"), name);
        put(&format!("devices/{usb}/serial"), "A50285BI\n");
        put(&format!("devices/{usb}/{port}/uevent"), "");
        put(&format!("class/{port}/uevent"), "");
        let device = root.join(format!("devices/{usb}/{port}"));
        let _ = std::os::unix::fs::symlink(device, root.join(format!("class/{port}/device")));
    }
    put("devices/serial8250/uevent", "");
    put("class/ttyS7/type", "0\n");
    let _ = std::os::unix::fs::symlink(
        root.join("devices/serial8250"),
        root.join("class/ttyS7/device"),
    );
    put("class/tty0/uevent", "");
    root
}

#[test]
fn ports_are_listed_with_what_is_known_of_them() {
    let root = machine();
    let names = BTreeMap::from([(PathBuf::from("/dev/ttyUSB0"), "usb-FTDI_X-if00".to_owned())]);
    let ports = ports_in(&root.join("class"), &names);
    fs::remove_dir_all(root).unwrap();
    let paths: Vec<_> = ports.iter().map(|port| port.path.as_str()).collect();
    assert_eq!(paths, ["/dev/ttyACM0", "/dev/ttyUSB0"]);
    assert_eq!(ports[0].likely, Some("home-made tracker (csv)"));
    assert!(ports[1].likely.unwrap().contains("FASTRAK"));
    assert_eq!(ports[1].by_id.as_deref(), Some("usb-FTDI_X-if00"));
    let usb = ports[1].usb.as_ref().unwrap();
    assert_eq!((usb.vendor, usb.product), (0x0403, 0x6001));
    assert_eq!(usb.serial.as_deref(), Some("A50285BI"));
}

#[test]
fn a_machine_without_sys_has_no_ports_and_no_error() {
    assert!(ports_in(Path::new("/nowhere"), &BTreeMap::new()).is_empty());
    let _ = list_ports();
}
