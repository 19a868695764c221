//! Pictures in memory, and their decoding from a camera's bytes.
//!
//! Modules in the order of the data flow: `coded` (JPEG, PNG), `raw` (uncompressed frames), `bayer`
//! (demosaicing), `decode` (chooses by the format), `picture` (the result). `bounded` reads and
//! `whole_file` writes files, `draw` and `label` draw lines and text.

mod bayer;
mod bounded;
mod coded;
mod decode;
mod draw;
mod error;
mod label;
mod picture;
mod raw;
mod whole_file;

pub use bounded::{MAX_PICTURE_BYTES, read_bounded, read_text_bounded};
pub use decode::{decode_into, decode_within};
pub use error::PictureError;
pub use picture::{MAX_PIXELS, Picture};
pub use raw::{YuvEncoding, YuvMatrix, YuvRange};
pub use whole_file::write_whole;

#[cfg(test)]
mod tests;
