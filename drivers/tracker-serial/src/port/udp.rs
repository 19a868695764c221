//! Trackers that send datagrams, as most FreeD units do today.

use super::line::Line;
use super::tracker::LineTracker;
use crate::settings::TrackerSettings;
use penumbra_interface::{Clock, DeviceError, MonotonicTime, SystemClock};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

/// A tracker that sends its datagrams to one of this machine's addresses.
pub type UdpTracker = LineTracker<UdpLine>;

impl UdpTracker {
    /// Listens at `address` and waits until two records have arrived.
    ///
    /// # Errors
    /// See [`open`](super::open).
    pub fn open(settings: &TrackerSettings, address: SocketAddr) -> Result<Self, DeviceError> {
        Self::start(UdpLine::bind(address)?, settings, format!("udp:{address}"))
    }
}

/// A bound socket.
#[derive(Debug)]
pub struct UdpLine {
    socket: UdpSocket,
    address: SocketAddr,
}

impl UdpLine {
    /// Listens at `address`.
    ///
    /// # Errors
    /// The address is in use, or is not one of this machine.
    pub fn bind(address: SocketAddr) -> Result<Self, DeviceError> {
        let socket = UdpSocket::bind(address).map_err(|error| {
            let device = format!("udp:{address}");
            match error.kind() {
                ErrorKind::AddrInUse => DeviceError::Unready {
                    device,
                    reason: "another program listens there; end it or choose another port"
                        .to_owned(),
                },
                ErrorKind::AddrNotAvailable => DeviceError::Unready {
                    device,
                    reason:
                        "this machine has no such address; 0.0.0.0 stands for all its addresses"
                            .to_owned(),
                },
                _ => DeviceError::Refused {
                    device,
                    reason: error.to_string(),
                },
            }
        })?;
        Ok(Self { socket, address })
    }

    fn failed(&self, error: &std::io::Error) -> DeviceError {
        DeviceError::Unready {
            device: format!("udp:{}", self.address),
            reason: error.to_string(),
        }
    }
}

impl Line for UdpLine {
    fn read(
        &mut self,
        buffer: &mut [u8],
        timeout: Duration,
    ) -> Result<Option<(usize, MonotonicTime)>, DeviceError> {
        // Zero would mean no time limit.
        let timeout = timeout.max(Duration::from_micros(1));
        let received = self
            .socket
            .set_read_timeout(Some(timeout))
            .and_then(|()| self.socket.recv_from(buffer));
        let arrived_at = SystemClock.now();
        match received {
            Ok((count, _)) if count > 0 => Ok(Some((count, arrived_at))),
            // An empty datagram.
            Ok(_) => Ok(None),
            Err(error) => match error.kind() {
                // Timeout, or a refusal of an earlier datagram.
                ErrorKind::WouldBlock
                | ErrorKind::TimedOut
                | ErrorKind::Interrupted
                | ErrorKind::ConnectionRefused
                | ErrorKind::ConnectionReset => Ok(None),
                _ => Err(self.failed(&error)),
            },
        }
    }

    fn write(&mut self, _bytes: &[u8]) -> Result<(), DeviceError> {
        // Units that send datagrams accept no commands.
        Ok(())
    }
}
