//! Ascension Flock of Birds.
//!
//! Records consist of 7-bit bytes; only the first byte of a record has bit 7 set. A word is two
//! bytes, the least significant seven bits first, and is a signed fraction of its full scale:
//! 36 inches (144 with an extended-range transmitter) for positions, 1 for quaternions, 180°
//! for angles. In group mode the address of the bird follows. Source: VRPN's `vrpn_Flock.C`;
//! the layout is checked against a recording of a device (IGSTK).

pub(crate) mod commands;
mod record;

pub use record::Format;
