//! Cameras by names that survive replugging.

use crate::video::Capabilities;
use penumbra_interface::{DeviceError, UsbIdentity};
use std::fs;
use std::path::{Path, PathBuf};

/// Where the system keeps devices: `/dev` and `/sys`, or a test's imitation.
#[derive(Clone, Debug)]
pub(crate) struct Roots {
    pub dev: PathBuf,
    pub sys: PathBuf,
}

impl Default for Roots {
    fn default() -> Self {
        Self {
            dev: "/dev".into(),
            sys: "/sys".into(),
        }
    }
}

/// One video device file and what is known of it without opening it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Place {
    pub node: PathBuf,
    /// The driver's number among the nodes of one device; a camera's pictures come from 0,
    /// its metadata from 1.
    pub index: u32,
    pub name: String,
    pub by_id: Option<String>,
    pub by_path: Option<String>,
    pub usb: Option<UsbIdentity>,
}

impl Place {
    /// The name to write into settings; `bus` is what the driver says, if it was asked.
    pub(crate) fn identity(&self, bus: Option<&str>) -> String {
        if let Some(by_id) = &self.by_id {
            return by_id.clone();
        }
        match (&self.usb, &self.by_path, bus) {
            (Some(usb), _, _) if usb.serial.is_some() => usb_name(usb),
            (_, Some(by_path), _) => by_path.clone(),
            (Some(usb), None, _) => usb_name(usb),
            (None, None, Some(bus)) if !bus.is_empty() => format!("bus:{bus}"),
            _ => self.node.display().to_string(),
        }
    }
}

/// The own name and the serial number of the camera that calls itself `identity`
/// ([`penumbra_interface::CameraReport::identity`]), as the system knows them without opening it.
#[must_use]
pub fn name_and_serial(identity: &str) -> Option<(String, Option<String>)> {
    known_as(identity, &Roots::default())
}

fn known_as(identity: &str, roots: &Roots) -> Option<(String, Option<String>)> {
    let mut places = all(roots).into_iter();
    let place = places.find(|place| place.identity(None) == identity)?;
    let serial = place.usb.and_then(|usb| usb.serial);
    (!place.name.is_empty()).then_some((place.name, serial))
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

/// All video device files, in the order of their numbers.
pub(crate) fn all(roots: &Roots) -> Vec<Place> {
    let (by_id, by_path) = (links(roots, "by-id"), links(roots, "by-path"));
    let named = |names: &[(String, String)], node: &str, usb: Option<&UsbIdentity>| {
        let mut names = names.iter().filter(|(_, target)| target == node);
        let found = names.find(|(name, _)| usb.is_none_or(|usb| may_be(name, usb)))?;
        Some(found.0.clone())
    };
    let mut numbered: Vec<(u32, Place)> = names_in(&roots.dev)
        .filter_map(|name| {
            let number: u32 = name.strip_prefix("video")?.parse().ok()?;
            let class = roots.sys.join("class/video4linux").join(&name);
            let usb = usb(&class);
            let place = Place {
                node: roots.dev.join(&name),
                index: line(&class.join("index"))
                    .and_then(|n| n.parse().ok())
                    .unwrap_or(0),
                name: line(&class.join("name")).unwrap_or_default(),
                by_id: named(&by_id, &name, usb.as_ref()),
                by_path: named(&by_path, &name, None),
                usb,
            };
            Some((number, place))
        })
        .collect();
    numbered.sort_by_key(|(number, _)| *number);
    numbered.into_iter().map(|(_, place)| place).collect()
}

/// Whether a name under `by-id` may be that of this USB device, by its serial number.
///
/// The kernel gives a number that has become free to the next camera at once, and udev
/// renews the links a little later: until then a link may lead to another camera.
fn may_be(by_id: &str, usb: &UsbIdentity) -> bool {
    // udev replaces some characters, and leaves a serial number out that has worse ones.
    let replaced =
        |text: &str| -> String { text.chars().filter(char::is_ascii_alphanumeric).collect() };
    let is_odd = |c: char| c == ',' || !(c == ' ' || c.is_ascii_graphic());
    let serial = usb
        .serial
        .as_deref()
        .filter(|serial| !serial.contains(is_odd));
    serial.is_none_or(|serial| replaced(by_id).contains(&replaced(serial)))
}

fn names_in(folder: &Path) -> impl Iterator<Item = String> {
    let entries = fs::read_dir(folder).into_iter().flatten();
    entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok())
}

/// Names under `/dev/v4l/KIND` and the device files that they stand for, by name.
fn links(roots: &Roots, kind: &str) -> Vec<(String, String)> {
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

/// First line of a file of sysfs.
fn line(path: &Path) -> Option<String> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().next()?.trim();
    (!line.is_empty()).then(|| line.to_owned())
}

/// The USB device above an interface in sysfs.
fn usb(class: &Path) -> Option<UsbIdentity> {
    let device = fs::canonicalize(class.join("device")).ok()?;
    let above = device
        .ancestors()
        .find(|folder| folder.join("idVendor").is_file())?;
    Some(UsbIdentity {
        vendor: line(&above.join("idVendor"))?,
        product: line(&above.join("idProduct"))?,
        serial: line(&above.join("serial")),
    })
}

/// The device file that a setting names. `probe` opens a device file and asks its driver.
///
/// # Errors
/// No such camera, or several.
pub(crate) fn resolve(
    device: &str,
    roots: &Roots,
    probe: impl Fn(&Path) -> Option<Capabilities>,
) -> Result<Place, DeviceError> {
    let places = all(roots);
    let missing = || DeviceError::NotFound {
        device: if device.is_empty() {
            "any camera"
        } else {
            device
        }
        .to_owned(),
    };
    if device.starts_with('/') {
        let node = fs::canonicalize(device).map_err(|_| missing())?;
        let known = places.into_iter().find(|place| place.node == node);
        if let Some(usb) = known.as_ref().and_then(|place| place.usb.as_ref())
            && let Ok(name) = Path::new(device).strip_prefix(roots.dev.join("v4l/by-id"))
            && !may_be(&name.to_string_lossy(), usb)
        {
            return Err(missing());
        }
        return Ok(known.unwrap_or(Place {
            node,
            ..Place::default()
        }));
    }
    let captures = |place: &Place| probe(&place.node).is_some_and(|c| c.captures || c.multiplanar);
    let first = places.iter().filter(|place| place.index == 0);
    let found: Vec<&Place> = if device.is_empty() {
        first.filter(|place| captures(place)).collect()
    } else if let Some(usb) = device.strip_prefix("usb:") {
        let wanted = parse_usb(device, usb)?;
        first
            .filter(|place| place.usb.as_ref().is_some_and(|usb| is_usb(usb, &wanted)))
            .collect()
    } else if let Some(bus) = device.strip_prefix("bus:") {
        let on_bus = |place: &&Place| probe(&place.node).is_some_and(|c| c.bus == bus);
        first
            .filter(on_bus)
            .filter(|place| captures(place))
            .collect()
    } else {
        places
            .iter()
            .filter(|place| is_named(place, device))
            .take(1)
            .collect()
    };
    match found.as_slice() {
        [] => Err(missing()),
        [one] => Ok((*one).clone()),
        several => Err(ambiguous(device, several)),
    }
}

fn is_named(place: &Place, name: &str) -> bool {
    let is = |known: &Option<String>| {
        let known = known.as_deref();
        known
            .is_some_and(|known| known == name || known.strip_suffix("-video-index0") == Some(name))
    };
    is(&place.by_id) || is(&place.by_path)
}

fn ambiguous(device: &str, several: &[&Place]) -> DeviceError {
    let names: Vec<String> = several
        .iter()
        .map(|place| match &place.by_path {
            Some(by_path) => by_path.clone(),
            None => place.identity(None),
        })
        .collect();
    DeviceError::Refused {
        device: if device.is_empty() { "camera" } else { device }.to_owned(),
        reason: format!("several cameras fit; name one of: {}", names.join(", ")),
    }
}

fn is_usb(usb: &UsbIdentity, wanted: &UsbIdentity) -> bool {
    let same = |a: &str, b: &str| a.eq_ignore_ascii_case(b);
    same(&usb.vendor, &wanted.vendor)
        && same(&usb.product, &wanted.product)
        && (wanted.serial.is_none() || wanted.serial == usb.serial)
}

/// `VID:PID[:SERIAL]`; a serial number may hold colons itself.
fn parse_usb(device: &str, text: &str) -> Result<UsbIdentity, DeviceError> {
    let mut parts = text.splitn(3, ':').map(str::to_owned);
    let hex = |part: &String| part.len() == 4 && part.bytes().all(|b| b.is_ascii_hexdigit());
    match (parts.next().filter(hex), parts.next().filter(hex)) {
        (Some(vendor), Some(product)) => Ok(UsbIdentity {
            vendor,
            product,
            serial: parts.next().filter(|serial| !serial.is_empty()),
        }),
        _ => Err(DeviceError::Refused {
            device: device.to_owned(),
            reason: "write usb:VID:PID or usb:VID:PID:SERIAL with four hexadecimal digits \
                     each, as lsusb prints them"
                .to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests;
