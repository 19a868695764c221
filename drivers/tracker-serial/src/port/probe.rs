//! Asks a port what is at its end.

use super::line::Line;
use super::serial::SerialLine;
use super::udp::UdpLine;
use crate::fastrak::Status;
use crate::recognise::protocol_of;
use crate::settings::PortName;
use crate::{fastrak, liberty};
use penumbra_interface::{Clock, DeviceError, SystemClock};
use serial2::Parity;
use std::time::Duration;

/// Line speeds at which trackers are found, the likeliest first.
const BAUDS: [u32; 4] = [115_200, 38_400, 19_200, 9_600];
/// How long is listened for a device that sends of itself: the slowest are at 10 records a
/// second.
const LISTENING: Duration = Duration::from_millis(600);
const ANSWER: Duration = Duration::from_millis(300);
const ENOUGH: usize = 4096;

/// A tracker that answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Found {
    /// Its protocol, for the configuration.
    pub protocol: String,
    /// Line speed; `None` for datagrams.
    pub baud: Option<u32>,
    /// What it said of itself, if it did.
    pub said: Option<String>,
}

/// Listens at `port`, then asks as each protocol's owner would, at every plausible speed.
/// Takes up to six seconds. `None` if nobody is there, or nobody known.
///
/// Only what a device answers without changing its settings is asked: status and version.
///
/// # Errors
/// As for opening it.
pub fn probe(port: &PortName) -> Result<Option<Found>, DeviceError> {
    match port {
        PortName::Serial(name) => probe_serial(name),
        PortName::Udp(address) => {
            let heard = listen(&mut UdpLine::bind(*address)?, LISTENING)?;
            Ok(protocol_of(&heard).map(|protocol| found(protocol, None, None)))
        }
        // A server is asked by connecting to it.
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
    let heard = listen(line, LISTENING)?;
    if let Some(protocol) = protocol_of(&heard) {
        return Ok(Some(found(protocol, Some(baud), None)));
    }
    line.write(b"S")?;
    if let Some(status) = Status::find(&listen(line, ANSWER)?) {
        let encoding = if status.binary {
            "fastrak-binary-quaternion"
        } else {
            "fastrak"
        };
        let said = fastrak::commands::describe(&status).description;
        return Ok(Some(found(encoding, Some(baud), said)));
    }
    // Ends the FASTRAK's or whoever's half line, then asks a Liberty.
    line.write(b"\r\x16\r")?;
    if let Some(answer) = liberty::commands::identity(&listen(line, ANSWER)?) {
        return Ok(Some(found("liberty", Some(baud), answer.description)));
    }
    line.write(&[b'O', 1])?;
    let answer = listen(line, ANSWER)?;
    Ok(flock_version(&answer).map(|said| found("flock", Some(baud), Some(said))))
}

/// Two bytes, the first of them a small number: a Flock of Birds' software version.
fn flock_version(answer: &[u8]) -> Option<String> {
    match answer {
        [major @ 1..=9, minor] => Some(format!("Flock of Birds, software {major}.{minor}")),
        _ => None,
    }
}

fn found(protocol: &str, baud: Option<u32>, said: Option<String>) -> Found {
    Found {
        protocol: protocol.to_owned(),
        baud,
        said,
    }
}

/// Everything that comes for so long.
fn listen(line: &mut impl Line, duration: Duration) -> Result<Vec<u8>, DeviceError> {
    let until = SystemClock.now() + duration;
    let mut heard = Vec::new();
    let mut buffer = [0; 1024];
    loop {
        let left = until.nanos_since(SystemClock.now());
        let Ok(left @ 1..) = u64::try_from(left) else {
            return Ok(heard);
        };
        if let Some((count, _)) = line.read(&mut buffer, Duration::from_nanos(left))? {
            heard.extend_from_slice(&buffer[..count]);
        }
        if heard.len() > ENOUGH {
            return Ok(heard);
        }
    }
}
