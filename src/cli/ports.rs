//! Serial ports and the trackers connected to them, for `penumbra devices`.

use penumbra_tracker_serial::{PortInfo, PortName, list_ports, probe};
use serde::Serialize;

/// A serial port, and the tracker found there.
#[derive(Debug, Serialize)]
pub(super) struct SerialPort {
    /// Path such as `/dev/ttyUSB0`; it depends on the order in which devices are connected.
    path: String,
    /// Its name under `/dev/serial/by-id`, for the configuration.
    by_id: Option<String>,
    /// `vendor:product`, hexadecimal.
    usb: Option<String>,
    maker: Option<String>,
    product: Option<String>,
    serial: Option<String>,
    /// The tracker that the USB device suggests.
    likely: Option<&'static str>,
    /// Result of probing; `None` if the port was not probed.
    #[serde(skip_serializing_if = "Option::is_none")]
    probe: Option<Probe>,
}

/// Result of probing a port for a tracker.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Probe {
    /// A tracker answered.
    Tracker {
        protocol: String,
        baud: Option<u32>,
        answer: Option<String>,
    },
    /// No answer, or an unknown one.
    NoTracker,
    /// The port could not be opened.
    Error(String),
}

/// Lists the serial ports. With `probing`, each is queried for a tracker, which takes seconds.
pub(super) fn find(probing: bool) -> Vec<SerialPort> {
    let ports = list_ports().into_iter();
    ports.map(|port| with_probe(port, probing)).collect()
}

fn with_probe(port: PortInfo, probing: bool) -> SerialPort {
    let probe = probing.then(|| probe_port(&port.path));
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
        probe,
    }
}

fn probe_port(path: &str) -> Probe {
    match probe(&PortName::Serial(path.to_owned())) {
        Ok(Some(found)) => Probe::Tracker {
            protocol: found.protocol,
            baud: found.baud,
            answer: found.description,
        },
        Ok(None) => Probe::NoTracker,
        Err(error) => Probe::Error(error.to_string()),
    }
}

pub(super) fn describe(ports: &[SerialPort]) -> String {
    if ports.is_empty() {
        return "serial ports: none; plug the tracker in (recorded sessions need none)".to_owned();
    }
    let lines: Vec<String> = ports.iter().map(describe_port).collect();
    format!("serial ports\n{}", lines.join("\n"))
}

fn describe_port(port: &SerialPort) -> String {
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
    let end = match (&port.probe, port.likely) {
        (
            Some(Probe::Tracker {
                protocol,
                baud,
                answer,
            }),
            _,
        ) => {
            let baud = baud.map_or(String::new(), |baud| format!(" at {baud} baud"));
            let answer = answer
                .as_ref()
                .map_or(String::new(), |answer| format!(": {answer}"));
            format!("\n    tracker: {protocol}{baud}{answer}")
        }
        (Some(Probe::NoTracker), _) => "\n    no tracker answered".to_owned(),
        (Some(Probe::Error(reason)), _) => format!("\n    {reason}"),
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
            probe: None,
        }
    }

    #[test]
    fn describes_a_port_and_its_tracker() {
        assert!(describe(&[]).starts_with("serial ports: none"));
        let mut port = adapter();
        assert_eq!(
            describe(std::slice::from_ref(&port)),
            "serial ports\n  usb-FTDI_FT232R_A5-if00-port0 (FTDI, 0403:6001, /dev/ttyUSB0)"
        );
        port.probe = Some(Probe::Tracker {
            protocol: "fastrak".into(),
            baud: Some(115_200),
            answer: Some("version 4.0".into()),
        });
        let text = describe(&[port]);
        assert!(
            text.ends_with("\n    tracker: fastrak at 115200 baud: version 4.0"),
            "{text}"
        );
    }
}
