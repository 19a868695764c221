//! The settings with which a tracker is opened: plain data.

use crate::units::{METRES_PER_CENTIMETRE, METRES_PER_INCH};
use std::fmt;
use std::net::SocketAddr;

/// Settings of a tracker.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackerSettings {
    /// One of [`PROTOCOLS`](crate::PROTOCOLS).
    pub protocol: String,
    /// Where the tracker is connected.
    pub port: PortName,
    /// Baud rate; `None` for the protocol's default, see [`default_baud`].
    pub baud: Option<u32>,
    /// Receivers to switch on, numbered from 1. The others are switched off where the device
    /// can do that.
    pub stations: Vec<u8>,
    /// The hemisphere in which the receivers are.
    pub hemisphere: Hemisphere,
    /// The unit of length that the device is set to.
    pub units: Units,
    /// A streaming device that sends nothing for this long counts as silent, milliseconds. It
    /// is then opened and configured again, because it may have been switched off and on.
    pub silence_millis: u64,
}

impl TrackerSettings {
    /// The default settings of `protocol` at `port`: one receiver, forward hemisphere,
    /// centimetres, 1 s of silence.
    #[must_use]
    pub fn new(protocol: &str, port: PortName) -> Self {
        Self {
            protocol: protocol.to_owned(),
            port,
            baud: None,
            stations: vec![1],
            hemisphere: Hemisphere::Forward,
            units: Units::Centimetres,
            silence_millis: 1000,
        }
    }

    /// The baud rate to use.
    #[must_use]
    pub fn baud(&self) -> u32 {
        self.baud.unwrap_or_else(|| default_baud(&self.protocol))
    }
}

/// The default baud rate of a protocol.
///
/// A FASTRAK needs 115200 to send text at its full 120 records a second (54 bytes of ten bits
/// each); FreeD's manual specifies 38400.
#[must_use]
pub fn default_baud(protocol: &str) -> u32 {
    if protocol.starts_with("freed") {
        38_400
    } else {
        115_200
    }
}

/// Where a tracker is connected.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum PortName {
    /// A serial port: a path, or a name under `/dev/serial/by-id`.
    Serial(String),
    /// UDP datagrams that arrive at this address.
    Udp(SocketAddr),
    /// A tracker of a VRPN server.
    Vrpn {
        /// The tracker's name at the server: `Tracker0`.
        tracker: String,
        /// The server, with its port.
        host: String,
    },
}

/// TCP port of VRPN servers (IANA).
const VRPN_PORT: u16 = 3883;

impl PortName {
    /// Parses `/dev/ttyUSB0`, a name under `/dev/serial/by-id`, `udp:0.0.0.0:40000`,
    /// `vrpn:Tracker0@host` or `vrpn:Tracker0@host:3883`.
    ///
    /// # Errors
    /// The text is malformed; the error is one line that names the expected form.
    pub fn parse(text: &str) -> Result<Self, String> {
        if let Some(address) = text.strip_prefix("udp:") {
            let address = address.parse();
            return address.map(Self::Udp).map_err(|_| {
                format!("{text:?} is no address; write udp:ADDRESS:PORT, as in udp:0.0.0.0:40000")
            });
        }
        let Some(name) = text.strip_prefix("vrpn:") else {
            return Self::serial(text);
        };
        match name.split_once('@') {
            Some((tracker, host)) if !tracker.is_empty() && !host.is_empty() => Ok(Self::Vrpn {
                tracker: tracker.to_owned(),
                host: with_port(host),
            }),
            _ => Err(format!(
                "{text:?} names no tracker of a server; write vrpn:NAME@HOST, as in \
                 vrpn:Tracker0@localhost"
            )),
        }
    }

    fn serial(text: &str) -> Result<Self, String> {
        if text.trim().is_empty() {
            Err("the port is empty; write a path such as /dev/ttyUSB0".to_owned())
        } else {
            Ok(Self::Serial(text.to_owned()))
        }
    }
}

/// Appends the standard port to `host`, `1.2.3.4` or `[::1]` if it has none.
fn with_port(host: &str) -> String {
    let after_bracket = host.rsplit(']').next().unwrap_or(host);
    if after_bracket.contains(':') {
        host.to_owned()
    } else {
        format!("{host}:{VRPN_PORT}")
    }
}

impl fmt::Display for PortName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(path) => f.write_str(path),
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::Vrpn { tracker, host } => write!(f, "vrpn:{tracker}@{host}"),
        }
    }
}

/// The hemisphere around the transmitter in which the receivers stay. A magnetic tracker cannot
/// distinguish a point from its mirror image: with the wrong hemisphere, the signs of positions
/// are inverted, and the device reports no error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Hemisphere {
    /// +X, the factory setting.
    #[default]
    Forward,
    /// −X.
    Back,
    /// +Y.
    Right,
    /// −Y.
    Left,
    /// +Z, which points down.
    Lower,
    /// −Z.
    Upper,
}

impl Hemisphere {
    /// The axis that points into the hemisphere.
    #[must_use]
    pub const fn axis(self) -> [i8; 3] {
        match self {
            Self::Forward => [1, 0, 0],
            Self::Back => [-1, 0, 0],
            Self::Right => [0, 1, 0],
            Self::Left => [0, -1, 0],
            Self::Lower => [0, 0, 1],
            Self::Upper => [0, 0, -1],
        }
    }
}

/// The unit of length of a Polhemus tracker. It must be the unit of the rig calibration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Units {
    /// 0.0254 m.
    Inches,
    /// 0.01 m.
    #[default]
    Centimetres,
}

impl Units {
    /// Metres in one unit.
    #[must_use]
    pub const fn metres(self) -> f64 {
        match self {
            Self::Inches => METRES_PER_INCH,
            Self::Centimetres => METRES_PER_CENTIMETRE,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printed_ports_parse_to_the_same_port() {
        for text in [
            "/dev/ttyUSB0",
            "usb-FTDI_X",
            "udp:127.0.0.1:40000",
            "vrpn:T0@host:99",
        ] {
            assert_eq!(PortName::parse(text).unwrap().to_string(), text);
        }
        for (text, full) in [
            ("vrpn:T@host", "vrpn:T@host:3883"),
            ("vrpn:T@[::1]", "vrpn:T@[::1]:3883"),
            ("vrpn:T@[::1]:5", "vrpn:T@[::1]:5"),
        ] {
            assert_eq!(PortName::parse(text).unwrap().to_string(), full);
        }
    }

    #[test]
    fn errors_name_the_expected_form() {
        for (text, hint) in [
            ("udp:host", "udp:0.0.0.0:40000"),
            ("vrpn:Tracker0", "vrpn:NAME@HOST"),
            ("vrpn:@host", "vrpn:NAME@HOST"),
            ("", "/dev/ttyUSB0"),
        ] {
            assert!(PortName::parse(text).unwrap_err().contains(hint), "{text}");
        }
    }
}
