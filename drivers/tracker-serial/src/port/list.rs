//! The serial ports of this machine.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A serial port.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortInfo {
    /// `/dev/ttyUSB0`: changes with the order of plugging.
    pub path: String,
    /// Its name under `/dev/serial/by-id`: does not. Use this one in a configuration.
    pub by_id: Option<String>,
    /// What the USB device says of itself.
    pub usb: Option<UsbIdentity>,
    /// What is likely to be at its end, judged by the USB device alone.
    pub likely: Option<&'static str>,
}

/// What a USB device says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct UsbIdentity {
    /// Vendor's number.
    pub vendor: u16,
    /// Product's number, the vendor's choice.
    pub product: u16,
    /// Maker's name.
    pub maker: Option<String>,
    /// Product's name.
    pub name: Option<String>,
    /// Serial number.
    pub serial: Option<String>,
}

/// All serial ports that have a device behind them, by path. Empty where the system has no
/// `/sys` (there, name the port by its path).
#[must_use]
pub fn list_ports() -> Vec<PortInfo> {
    let names = names_by_id(Path::new("/dev/serial/by-id"));
    ports_in(Path::new("/sys/class/tty"), &names)
}

fn ports_in(class: &Path, names: &BTreeMap<PathBuf, String>) -> Vec<PortInfo> {
    let mut ports: Vec<_> = fs::read_dir(class)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let name = entry.file_name().into_string().ok()?;
            let device = entry.path().join("device").canonicalize().ok()?;
            let path = Path::new("/dev").join(name);
            is_present(&device, &entry.path()).then(|| describe(&path, &device, names))
        })
        .collect();
    ports.sort_by(|a, b| a.path.cmp(&b.path));
    ports
}

/// A PC's table of built-in ports has entries without a chip behind them: type 0.
fn is_present(device: &Path, entry: &Path) -> bool {
    let built_in = device.ends_with("serial8250") || entry.join("type").exists();
    !built_in || read(entry, "type").is_some_and(|kind| kind != "0")
}

fn describe(path: &Path, device: &Path, names: &BTreeMap<PathBuf, String>) -> PortInfo {
    let usb = device.ancestors().find_map(usb_identity);
    PortInfo {
        path: path.display().to_string(),
        by_id: names.get(path).cloned(),
        likely: usb.as_ref().and_then(likely),
        usb,
    }
}

/// The identity in a USB device's folder; `None` for any other folder.
fn usb_identity(folder: &Path) -> Option<UsbIdentity> {
    let number = |file| u16::from_str_radix(&read(folder, file)?, 16).ok();
    Some(UsbIdentity {
        vendor: number("idVendor")?,
        product: number("idProduct")?,
        maker: read(folder, "manufacturer"),
        name: read(folder, "product"),
        serial: read(folder, "serial"),
    })
}

fn read(folder: &Path, file: &str) -> Option<String> {
    let text = fs::read_to_string(folder.join(file)).ok()?;
    let text = text.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

/// What a USB device is likely to be. An adapter says nothing of what hangs on it.
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

/// Device paths and their names under a folder such as `/dev/serial/by-id`.
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
    names_by_id(Path::new("/dev/serial/by-id"))
        .remove(&real)
        .unwrap_or_else(|| path.display().to_string())
}

/// FTDI adapters hold bytes back for 16 ms unless told otherwise. Tells them; a warning if
/// that is not allowed.
pub(super) fn latency_warning(path: &Path) -> Option<String> {
    let real = path.canonicalize().ok()?;
    let timer = Path::new("/sys/class/tty")
        .join(real.file_name()?)
        .join("device/latency_timer");
    let millis: u32 = fs::read_to_string(&timer).ok()?.trim().parse().ok()?;
    if millis <= 1 || fs::write(&timer, "1").is_ok() {
        return None;
    }
    Some(format!(
        "its USB adapter holds bytes back for {millis} ms; install the udev rules (`sudo make \
         install`), or write 1 to {}",
        timer.display()
    ))
}

#[cfg(all(test, unix))]
mod tests;
