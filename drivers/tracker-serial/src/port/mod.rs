//! Serial ports and sockets: opening them, listing them, asking who is there.
//!
//! A [`Line`] is whatever bytes come and go through; [`LineTracker`] holds the dialogue
//! over it and is a [`Tracker`]. All of it blocks and belongs on a thread of its own.

mod group;
mod line;
mod list;
mod probe;
mod serial;
mod tracker;
mod udp;
mod vrpn;

pub use line::Line;
pub use list::{PortInfo, UsbIdentity, list_ports};
pub use probe::{Found, probe};
pub use serial::{SerialLine, SerialTracker};
pub use tracker::LineTracker;
pub use udp::{UdpLine, UdpTracker};
pub use vrpn::VrpnTracker;

use crate::settings::{PortName, TrackerSettings};
use crate::{Format, PROTOCOLS};
use penumbra_interface::{DeviceError, Tracker};

/// Opens a tracker, tells it its mode and sees that it streams. Blocks for a few seconds at
/// the longest.
///
/// # Errors
/// In one line what is wrong: no such port or protocol, no permission, busy, silent, another
/// protocol or speed. [`DeviceError::recovery`] says whether trying again may help.
pub fn open(settings: &TrackerSettings) -> Result<Box<dyn Tracker>, DeviceError> {
    let Some(format) = Format::for_protocol(&settings.protocol) else {
        return Err(refused(
            settings,
            format!(
                "{:?} is no tracker protocol; there are {}",
                settings.protocol,
                PROTOCOLS.join(", ")
            ),
        ));
    };
    match (&settings.port, format) {
        (PortName::Vrpn { tracker, host }, Format::Vrpn(_)) => {
            Ok(Box::new(VrpnTracker::open(settings, tracker, host)?))
        }
        (PortName::Vrpn { .. }, _) => Err(refused(
            settings,
            "a VRPN server speaks the protocol vrpn alone; set protocol = \"vrpn\"".to_owned(),
        )),
        (_, Format::Vrpn(_)) => Err(refused(
            settings,
            "the protocol vrpn needs a server; set port = \"vrpn:NAME@HOST\"".to_owned(),
        )),
        (PortName::Serial(name), _) => Ok(Box::new(SerialTracker::open(settings, name)?)),
        (PortName::Udp(address), _) => Ok(Box::new(UdpTracker::open(settings, *address)?)),
    }
}

fn refused(settings: &TrackerSettings, reason: String) -> DeviceError {
    DeviceError::Refused {
        device: settings.port.to_string(),
        reason,
    }
}
