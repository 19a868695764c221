//! FreeD D1 (Vinten Radamec free-d manual V1.4.4, appendices A and B).
//!
//! 29 bytes: `D1`, the camera's number, pan, tilt, roll, X, Y, height, zoom, focus (24 bits
//! each, big-endian), two spare bytes and a checksum. Angles are in units of 1/32768°,
//! positions in units of 1/64 mm. A serial line has 38400 baud, 8 data bits and odd parity;
//! today most units send each message as a UDP datagram.
//!
//! The frame: X right, Y forward, Z up, right-handed, metres. A camera with pan = tilt =
//! roll = 0 looks along +Y with its top towards +Z. Pan is positive to the right, tilt
//! upwards, roll clockwise as seen from behind the camera (B.4). The sensor's axes are the
//! camera's right, forward and up, so the pose is R = Rz(−pan) · Rx(tilt) · Ry(roll).
//! Senders differ in the order and the signs of the fields, see [`Axes`].

mod axes;
pub(crate) mod commands;
mod message;
mod record;
mod sender;

pub use axes::Axes;
pub use message::{D1_LEN, Lens, Message};
pub use record::Format;
pub use sender::{FreedSender, optical_to_studio};

#[cfg(test)]
mod tests;
