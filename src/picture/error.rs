//! Errors of decoding.

use penumbra_interface::PixelFormat;
use thiserror::Error;

/// A frame that cannot be decoded. The message says what is wrong; the caller adds where.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum PictureError {
    /// The frame carries no bytes.
    #[error("empty frame: the camera sent no bytes")]
    Empty,
    /// A raw frame with a zero width or height.
    #[error("{format:?} frame of {width}×{height}: a raw frame needs its size")]
    NoSize {
        /// Format of the frame.
        format: PixelFormat,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// More than 64 Mpixel, or more than the calibration and configuration allow.
    #[error("picture of {width}×{height}: larger than what is allowed here")]
    TooLarge {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
    },
    /// Subsampled chroma needs an even size.
    #[error("{format:?} frame of {width}×{height}: its chroma needs an even {side}")]
    OddSize {
        /// Format of the frame.
        format: PixelFormat,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// "width" or "height".
        side: &'static str,
    },
    /// The stride is smaller than one row.
    #[error("{format:?} frame: stride of {stride} bytes is less than a row's {row}")]
    ShortStride {
        /// Format of the frame.
        format: PixelFormat,
        /// Stride stated by the device, bytes.
        stride: u32,
        /// Size of a row, bytes.
        row: u64,
    },
    /// Fewer bytes than the size requires.
    #[error("{format:?} frame of {width}×{height}: {got} bytes, {needed} needed (truncated)")]
    TooShort {
        /// Format of the frame.
        format: PixelFormat,
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Number of bytes received.
        got: usize,
        /// Number of bytes needed.
        needed: u64,
    },
    /// The JPEG or PNG decoder failed.
    #[error("damaged {format:?} picture: {reason}")]
    Damaged {
        /// Format of the frame.
        format: PixelFormat,
        /// The decoder's message, in one line.
        reason: String,
    },
}
