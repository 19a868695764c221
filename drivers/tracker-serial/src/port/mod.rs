//! Serial ports and sockets: listing, opening and probing them.
//!
//! A [`Line`] is an open port or socket. [`LineTracker`] starts the device on it and is a
//! [`Tracker`]. All of it blocks and belongs on a thread of its own.

mod access;
mod line;
mod line_settings;
mod list;
mod native;
mod open_port;
mod probe;
mod serial;
#[cfg(all(test, unix))]
mod testing;
mod tracker;
mod udp;
mod vrpn;

pub use line::Line;
pub use list::{PortInfo, UsbIdentity, list_ports};
pub use probe::{Found, probe};
pub use serial::{SerialLine, SerialTracker};
pub use serialport::Parity;
pub use tracker::LineTracker;
pub use udp::{UdpLine, UdpTracker};
pub use vrpn::VrpnTracker;

use crate::format::{Format, PROTOCOLS};
use crate::settings::{PortName, TrackerSettings};
use penumbra_interface::{DeviceError, Tracker};

/// Opens a tracker, configures it and waits until it streams. Blocks for a few seconds at most.
///
/// # Errors
/// The port or the protocol does not exist, the port is not permitted or in use, the device is
/// silent or sends another protocol. [`DeviceError::recovery`] tells whether to try again.
pub fn open(settings: &TrackerSettings) -> Result<Box<dyn Tracker>, DeviceError> {
    let Some(format) = Format::for_protocol(&settings.protocol) else {
        return Err(refused(
            settings,
            format!(
                "{:?} is no tracker protocol; the protocols are {}",
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
            "a VRPN server needs the protocol vrpn; set protocol = \"vrpn\"".to_owned(),
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
