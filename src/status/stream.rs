//! JPEG encoding of pictures, and the framing of an MJPEG stream.

use bytes::{BufMut, Bytes, BytesMut};
use penumbra_picture::Picture;
use std::io::Write as _;
use thiserror::Error;
use turbojpeg::{Compressor, Image, PixelFormat, Subsamp};

/// What separates the pictures of a stream.
const BOUNDARY: &str = "penumbra-frame";

/// The `Content-Type` of a stream (RFC 2046 §5.1, and what browsers make of `x-mixed-replace`).
pub const STREAM_CONTENT_TYPE: &str = "multipart/x-mixed-replace; boundary=penumbra-frame";

/// A picture could not be encoded.
#[derive(Debug, Error)]
pub enum EncodeError {
    /// The buffer is not `4 * width * height` bytes, or there are no pixels.
    #[error("a picture of {width}×{height} has {bytes} bytes and cannot be encoded")]
    Shape {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Length of the buffer, bytes.
        bytes: usize,
    },
    /// libjpeg-turbo refused.
    #[error("JPEG encoder: {0}")]
    Jpeg(#[from] turbojpeg::Error),
    /// The PNG encoder refused.
    #[error("PNG encoder: {0}")]
    Png(#[from] png::EncodingError),
}

/// Encodes pictures as baseline JPEG, 4:2:0. Reuses its state.
pub struct JpegEncoder {
    compressor: Compressor,
}

impl JpegEncoder {
    /// Creates an encoder of `quality`, clamped to 1..=100.
    ///
    /// # Errors
    /// The library cannot allocate.
    pub fn new(quality: u8) -> Result<Self, EncodeError> {
        let mut compressor = Compressor::new()?;
        compressor.set_quality(i32::from(quality.clamp(1, 100)))?;
        compressor.set_subsamp(Subsamp::Sub2x2)?;
        Ok(Self { compressor })
    }

    /// Encodes a picture as a JPEG file.
    ///
    /// # Errors
    /// The picture's buffer does not fit its size, or it is larger than JPEG allows.
    pub fn encode(&mut self, picture: &Picture) -> Result<Bytes, EncodeError> {
        let (width, height) = checked_size(picture)?;
        let image = Image {
            pixels: picture.rgba.as_slice(),
            width,
            pitch: 4 * width,
            height,
            format: PixelFormat::RGBX,
        };
        Ok(self.compressor.compress_to_vec(image)?.into())
    }
}

/// Encodes a picture as an RGB PNG file, lossless.
///
/// # Errors
/// The picture's buffer does not fit its size.
pub fn encode_png(picture: &Picture) -> Result<Bytes, EncodeError> {
    checked_size(picture)?;
    let mut file = BytesMut::new().writer();
    let mut encoder = png::Encoder::new(&mut file, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    let rgb: Vec<u8> = picture
        .rgba
        .chunks_exact(4)
        .flat_map(|p| [p[0], p[1], p[2]])
        .collect();
    writer.write_image_data(&rgb)?;
    writer.finish()?;
    Ok(file.into_inner().freeze())
}

fn checked_size(picture: &Picture) -> Result<(usize, usize), EncodeError> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let expected = width.checked_mul(height).and_then(|n| n.checked_mul(4));
    if expected == Some(picture.rgba.len()) && expected != Some(0) {
        return Ok((width, height));
    }
    Err(EncodeError::Shape {
        width: picture.width,
        height: picture.height,
        bytes: picture.rgba.len(),
    })
}

/// The start of a stream.
#[must_use]
pub fn stream_preamble() -> Bytes {
    Bytes::from(format!("--{BOUNDARY}\r\n"))
}

/// Frames a picture for a stream. The boundary of the *next* part follows at once, because browsers
/// show a part only at its end; otherwise every picture would be delayed by one.
#[must_use]
pub fn stream_part(jpeg: &[u8]) -> Bytes {
    let mut part = BytesMut::with_capacity(jpeg.len() + 128).writer();
    let head = format!(
        "Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
        jpeg.len()
    );
    // Writing to memory cannot fail.
    let _ = part.write_all(head.as_bytes());
    let _ = part.write_all(jpeg);
    let _ = write!(part, "\r\n--{BOUNDARY}\r\n");
    part.into_inner().freeze()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn gradient(width: u32, height: u32) -> Picture {
        let pixel = |i: u32| {
            let (x, y) = (i % width, i / width);
            [(x * 255 / width) as u8, (y * 255 / height) as u8, 90, 255]
        };
        let rgba = (0..width * height).flat_map(pixel).collect();
        Picture {
            width,
            height,
            rgba,
        }
    }

    #[test]
    fn jpeg_decodes_to_a_similar_picture_of_the_same_size() {
        let picture = gradient(67, 41);
        let jpeg = JpegEncoder::new(85).unwrap().encode(&picture).unwrap();
        let back = image::load_from_memory_with_format(&jpeg, image::ImageFormat::Jpeg)
            .unwrap()
            .to_rgb8();
        assert_eq!(back.dimensions(), (67, 41));
        let error: i64 = back
            .enumerate_pixels()
            .flat_map(|(x, y, p)| (0..3).map(move |c| (x, y, c, p[c])))
            .map(|(x, y, c, v)| (i64::from(v) - i64::from(picture.rgb(x, y)[c])).abs())
            .sum();
        assert!(
            error / (67 * 41 * 3) < 4,
            "mean error {}",
            error / (67 * 41 * 3)
        );
    }

    #[test]
    fn refuses_a_buffer_of_the_wrong_length() {
        let mut encoder = JpegEncoder::new(0).unwrap();
        for (width, height, bytes) in [(2, 2, 15), (0, 0, 0), (u32::MAX, u32::MAX, 4)] {
            let picture = Picture {
                width,
                height,
                rgba: vec![0; bytes],
            };
            assert!(matches!(
                encoder.encode(&picture),
                Err(EncodeError::Shape { .. })
            ));
            assert!(matches!(
                encode_png(&picture),
                Err(EncodeError::Shape { .. })
            ));
        }
        let too_wide = Picture {
            width: 70_000,
            height: 1,
            rgba: vec![0; 280_000],
        };
        assert!(matches!(
            encoder.encode(&too_wide),
            Err(EncodeError::Jpeg(_))
        ));
    }

    proptest! {
        #[test]
        fn png_is_lossless(width in 1_u32..20, height in 1_u32..20, seed in any::<u64>()) {
            let mut picture = gradient(width, height);
            picture.rgba.chunks_exact_mut(4).enumerate().for_each(|(i, p)| {
                p[0] = (seed.rotate_left(i as u32 % 64)) as u8;
            });
            let file = encode_png(&picture).unwrap();
            let back = image::load_from_memory(&file).unwrap().to_rgba8();
            prop_assert_eq!(back.as_raw(), &picture.rgba);
        }
    }

    #[test]
    fn part_ends_with_the_next_boundary() {
        let part = stream_part(b"JPEG");
        let text = std::str::from_utf8(&part).unwrap();
        assert_eq!(
            text,
            "Content-Type: image/jpeg\r\nContent-Length: 4\r\n\r\nJPEG\r\n--penumbra-frame\r\n"
        );
        assert_eq!(&stream_preamble()[..], b"--penumbra-frame\r\n");
        assert!(STREAM_CONTENT_TYPE.ends_with(BOUNDARY));
    }
}
