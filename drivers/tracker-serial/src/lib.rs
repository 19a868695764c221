//! Drivers for serial and network 6-DOF trackers.
//!
//! Each protocol is a module without I/O: [`fastrak`], [`liberty`], [`flock`], [`freed`],
//! [`csv`], [`vrpn`]. It defines the layout of its records ([`Framing`]) and the commands that
//! start a device. [`Decoder`], the same for all, takes bytes as they arrive, split anywhere,
//! and returns [`PoseSample`](penumbra_interface::PoseSample)s. It reads no clock and allocates
//! nothing per record, so a recorded stream decodes exactly as the live one; at bytes that are
//! no record it slides on by one byte. [`Dialogue`] starts a device, also without I/O. [`port`]
//! opens serial ports and sockets and is the only part that blocks.

pub mod csv;
mod decoder;
pub mod dialogue;
pub mod fastrak;
pub mod flock;
mod format;
mod framing;
pub mod freed;
pub mod liberty;
mod plausible;
pub mod port;
pub mod recognise;
pub mod settings;
mod step;
mod units;
pub mod vrpn;

pub use decoder::{Counters, Decoder};
pub use dialogue::Dialogue;
pub use format::{AnyDecoder, Format, PROTOCOLS};
pub use framing::{Fault, Framing, Reading, Verdict};
pub use port::{PortInfo, list_ports, open, probe};
pub use settings::{Hemisphere, PortName, TrackerSettings, Units};
