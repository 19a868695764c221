//! Polhemus FASTRAK (manual OPM00PI002 Rev G, records of the `O`, `F`, `f`, `U`, `u`
//! commands).
//!
//! A record is `'0'`, the station's digit, an error letter or a blank, the position, the
//! orientation and an ending. [`Format`] is the configured layout;
//! [`Decoder`] finds the records in a byte stream; [`Status`] is the answer to `S`. Capital and
//! small letters of a command have different meanings.

pub(crate) mod commands;
mod record;
mod status;

pub use crate::decoder::Counters;
pub use crate::framing::Fault;
pub use crate::units::{METRES_PER_CENTIMETRE, METRES_PER_INCH};
pub use record::{Encoding, Ending, Format, Orientation};
pub use status::{STATUS_LEN, Status};

/// Decodes the stream of a FASTRAK.
pub type Decoder = crate::decoder::Decoder<Format>;
