//! Pictures in memory, and their decoding from a camera's bytes.
//!
//! Modules in the order of the data flow: `coded` (JPEG, PNG), `raw` (uncompressed frames), `bayer`
//! (demosaicing), `decode` (chooses by the format), `picture` (the result). `whole_file` writes files.

mod bayer;
mod coded;
mod decode;
mod error;
mod picture;
mod raw;
mod whole_file;

pub use decode::decode_into;
pub use error::PictureError;
pub use picture::{MAX_PIXELS, Picture};
pub use raw::{YuvEncoding, YuvMatrix, YuvRange};
pub use whole_file::write_whole;

#[cfg(test)]
mod tests;
