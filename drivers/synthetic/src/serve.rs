//! Runs a simulated tracker in real time.

use crate::faults::Faults;
use crate::tracker::SimulatedTracker;
use penumbra_interface::{Clock, MonotonicTime};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Maximum wait before `stop` is checked again.
const MAX_WAIT: Duration = Duration::from_millis(50);

/// A connection to a driver.
pub trait Outlet {
    /// Waits up to `timeout` for commands and reads them into `buffer`; returns their length in
    /// bytes, 0 if there are none.
    ///
    /// # Errors
    /// The operating system reports a failed read.
    fn read(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize>;

    /// Writes all of `bytes`, or loses them if no driver reads.
    ///
    /// # Errors
    /// The operating system reports a failed write.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// Answers and streams on the calling thread until `stop` is set or the time to hang up is
/// reached.
///
/// # Errors
/// The outlet fails.
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
    nanos.map_or(MAX_WAIT, |nanos| {
        Duration::from_nanos(nanos.unsigned_abs()).min(MAX_WAIT)
    })
}

fn deliver(out: &mut Vec<u8>, outlet: &mut impl Outlet, faults: &mut Faults) -> io::Result<()> {
    faults.damage(out);
    let mut rest = out.as_slice();
    while !rest.is_empty() {
        let (chunk, later) = rest.split_at(faults.write_len(rest.len()));
        outlet.write(chunk)?;
        rest = later;
    }
    Ok(())
}

/// Sends datagrams and receives no commands.
#[derive(Debug)]
pub struct UdpOutlet {
    socket: UdpSocket,
}

impl UdpOutlet {
    /// Creates a sender to `receiver`.
    ///
    /// # Errors
    /// The operating system provides no socket or no route to the receiver.
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
        // Zero would mean no time limit.
        let timeout = timeout.max(Duration::from_micros(1));
        self.socket.set_read_timeout(Some(timeout))?;
        match self.socket.recv(buffer) {
            // Datagrams are not commands, and a refusal means that there is no receiver yet.
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
