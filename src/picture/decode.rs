//! Decodes frames and files of any format.

use crate::error::PictureError;
use crate::picture::{MAX_PIXELS, Picture};
use crate::raw::YuvEncoding;
use crate::{coded, raw};
use penumbra_interface::{Frame, PixelFormat};

impl Picture {
    /// Decodes a frame into a new picture; see [`decode_into`].
    ///
    /// # Errors
    /// The frame is empty, incomplete, damaged or larger than 64 Mpixel.
    pub fn decode(frame: &Frame, yuv: &YuvEncoding) -> Result<Self, PictureError> {
        let mut picture = Self::default();
        decode_into(frame, yuv, &mut picture)?;
        Ok(picture)
    }

    /// Decodes the bytes of a JPEG or PNG file, distinguished by their first byte.
    ///
    /// # Errors
    /// The bytes are neither, or the picture is damaged or larger than 64 Mpixel.
    pub fn from_file_bytes(bytes: &[u8]) -> Result<Self, PictureError> {
        let mut picture = Self::default();
        match bytes.first() {
            None => return Err(PictureError::Empty),
            Some(0x89) => coded::decode_png(bytes, &mut picture)?,
            Some(_) => coded::decode_jpeg(bytes, &mut picture)?,
        }
        Ok(picture)
    }
}

/// As [`decode_into`], of at most `max_pixels`. A coded picture's header is judged before it is
/// decoded.
///
/// # Errors
/// As [`decode_into`], or the picture is larger.
pub fn decode_within(
    max_pixels: u64,
    frame: &Frame,
    yuv: &YuvEncoding,
    picture: &mut Picture,
) -> Result<(), PictureError> {
    let size = match frame.format {
        PixelFormat::Jpeg => coded::jpeg_size(&frame.data)?,
        PixelFormat::Png => coded::png_size(&frame.data)?,
        _ => (frame.width, frame.height),
    };
    let (width, height) = size;
    if u64::from(width) * u64::from(height) > max_pixels.min(MAX_PIXELS) {
        return Err(PictureError::TooLarge { width, height });
    }
    decode_into(frame, yuv, picture)
}

/// Decodes a frame into `picture`, whose buffer is reused. JPEG is decoded with libjpeg-turbo's defaults
/// (accurate DCT, smooth chroma); `yuv` applies only to YUYV and NV12. After an error the picture's
/// codes are unspecified; its size and buffer are consistent.
///
/// # Errors
/// The frame is empty, incomplete, damaged or larger than 64 Mpixel.
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
