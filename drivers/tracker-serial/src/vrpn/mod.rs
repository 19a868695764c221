//! VRPN: poses of any tracker that a VRPN server has, over TCP.
//!
//! Client and server exchange cookies, give their senders and message types names, and number
//! them per connection; after that they send numbers only. [`Client`] does this without I/O and
//! extracts the `Pos_Quat` messages of one tracker. Only those are passed on and recorded, byte
//! for byte, because they can be decoded from any point of the stream; the connection as a
//! whole cannot. Source: VRPN's `vrpn_Connection.C` and `vrpn_Tracker.C`.

mod client;
mod record;
mod wire;

pub use client::{Client, VrpnError};
pub use record::Format;
pub use wire::{COOKIE_LEN, MESSAGE_HEADER_LEN, POS_QUAT_LEN};
