//! Polhemus FASTRAK (manual OPM00PI002 Rev G, records of the `O`, `F`, `f`, `U`, `u`
//! commands).
//!
//! A record is `'0'`, the station's digit, an error letter or a blank, the position, the
//! orientation and an ending. [`Format`] says which of the spellings the device was told
//! to send; [`Decoder`] finds the records in a byte stream; [`Status`] is the answer to
//! `S`. Capital and small letters of a command mean different things.

pub(crate) mod commands;
mod record;
mod status;

pub use crate::{Counters, Fault};
pub use record::{Encoding, Ending, Format, Orientation};
pub use status::{STATUS_LEN, Status};

/// A FASTRAK stream.
pub type Decoder = crate::Decoder<Format>;

/// Metres in an inch, the FASTRAK's unit unless told otherwise (`U`).
pub const METRES_PER_INCH: f64 = 0.0254;

/// Metres in a centimetre, the unit after `u`.
pub const METRES_PER_CENTIMETRE: f64 = 0.01;
