//! Lists the serial ports of this machine with their USB identity, by `serialport`.

use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const TTY_CLASS: &str = "/sys/class/tty";
const BY_ID: &str = "/dev/serial/by-id";

/// A serial port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortInfo {
    /// `/dev/ttyUSB0`: depends on the order in which devices were plugged in.
    pub path: String,
    /// Its name under `/dev/serial/by-id`, which is stable: use it in a configuration. Linux only.
    pub by_id: Option<String>,
    /// The identity that the USB device reports; `None` for other ports.
    pub usb: Option<UsbIdentity>,
    /// The device that is probably connected, by the USB identity alone.
    pub likely: Option<&'static str>,
}

/// The identity that a USB device reports.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UsbIdentity {
    /// Vendor ID.
    pub vendor: u16,
    /// Product ID, assigned by the vendor.
    pub product: u16,
    /// Name of the manufacturer.
    pub maker: Option<String>,
    /// Name of the product.
    pub name: Option<String>,
    /// Serial number.
    pub serial: Option<String>,
}

/// Lists all serial ports, sorted by path. Empty if they cannot be listed; the port can then be
/// named by its path.
#[must_use]
pub fn list_ports() -> Vec<PortInfo> {
    let names = names_by_id(Path::new(BY_ID));
    let mut ports: Vec<_> = found_by_serialport()
        .into_iter()
        .map(|port| describe(port, &names))
        .collect();
    let others = other_ports(Path::new(TTY_CLASS), &ports);
    ports.extend(others.into_iter().map(|path| PortInfo {
        by_id: names.get(Path::new(&path)).cloned(),
        path,
        ..PortInfo::default()
    }));
    ports.retain(|port| has_hardware(Path::new(TTY_CLASS), &port.path));
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// On Linux `serialport` panics where sysfs cannot be read, as in some containers.
fn found_by_serialport() -> Vec<SerialPortInfo> {
    if cfg!(target_os = "linux") && fs::read_dir(TTY_CLASS).is_err() {
        return Vec::new();
    }
    serialport::available_ports().unwrap_or_default()
}

fn describe(port: SerialPortInfo, names: &BTreeMap<PathBuf, String>) -> PortInfo {
    let usb = match port.port_type {
        SerialPortType::UsbPort(usb) => Some(identity(usb)),
        _ => None,
    };
    PortInfo {
        by_id: names.get(Path::new(&port.port_name)).cloned(),
        path: port.port_name,
        likely: usb.as_ref().and_then(likely),
        usb,
    }
}

fn identity(usb: UsbPortInfo) -> UsbIdentity {
    let text = |text: Option<String>| text.filter(|text| !text.trim().is_empty());
    UsbIdentity {
        vendor: usb.vid,
        product: usb.pid,
        maker: text(usb.manufacturer),
        name: text(usb.product),
        serial: text(usb.serial_number),
    }
}

/// Ports of the class folder `class` that have a device and are not in `known`: without
/// libudev, `serialport` leaves out ports on buses that it does not know, such as the built-in
/// ports of ARM boards with a kernel before 6.5.
fn other_ports(class: &Path, known: &[PortInfo]) -> Vec<String> {
    fs::read_dir(class)
        .into_iter()
        .flatten()
        .flatten()
        .filter(|entry| entry.path().join("device").exists())
        .filter_map(|entry| Some(format!("/dev/{}", entry.file_name().to_str()?)))
        .filter(|path| known.iter().all(|port| port.path != *path))
        .collect()
}

/// A PC's table of built-in ports has entries without a chip behind them: type 0. Other ports
/// have no such file.
fn has_hardware(class: &Path, path: &str) -> bool {
    let name = Path::new(path).file_name().unwrap_or_default();
    let kind = fs::read_to_string(class.join(name).join("type"));
    kind.map_or(true, |kind| kind.trim() != "0")
}

/// The probable kind of a USB device. An adapter does not identify the device connected to it.
fn likely(usb: &UsbIdentity) -> Option<&'static str> {
    let named = |word: &str| {
        let texts = [usb.maker.as_deref(), usb.name.as_deref()];
        texts
            .iter()
            .flatten()
            .any(|text| text.to_ascii_lowercase().contains(word))
    };
    match usb.vendor {
        0x0f44 => Some("Polhemus tracker"),
        _ if named("polhemus") || named("liberty") || named("patriot") => Some("Polhemus tracker"),
        _ if named("ascension") || named("flock") => Some("Ascension tracker"),
        _ if named("arduino") || named("teensy") => Some("home-made tracker (csv)"),
        0x2341 | 0x2a03 | 0x16c0 | 0x303a | 0x2e8a => Some("home-made tracker (csv)"),
        0x0403 | 0x067b | 0x10c4 | 0x1a86 | 0x0557 | 0x9710 => {
            Some("USB serial adapter: FASTRAK, Liberty, Flock of Birds or FreeD")
        }
        _ => None,
    }
}

/// Device paths and their names in a folder such as `/dev/serial/by-id`.
fn names_by_id(folder: &Path) -> BTreeMap<PathBuf, String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            Some((entry.path().canonicalize().ok()?, name))
        })
        .collect()
}

/// The name under `/dev/serial/by-id` of the port at `path`, or the path where it has none.
pub(super) fn stable_name(path: &Path) -> String {
    let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    names_by_id(Path::new(BY_ID))
        .remove(&real)
        .unwrap_or_else(|| path.display().to_string())
}

/// Sets the latency timer of the FTDI adapter at `path`, which holds bytes back for 16 ms by
/// default, to 1 ms. A warning where that is not permitted.
pub(super) fn latency_warning(path: &Path) -> Option<String> {
    let real = path.canonicalize().ok()?;
    let timer = Path::new(TTY_CLASS)
        .join(real.file_name()?)
        .join("device/latency_timer");
    let millis: u32 = fs::read_to_string(&timer).ok()?.trim().parse().ok()?;
    if millis <= 1 || fs::write(&timer, "1").is_ok() {
        return None;
    }
    Some(format!(
        "its USB adapter delays bytes by {millis} ms; install the udev rules (`sudo make \
         install`), or write 1 to {}",
        timer.display()
    ))
}

#[cfg(all(test, unix))]
mod tests;
