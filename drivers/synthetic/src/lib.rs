//! Simulated trackers: the device's side of every protocol.
//!
//! A [`SimulatedTracker`] is a state machine without I/O that takes commands and returns answers
//! and records. Its poses come from a [`Trajectory`], or it sends recorded bytes. [`serve`] runs
//! it at an [`Outlet`]: a [`Pty`], which a driver opens like a serial port, or a [`UdpOutlet`].
//! The simulators share no code with the decoders, because tests of one against the other could
//! not find errors in shared code.

mod csv;
mod fastrak;
mod faults;
mod flock;
mod freed;
mod liberty;
#[cfg(unix)]
mod pty;
mod receivers;
mod serve;
mod tracker;
mod trajectory;

pub use faults::{Faults, FaultsError};
#[cfg(unix)]
pub use pty::Pty;
pub use serve::{Outlet, UdpOutlet, serve};
pub use tracker::{Recording, SimulatedTracker, Source, UnknownProtocol};
pub use trajectory::{Trajectory, TrajectoryError};
