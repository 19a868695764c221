//! Serial ports, and the trackers at their ends, for `penumbra devices`.

use penumbra_tracker_serial::{PortInfo, PortName, list_ports, probe};
use serde::Serialize;

/// A serial port and who answered there.
#[derive(Debug, Serialize)]
pub(super) struct SerialPort {
    /// `/dev/ttyUSB0`: changes with the order of plugging.
    path: String,
    /// Its name under `/dev/serial/by-id`, for the configuration.
    by_id: Option<String>,
    /// `vendor:product`, hexadecimal.
    usb: Option<String>,
    maker: Option<String>,
    product: Option<String>,
    serial: Option<String>,
    /// What is likely to be there, judged by the USB device alone.
    likely: Option<&'static str>,
    /// What asking found, if it was asked.
    #[serde(skip_serializing_if = "Option::is_none")]
    asked: Option<Asked>,
}

/// What came of asking at a port.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Asked {
    /// A tracker answered.
    Tracker {
        protocol: String,
        baud: Option<u32>,
        said: Option<String>,
    },
    /// Nobody, or nobody known.
    Nobody,
    /// The port could not be opened.
    Trouble(String),
}

/// All of them; `asking` who is there takes seconds a port.
pub(super) fn find(asking: bool) -> Vec<SerialPort> {
    let ports = list_ports().into_iter();
    ports.map(|port| described(port, asking)).collect()
}

fn described(port: PortInfo, asking: bool) -> SerialPort {
    let asked = asking.then(|| ask(&port.path));
    let usb = port.usb.unwrap_or_default();
    let ids = (usb.vendor, usb.product);
    SerialPort {
        path: port.path,
        by_id: port.by_id,
        usb: (ids != (0, 0)).then(|| format!("{:04x}:{:04x}", ids.0, ids.1)),
        maker: usb.maker,
        product: usb.name,
        serial: usb.serial,
        likely: port.likely,
        asked,
    }
}

fn ask(path: &str) -> Asked {
    match probe(&PortName::Serial(path.to_owned())) {
        Ok(Some(found)) => Asked::Tracker {
            protocol: found.protocol,
            baud: found.baud,
            said: found.said,
        },
        Ok(None) => Asked::Nobody,
        Err(error) => Asked::Trouble(error.to_string()),
    }
}

pub(super) fn in_words(ports: &[SerialPort]) -> String {
    if ports.is_empty() {
        return "serial ports: none; plug the tracker in (recorded sessions need none)".to_owned();
    }
    let lines: Vec<String> = ports.iter().map(line).collect();
    format!("serial ports\n{}", lines.join("\n"))
}

fn line(port: &SerialPort) -> String {
    let name = port.by_id.as_ref().unwrap_or(&port.path);
    let about = [&port.maker, &port.product, &port.usb];
    let mut words: Vec<String> = about.into_iter().flatten().cloned().collect();
    if port.by_id.is_some() {
        words.push(port.path.clone());
    }
    let about = if words.is_empty() {
        String::new()
    } else {
        format!(" ({})", words.join(", "))
    };
    let end = match (&port.asked, port.likely) {
        (
            Some(Asked::Tracker {
                protocol,
                baud,
                said,
            }),
            _,
        ) => {
            let baud = baud.map_or(String::new(), |baud| format!(" at {baud} baud"));
            let said = said
                .as_ref()
                .map_or(String::new(), |said| format!(": {said}"));
            format!("\n    tracker: {protocol}{baud}{said}")
        }
        (Some(Asked::Nobody), _) => "\n    no tracker answered".to_owned(),
        (Some(Asked::Trouble(reason)), _) => format!("\n    {reason}"),
        (None, Some(likely)) => format!("\n    probably {likely}; --probe checks"),
        (None, None) => String::new(),
    };
    format!("  {name}{about}{end}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter() -> SerialPort {
        SerialPort {
            path: "/dev/ttyUSB0".into(),
            by_id: Some("usb-FTDI_FT232R_A5-if00-port0".into()),
            usb: Some("0403:6001".into()),
            maker: Some("FTDI".into()),
            product: None,
            serial: Some("A5".into()),
            likely: None,
            asked: None,
        }
    }

    #[test]
    fn a_port_in_words() {
        assert!(in_words(&[]).starts_with("serial ports: none"));
        let mut port = adapter();
        assert_eq!(
            in_words(std::slice::from_ref(&port)),
            "serial ports\n  usb-FTDI_FT232R_A5-if00-port0 (FTDI, 0403:6001, /dev/ttyUSB0)"
        );
        port.asked = Some(Asked::Tracker {
            protocol: "fastrak".into(),
            baud: Some(115_200),
            said: Some("version 4.0".into()),
        });
        let text = in_words(&[port]);
        assert!(
            text.ends_with("\n    tracker: fastrak at 115200 baud: version 4.0"),
            "{text}"
        );
    }
}
