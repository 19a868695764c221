//! Lets a simulated tracker be one, in time.

use crate::{Faults, SimulatedTracker};
use penumbra_interface::{Clock, MonotonicTime};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How long a command may wait for its answer, and `stop` for being seen.
const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// Where a device's bytes go and commands come from.
pub trait Outlet {
    /// Waits up to `timeout` for commands; 0 if none came.
    ///
    /// # Errors
    /// What the operating system says.
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Writes all of `bytes`, or loses them where nobody takes them.
    ///
    /// # Errors
    /// What the operating system says.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// Answers and streams on the caller's thread until `stop` is set or the faults say to hang
/// up.
///
/// # Errors
/// What the outlet says.
pub fn serve(
    device: &mut SimulatedTracker,
    outlet: &mut impl Outlet,
    faults: &mut Faults,
    clock: &impl Clock,
    stop: &AtomicBool,
) -> io::Result<()> {
    let began = clock.now();
    let mut out = Vec::new();
    let mut commands = [0; 512];
    while !stop.load(Ordering::Relaxed) {
        let count = outlet.read(&mut commands, until_due(device, clock.now()))?;
        let now = clock.now();
        out.clear();
        device.receive(commands.get(..count).unwrap_or_default(), now, &mut out);
        device.advance(now, &mut out);
        let past = |limit: Option<f64>| limit.is_some_and(|limit| now.seconds_since(began) > limit);
        if past(faults.hang_up_after) {
            return Ok(());
        }
        if !past(faults.silent_after) {
            deliver(&mut out, outlet, faults)?;
        }
    }
    Ok(())
}

fn until_due(device: &SimulatedTracker, now: MonotonicTime) -> Duration {
    let nanos = device.next_due().map(|due| due.nanos_since(now).max(0));
    nanos.map_or(LONGEST_WAIT, |nanos| {
        Duration::from_nanos(nanos.unsigned_abs()).min(LONGEST_WAIT)
    })
}

fn deliver(out: &mut Vec<u8>, outlet: &mut impl Outlet, faults: &mut Faults) -> io::Result<()> {
    faults.damage(out);
    let mut rest = out.as_slice();
    while !rest.is_empty() {
        let (piece, later) = rest.split_at(faults.piece(rest.len()));
        outlet.write(piece)?;
        rest = later;
    }
    Ok(())
}

/// A device that sends datagrams and hears nothing.
#[derive(Debug)]
pub struct UdpOutlet {
    socket: UdpSocket,
}

impl UdpOutlet {
    /// A sender to `receiver`.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn new(receiver: SocketAddr) -> io::Result<Self> {
        let any: SocketAddr = if receiver.is_ipv4() {
            ([0, 0, 0, 0], 0).into()
        } else {
            ([0; 8], 0).into()
        };
        let socket = UdpSocket::bind(any)?;
        socket.connect(receiver)?;
        Ok(Self { socket })
    }
}

impl Outlet for UdpOutlet {
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        // Zero would mean to wait for ever.
        let timeout = timeout.max(Duration::from_micros(1));
        self.socket.set_read_timeout(Some(timeout))?;
        match self.socket.recv(buffer) {
            // Somebody's answer is no command; a refusal only says that nobody listens yet.
            Ok(_) | Err(_) => Ok(0),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self.socket.send(bytes) {
            Err(error) if error.kind() != io::ErrorKind::ConnectionRefused => Err(error),
            _ => Ok(()),
        }
    }
}
