//! Detects which tracker is connected to a port.

use super::line::Line;
use super::serial::SerialLine;
use super::udp::UdpLine;
use crate::fastrak::{self, Status};
use crate::liberty;
use crate::recognise::protocol_of;
use crate::settings::PortName;
use penumbra_interface::{Clock, DeviceError, SystemClock};
use serialport::Parity;
use std::time::Duration;

/// Baud rates of trackers, the most common first.
const BAUDS: [u32; 4] = [115_200, 38_400, 19_200, 9_600];
/// How long to listen for a device that streams already: the slowest send 10 records a second.
const LISTEN_TIME: Duration = Duration::from_millis(600);
/// How long to wait for an answer.
const ANSWER_TIMEOUT: Duration = Duration::from_millis(300);
/// Bytes that suffice to recognise a protocol.
const ENOUGH: usize = 4096;

/// A tracker that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Its protocol, for the configuration.
    pub protocol: String,
    /// Baud rate; `None` for datagrams.
    pub baud: Option<u32>,
    /// The device's description of itself, if it sent one.
    pub description: Option<String>,
}

/// Listens at `port`, then asks for the status or version of each kind of tracker, at every
/// common baud rate. Takes up to six seconds. `None` if no known tracker answers.
///
/// The questions do not change the settings of a device.
///
/// # Errors
/// The port cannot be opened, see [`open`](super::open).
pub fn probe(port: &PortName) -> Result<Option<Found>, DeviceError> {
    match port {
        PortName::Serial(name) => probe_serial(name),
        PortName::Udp(address) => {
            let received = listen(&mut UdpLine::bind(*address)?, LISTEN_TIME)?;
            Ok(protocol_of(&received).map(|protocol| found(protocol, None, None)))
        }
        // Connecting to a server identifies it.
        PortName::Vrpn { .. } => Ok(None),
    }
}

fn probe_serial(name: &str) -> Result<Option<Found>, DeviceError> {
    for baud in BAUDS {
        let mut line = SerialLine::open(name, baud, Parity::None)?;
        if let Some(found) = probe_at(&mut line, baud)? {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

fn probe_at(line: &mut impl Line, baud: u32) -> Result<Option<Found>, DeviceError> {
    let received = listen(line, LISTEN_TIME)?;
    if let Some(protocol) = protocol_of(&received) {
        return Ok(Some(found(protocol, Some(baud), None)));
    }
    line.write(b"S")?;
    if let Some(status) = Status::find(&listen(line, ANSWER_TIMEOUT)?) {
        let encoding = if status.binary {
            "fastrak-binary-quaternion"
        } else {
            "fastrak"
        };
        let description = fastrak::commands::describe(&status).description;
        return Ok(Some(found(encoding, Some(baud), description)));
    }
    // Ends a command line that another device may have begun, then asks a Liberty.
    line.write(b"\r\x16\r")?;
    if let Some(answer) = liberty::commands::identity(&listen(line, ANSWER_TIMEOUT)?) {
        return Ok(Some(found("liberty", Some(baud), answer.description)));
    }
    line.write(&[b'O', 1])?;
    let answer = listen(line, ANSWER_TIMEOUT)?;
    Ok(flock_version(&answer).map(|version| found("flock", Some(baud), Some(version))))
}

/// The software version of a Flock of Birds: two bytes, the first one small.
fn flock_version(answer: &[u8]) -> Option<String> {
    match answer {
        [major @ 1..=9, minor] => Some(format!("Flock of Birds, software {major}.{minor}")),
        _ => None,
    }
}

fn found(protocol: &str, baud: Option<u32>, description: Option<String>) -> Found {
    Found {
        protocol: protocol.to_owned(),
        baud,
        description,
    }
}

/// Returns the bytes that arrive within `duration`, or the first [`ENOUGH`] of them.
fn listen(line: &mut impl Line, duration: Duration) -> Result<Vec<u8>, DeviceError> {
    let until = SystemClock.now() + duration;
    let mut received = Vec::new();
    let mut buffer = [0; 1024];
    loop {
        let left = until.nanos_since(SystemClock.now());
        let Ok(left @ 1..) = u64::try_from(left) else {
            return Ok(received);
        };
        if let Some((count, _)) = line.read(&mut buffer, Duration::from_nanos(left))? {
            received.extend_from_slice(&buffer[..count]);
        }
        if received.len() > ENOUGH {
            return Ok(received);
        }
    }
}
