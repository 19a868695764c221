//! A decoded picture in memory, and how a camera's bytes become one.

mod bayer;
mod coded;
mod raw;

pub use raw::{YuvEncoding, YuvMatrix, YuvRange};

use penumbra_interface::{Frame, PixelFormat};
use thiserror::Error;

/// No picture may hold more pixels than this: a damaged header must not ask for more
/// memory than the machine has.
pub const MAX_PIXELS: u64 = 64 << 20;

/// 8-bit RGBA, rows tightly packed, pixel (0, 0) top left, as the camera encoded it (not
/// linear). Alpha is 255 and means nothing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Picture {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `4 * width * height` bytes.
    pub rgba: Vec<u8>,
}

/// A frame's bytes are no picture. Each text says what is wrong; the caller says where.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum PictureError {
    /// The frame carries no bytes.
    #[error("empty frame: the camera sent no bytes")]
    Empty,
    /// A raw frame with a zero width or height.
    #[error("{format:?} frame of {width}×{height}: a raw frame must say its size")]
    NoSize {
        /// How the bytes spell the picture.
        format: PixelFormat,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// More than [`MAX_PIXELS`].
    #[error("picture of {width}×{height}: larger than the limit of 64 Mpixel")]
    TooLarge {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Subsampled chroma needs an even size.
    #[error("{format:?} frame of {width}×{height}: its chroma needs an even {side}")]
    OddSize {
        /// How the bytes spell the picture.
        format: PixelFormat,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// "width" or "height".
        side: &'static str,
    },
    /// The stride is smaller than one row.
    #[error("{format:?} frame: stride of {stride} bytes is less than a row's {row}")]
    ShortStride {
        /// How the bytes spell the picture.
        format: PixelFormat,
        /// What the device said, bytes.
        stride: u32,
        /// What a row needs, bytes.
        row: u64,
    },
    /// Fewer bytes than the size calls for.
    #[error("{format:?} frame of {width}×{height}: {got} bytes, {needed} needed (cut short)")]
    TooShort {
        /// How the bytes spell the picture.
        format: PixelFormat,
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes that came.
        got: usize,
        /// Bytes needed.
        needed: u64,
    },
    /// The JPEG or PNG decoder refused.
    #[error("damaged {format:?} picture: {reason}")]
    Damaged {
        /// How the bytes spell the picture.
        format: PixelFormat,
        /// What the decoder said, in one line.
        reason: String,
    },
}

impl Picture {
    /// The three codes of pixel (`x`, `y`), which must lie inside.
    #[must_use]
    pub fn rgb(&self, x: u32, y: u32) -> [u8; 3] {
        let i = 4 * (y as usize * self.width as usize + x as usize);
        [self.rgba[i], self.rgba[i + 1], self.rgba[i + 2]]
    }

    /// Decodes a frame into a new picture; see [`decode_into`].
    pub fn decode(frame: &Frame, yuv: &YuvEncoding) -> Result<Self, PictureError> {
        let mut picture = Self::default();
        decode_into(frame, yuv, &mut picture)?;
        Ok(picture)
    }

    /// Decodes a JPEG or PNG file's bytes, told apart by their first byte.
    ///
    /// # Errors
    /// Anything else, or a damaged picture.
    pub fn from_file_bytes(bytes: &[u8]) -> Result<Self, PictureError> {
        let mut picture = Self::default();
        match bytes.first() {
            None => return Err(PictureError::Empty),
            Some(0x89) => coded::decode_png(bytes, &mut picture)?,
            Some(_) => coded::decode_jpeg(bytes, &mut picture)?,
        }
        Ok(picture)
    }

    /// Becomes the same as `other`, keeping the buffer where it is large enough.
    pub fn copy_from(&mut self, other: &Self) {
        (self.width, self.height) = (other.width, other.height);
        self.rgba.clone_from(&other.rgba);
    }

    /// Takes a size of at most [`MAX_PIXELS`], keeping the buffer where it is large enough.
    fn resize(&mut self, width: u32, height: u32) -> Result<(), PictureError> {
        let pixels = u64::from(width) * u64::from(height);
        if pixels > MAX_PIXELS {
            return Err(PictureError::TooLarge { width, height });
        }
        self.rgba.resize(4 * pixels as usize, 255);
        (self.width, self.height) = (width, height);
        Ok(())
    }
}

/// Decodes a frame's bytes into `picture`, whose buffer is used again. JPEG is decoded as
/// libjpeg-turbo does by default (accurate DCT, smooth chroma); `yuv` concerns only YUYV
/// and NV12. After an error the picture's codes are unspecified, its size and buffer agree.
pub fn decode_into(
    frame: &Frame,
    yuv: &YuvEncoding,
    picture: &mut Picture,
) -> Result<(), PictureError> {
    if frame.data.is_empty() {
        return Err(PictureError::Empty);
    }
    match frame.format {
        PixelFormat::Jpeg => coded::decode_jpeg(&frame.data, picture),
        PixelFormat::Png => coded::decode_png(&frame.data, picture),
        PixelFormat::Yuyv
        | PixelFormat::Nv12
        | PixelFormat::Rgb8
        | PixelFormat::Grey8
        | PixelFormat::Bayer8(_) => raw::decode(frame, yuv, picture),
    }
}

#[cfg(test)]
mod tests;
