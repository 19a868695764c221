//! Drivers of serial and network 6-DOF trackers.
//!
//! Each protocol is a module of its own without I/O: [`fastrak`], [`liberty`], [`flock`],
//! [`freed`], [`csv`], [`vrpn`]. It says how records look ([`Framing`]); [`Decoder`], the
//! same for all, takes bytes as they arrive, split anywhere, and gives out
//! [`PoseSample`](penumbra_interface::PoseSample)s. It reads no clock and allocates nothing
//! per record, so a recorded stream and a live one decode alike; on garbage it slides one
//! byte and tries again. [`Dialogue`] is what is said on connecting, also without I/O.
//! [`port`] opens serial ports and sockets and is the only part that blocks.

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
pub mod vrpn;

pub use decoder::{Counters, Decoder};
pub use dialogue::Dialogue;
pub use format::{AnyDecoder, Format, PROTOCOLS};
pub use framing::{Fault, Framing, Reading, Verdict};
pub use port::{PortInfo, list_ports, open, probe};
pub use settings::{Hemisphere, PortName, TrackerSettings, Units};
