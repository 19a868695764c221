//! Finds cameras by names that survive unplugging.

use crate::device::Capabilities;
use crate::error::refused;
use penumbra_interface::{DeviceError, UsbIdentity};
use std::fs;
use std::path::{Path, PathBuf};

/// The system's folders of devices; tests use copies.
#[derive(Clone, Debug)]
pub(crate) struct SystemRoots {
    pub dev: PathBuf,
    pub sys: PathBuf,
}

impl Default for SystemRoots {
    fn default() -> Self {
        Self {
            dev: "/dev".into(),
            sys: "/sys".into(),
        }
    }
}

/// A video device file and its properties in sysfs and udev.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct DeviceNode {
    pub path: PathBuf,
    /// The driver's number among the nodes of one device. A camera's pictures come from node 0,
    /// its metadata from node 1.
    pub index: u32,
    pub name: String,
    pub by_id: Option<String>,
    pub by_path: Option<String>,
    pub usb: Option<UsbIdentity>,
}

impl DeviceNode {
    /// The most durable name for the settings. `bus` is what the driver reports, if it was
    /// asked.
    pub(crate) fn identity(&self, bus: Option<&str>) -> String {
        if let Some(by_id) = &self.by_id {
            return by_id.clone();
        }
        match (&self.usb, &self.by_path, bus) {
            (Some(usb), _, _) if usb.serial.is_some() => usb_name(usb),
            (_, Some(by_path), _) => by_path.clone(),
            (Some(usb), None, _) => usb_name(usb),
            (None, None, Some(bus)) if !bus.is_empty() => format!("bus:{bus}"),
            _ => self.path.display().to_string(),
        }
    }
}

/// The product name and the serial number of the camera with this identity
/// ([`penumbra_interface::CameraReport::identity`]), from sysfs. The camera is not opened.
#[must_use]
pub fn name_and_serial(identity: &str) -> Option<(String, Option<String>)> {
    name_and_serial_in(identity, &SystemRoots::default())
}

fn name_and_serial_in(identity: &str, roots: &SystemRoots) -> Option<(String, Option<String>)> {
    let mut nodes = all(roots).into_iter();
    let node = nodes.find(|node| node.identity(None) == identity)?;
    let serial = node.usb.and_then(|usb| usb.serial);
    (!node.name.is_empty()).then_some((node.name, serial))
}

fn usb_name(usb: &UsbIdentity) -> String {
    let serial = usb.serial.as_ref().map(|serial| format!(":{serial}"));
    format!(
        "usb:{}:{}{}",
        usb.vendor,
        usb.product,
        serial.unwrap_or_default()
    )
}

/// All video device files, ordered by their numbers.
pub(crate) fn all(roots: &SystemRoots) -> Vec<DeviceNode> {
    let (by_id, by_path) = (links(roots, "by-id"), links(roots, "by-path"));
    let link_to = |links: &[(String, String)], file: &str, usb: Option<&UsbIdentity>| {
        let mut names = links.iter().filter(|(_, target)| target == file);
        let found = names.find(|(name, _)| usb.is_none_or(|usb| matches_serial(name, usb)))?;
        Some(found.0.clone())
    };
    let mut numbered: Vec<(u32, DeviceNode)> = names_in(&roots.dev)
        .filter_map(|file| {
            let number: u32 = file.strip_prefix("video")?.parse().ok()?;
            let class = roots.sys.join("class/video4linux").join(&file);
            let usb = usb(&class);
            let index = first_line(&class.join("index")).and_then(|line| line.parse().ok());
            let node = DeviceNode {
                path: roots.dev.join(&file),
                index: index.unwrap_or(0),
                name: first_line(&class.join("name")).unwrap_or_default(),
                by_id: link_to(&by_id, &file, usb.as_ref()),
                by_path: link_to(&by_path, &file, None),
                usb,
            };
            Some((number, node))
        })
        .collect();
    numbered.sort_by_key(|(number, _)| *number);
    numbered.into_iter().map(|(_, node)| node).collect()
}

/// Whether the serial number of a USB device allows a name under `by-id` to be its name.
///
/// When a camera is unplugged, the kernel gives its number to the next camera at once, and
/// udev updates the links a little later. Until then a link may lead to another camera.
fn matches_serial(by_id: &str, usb: &UsbIdentity) -> bool {
    // udev replaces some characters of a serial number, and omits the whole number if it
    // contains others.
    let letters =
        |text: &str| -> String { text.chars().filter(char::is_ascii_alphanumeric).collect() };
    let causes_omission = |c: char| c == ',' || !(c == ' ' || c.is_ascii_graphic());
    let serial = usb.serial.as_deref();
    let serial = serial.filter(|serial| !serial.contains(causes_omission));
    serial.is_none_or(|serial| letters(by_id).contains(&letters(serial)))
}

fn names_in(folder: &Path) -> impl Iterator<Item = String> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok())
}

/// The links under `/dev/v4l/KIND`, in alphabetical order, and the device files they lead to.
fn links(roots: &SystemRoots, kind: &str) -> Vec<(String, String)> {
    let folder = roots.dev.join("v4l").join(kind);
    let mut links: Vec<(String, String)> = names_in(&folder)
        .filter_map(|name| {
            let target = fs::read_link(folder.join(&name)).ok()?;
            Some((name, target.file_name()?.to_str()?.to_owned()))
        })
        .collect();
    links.sort();
    links
}

/// The first line of a sysfs file, if it is not empty.
fn first_line(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().next()?.trim();
    (!line.is_empty()).then(|| line.to_owned())
}

/// The USB device that a video device belongs to.
fn usb(class: &Path) -> Option<UsbIdentity> {
    let interface = fs::canonicalize(class.join("device")).ok()?;
    let device = interface
        .ancestors()
        .find(|folder| folder.join("idVendor").is_file())?;
    Some(UsbIdentity {
        vendor: first_line(&device.join("idVendor"))?,
        product: first_line(&device.join("idProduct"))?,
        serial: first_line(&device.join("serial")),
    })
}

/// Finds the device node that the settings name. `probe` opens a device file and asks its
/// driver.
///
/// # Errors
/// There is no such camera, there are several, or the name is malformed.
pub(crate) fn resolve(
    device: &str,
    roots: &SystemRoots,
    probe: impl Fn(&Path) -> Option<Capabilities>,
) -> Result<DeviceNode, DeviceError> {
    let nodes = all(roots);
    if device.starts_with('/') {
        return resolve_path(device, roots, nodes);
    }
    let captures =
        |node: &DeviceNode| probe(&node.path).is_some_and(|c| c.captures || c.multiplanar);
    let first_nodes = nodes.iter().filter(|node| node.index == 0);
    let found: Vec<&DeviceNode> = if device.is_empty() {
        first_nodes.filter(|node| captures(node)).collect()
    } else if let Some(usb) = device.strip_prefix("usb:") {
        let wanted = parse_usb(device, usb)?;
        let is_wanted = |usb: &UsbIdentity| is_usb(usb, &wanted);
        first_nodes
            .filter(|node| node.usb.as_ref().is_some_and(is_wanted))
            .collect()
    } else if let Some(bus) = device.strip_prefix("bus:") {
        let on_bus = |node: &DeviceNode| probe(&node.path).is_some_and(|c| c.bus == bus);
        first_nodes
            .filter(|node| on_bus(node) && captures(node))
            .collect()
    } else {
        // A link names one node, with any index.
        nodes
            .iter()
            .find(|node| is_link_to(node, device))
            .into_iter()
            .collect()
    };
    match found.as_slice() {
        [] => Err(not_found(device)),
        [one] => Ok((*one).clone()),
        several => Err(ambiguous(device, several)),
    }
}

fn resolve_path(
    device: &str,
    roots: &SystemRoots,
    nodes: Vec<DeviceNode>,
) -> Result<DeviceNode, DeviceError> {
    let path = fs::canonicalize(device).map_err(|_| not_found(device))?;
    let known = nodes.into_iter().find(|node| node.path == path);
    if let Some(usb) = known.as_ref().and_then(|node| node.usb.as_ref())
        && let Ok(name) = Path::new(device).strip_prefix(roots.dev.join("v4l/by-id"))
        && !matches_serial(&name.to_string_lossy(), usb)
    {
        return Err(not_found(device));
    }
    Ok(known.unwrap_or(DeviceNode {
        path,
        ..DeviceNode::default()
    }))
}

fn not_found(device: &str) -> DeviceError {
    let device = if device.is_empty() {
        "any camera"
    } else {
        device
    };
    DeviceError::NotFound {
        device: device.to_owned(),
    }
}

/// Whether a link leads to the node; the ending `-video-index0` may be omitted.
fn is_link_to(node: &DeviceNode, name: &str) -> bool {
    let mut links = node.by_id.iter().chain(&node.by_path);
    links.any(|link| link == name || link.strip_suffix("-video-index0") == Some(name))
}

fn ambiguous(device: &str, several: &[&DeviceNode]) -> DeviceError {
    let names: Vec<String> = several
        .iter()
        .map(|node| match &node.by_path {
            Some(by_path) => by_path.clone(),
            None => node.identity(None),
        })
        .collect();
    let device = if device.is_empty() { "camera" } else { device };
    let names = names.join(", ");
    refused(
        device,
        format!("several cameras match; name one of: {names}"),
    )
}

fn is_usb(usb: &UsbIdentity, wanted: &UsbIdentity) -> bool {
    let same = |a: &str, b: &str| a.eq_ignore_ascii_case(b);
    same(&usb.vendor, &wanted.vendor)
        && same(&usb.product, &wanted.product)
        && (wanted.serial.is_none() || wanted.serial == usb.serial)
}

/// Parses `VID:PID[:SERIAL]`; a serial number may contain colons.
fn parse_usb(device: &str, text: &str) -> Result<UsbIdentity, DeviceError> {
    let mut parts = text.splitn(3, ':').map(str::to_owned);
    let is_id = |part: &String| part.len() == 4 && part.bytes().all(|b| b.is_ascii_hexdigit());
    match (parts.next().filter(is_id), parts.next().filter(is_id)) {
        (Some(vendor), Some(product)) => Ok(UsbIdentity {
            vendor,
            product,
            serial: parts.next().filter(|serial| !serial.is_empty()),
        }),
        _ => Err(refused(
            device,
            "write usb:VID:PID or usb:VID:PID:SERIAL with four hexadecimal digits each, as lsusb \
             prints them",
        )),
    }
}

#[cfg(test)]
mod tests;
