//! Simulated trackers: the device's side of every protocol.
//!
//! A [`SimulatedTracker`] is a state machine without I/O: commands in, answers and records
//! out, driven by a [`Trajectory`] or by bytes that were recorded. [`Pty`] is a serial port
//! that does not exist, at the other end of which a driver finds such a device. The records
//! are spelled here a second time, on purpose: what a decoder and a simulator have in
//! common, no test of one against the other can find wrong.

mod csv;
mod fastrak;
mod faults;
mod flock;
mod freed;
mod liberty;
#[cfg(unix)]
mod pty;
mod serve;
mod tracker;
mod trajectory;

pub use faults::{Faults, FaultsError};
#[cfg(unix)]
pub use pty::Pty;
pub use serve::{Outlet, UdpOutlet, serve};
pub use tracker::{Recording, SimulatedTracker, Source, UnknownProtocol};
pub use trajectory::{Trajectory, TrajectoryError};
