//! Polhemus Liberty and Patriot, binary records (`F1`).
//!
//! Unlike a FASTRAK's, a record declares its size: `LY` (Patriot `PA`, some units `LU`), the
//! station, the command that it answers, an error, a reserved byte and the size of the body as
//! 16 bits, little-endian; then the items of the `O` command. Source: VRPN's
//! `vrpn_Tracker_Liberty.C`.

pub(crate) mod commands;
mod record;

pub use record::{Format, HEADER_LEN};
